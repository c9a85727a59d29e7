"""A script that starts processes without `if __name__ == "__main__":` is told what to write."""

import runpy
import sys
from pathlib import Path

import pytest

from proxops.systems import InputError

# What starts processes, called from a function, as `Workers` does.
SCRIPT = """
from proxops.diagrams.flight.main_guard import check_main_guard
def work():
    check_main_guard()
"""


@pytest.mark.parametrize(
    "ending",
    [
        "work()",
        "if work:\n    work()",
        'if __name__ == "__main__":\n    pass\nwork()',
        "list(map(lambda _: work(), [1]))",
    ],
)
def test_without_a_guard(tmp_path: Path, ending: str) -> None:
    with pytest.raises(InputError, match="this starts processes"):
        run(tmp_path, ending)


@pytest.mark.parametrize(
    "guard",
    [
        'if __name__ == "__main__":',
        "if '__main__' == __name__:",
        'if work and __name__ == "__main__":',
        'if __name__ != "__main__":\n    pass\nelse:',
    ],
)
def test_with_a_guard(tmp_path: Path, guard: str) -> None:
    run(tmp_path, f"{guard}\n    work()")


@pytest.mark.parametrize("command", [("-c",), ("-m", "package"), ("-m", "cProfile")])
def test_scripts_that_no_process_imports(tmp_path: Path, command: tuple[str, ...]) -> None:
    """`python -c`, a package with a `__main__`, and a script under a profiler."""
    (tmp_path / "package").mkdir()
    (tmp_path / "package" / "__main__.py").write_text(f"{SCRIPT}\nwork()")
    run(tmp_path, "work()", command)


def run(folder: Path, ending: str, command: tuple[str, ...] = ()) -> None:
    """Runs a script as Python would run it, in this process."""
    path = folder / "script.py"
    path.write_text(f"{SCRIPT}\n{ending}")
    kept = sys.path.copy(), sys.argv.copy()
    sys.path.insert(0, str(folder))
    try:
        if command == ("-c",):
            main = type(sys)("__main__")
            with pytest.MonkeyPatch.context() as patch:
                patch.setitem(sys.modules, "__main__", main)
                exec(path.read_text(), vars(main))
        elif command == ("-m", "cProfile"):
            sys.argv = ["cProfile", "-o", str(folder / "profile"), str(path)]
            runpy.run_module("cProfile", run_name="__main__", alter_sys=True)
        elif command:
            runpy.run_module(command[1], run_name="__main__", alter_sys=True)
        else:
            runpy.run_path(str(path), run_name="__main__")
    finally:
        sys.path[:], sys.argv[:] = kept
        sys.modules.pop("package", None)
