"""Settings of all tests."""

import os
import signal

import pytest

# One thread for linear algebra, here and in what tests start: pytest-xdist already runs a process
# on each core, and idle threads of these libraries keep a core busy while they wait.
for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")

# If a shell starts the tests in the background, it has set them to ignore Ctrl-C, and all processes
# that they start inherit it.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Puts the tests of the navigation first.

    numba takes long to compile its kernels. So one process does that, while the others,
    which start further down, run what needs none of them; later they find them in numba's cache.
    """
    items.sort(key=lambda item: "navigation" not in item.path.name)
