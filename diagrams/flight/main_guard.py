"""Refuses to start processes from a script that would run again in each of them."""

from __future__ import annotations

import ast
import linecache
import sys
from types import FrameType

from proxops.systems.common import InputError


def check_main_guard() -> None:
    """Checks that the script which is running may be imported by a process that it starts.

    A new process imports the main script, under another name. What it does outside of
    `if __name__ == "__main__":` would be done again there, and so would the start of processes.

    Raises:
      InputError: the statement of the script that is running is not under such an `if`.
    """
    frame = _script_frame()
    if frame is None:
        return
    path, line = frame.f_code.co_filename, frame.f_lineno
    if not _is_guarded(path, line):
        raise InputError(
            f"{path}, line {line}: this starts processes, and each of them imports the script; "
            'put what the script does under `if __name__ == "__main__":`, or take one process'
        )


def _script_frame() -> FrameType | None:
    """The frame of the main script's own statements; None: a new process would run no script."""
    main = sys.modules["__main__"]
    spec = getattr(main, "__spec__", None)
    # As multiprocessing decides: it leaves out `__main__` of a package or of a folder.
    if spec is not None and spec.name.rpartition(".")[2] == "__main__":
        return None
    script = getattr(main, "__file__", None) if spec is None else spec.origin
    frame, wanted = sys._getframe(), (script, "<module>")
    while frame is not None:
        # What `exec` runs in the script's name space has another file.
        code = frame.f_code
        if frame.f_globals is vars(main) and (code.co_filename, code.co_name) == wanted:
            return frame
        frame = frame.f_back
    return None


def _is_guarded(path: str, line: int) -> bool:
    """Tells whether a line of a script is inside an `if` that asks for `__name__`."""
    try:
        script = ast.parse("".join(linecache.getlines(path)))
    except (SyntaxError, ValueError):
        return True  # It is no text, or was edited since; then nobody knows.
    for statement in ast.walk(script):
        if isinstance(statement, ast.If) and statement.lineno <= line <= _end(statement):
            names = {node.id for node in ast.walk(statement.test) if isinstance(node, ast.Name)}
            if "__name__" in names:
                return True
    return False


def _end(statement: ast.stmt) -> int:
    return statement.end_lineno or statement.lineno
