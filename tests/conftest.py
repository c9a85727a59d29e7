"""Settings of all tests."""

import os
import shutil
import signal
import tempfile

import hypothesis
import pytest

# One thread for linear algebra, here and in what tests start: pytest-xdist already runs a process
# on each core, and idle threads of these libraries keep a core busy while they wait.
for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")

# An example may take long on a busy machine, and so may to make one up.
slow_machine = [hypothesis.HealthCheck.too_slow]
hypothesis.settings.register_profile("proxops", deadline=None, suppress_health_check=slow_machine)
hypothesis.settings.load_profile("proxops")

# If a shell starts the tests in the background, it has set them to ignore Ctrl-C, and all processes
# that they start inherit it.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


# The longest of the slow modules: at the end they would run alone.
LONGEST = ("test_docs.py", "test_pilot_recipe.py", "test_benchmarks_run.py", "test_examples.py")


def pytest_configure(config: pytest.Config) -> None:
    """A folder for what tests make once a session (`made_once`), for all processes of it."""
    if "PROXOPS_TESTS_FOLDER" not in os.environ:
        folder = tempfile.mkdtemp(prefix="proxops-tests-")
        os.environ["PROXOPS_TESTS_FOLDER"] = folder

        def clean_up() -> None:
            del os.environ["PROXOPS_TESTS_FOLDER"]
            shutil.rmtree(folder, ignore_errors=True)

        config.add_cleanup(clean_up)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Puts the tests of the navigation first, then the longest modules.

    numba takes long to compile the navigation's kernels. So one process does that, while the
    others, which start further down, run what needs none of them; later they find them in the
    user's cache folder.
    """

    def place(item: pytest.Item) -> tuple[bool, bool]:
        return "navigation" not in item.path.name, item.path.name not in LONGEST

    items.sort(key=place)
