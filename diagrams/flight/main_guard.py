"""Refuses to start processes from a script that would run again in each of them."""

from __future__ import annotations

import ast
import linecache
import sys

from proxops.systems.common import InputError


def check_main_guard() -> None:
    """Checks that the script which is running may be imported by a process that it starts.

    A new process imports the main script, under another name. What it does outside of
    `if __name__ == "__main__":` would be done again there, and so would the start of processes.

    Raises:
      InputError: the statement of the script that is running is not under such an `if`.
    """
    main = sys.modules["__main__"]
    spec = getattr(main, "__spec__", None)
    # As multiprocessing decides: it leaves out `__main__` of a package or of a folder.
    if spec is not None and spec.name.rpartition(".")[2] == "__main__":
        return
    script = getattr(main, "__file__", None) if spec is None else spec.origin
    frame = sys._getframe()
    while frame is not None:
        # What `exec` runs in the script's name space has another file.
        place = frame.f_code.co_filename, frame.f_code.co_name
        if frame.f_globals is vars(main) and place == (script, "<module>"):
            if _is_guarded(place[0], frame.f_lineno):
                return
            raise InputError(
                f"{script}, line {frame.f_lineno}: this starts processes, and each of them imports "
                'the script; put what the script does under `if __name__ == "__main__":`, or take '
                "one process"
            )
        frame = frame.f_back


def _is_guarded(path: str, line: int) -> bool:
    """Tells whether a line of a script is inside an `if` that asks for `__name__`."""
    try:
        script = ast.parse("".join(linecache.getlines(path)))
    except (SyntaxError, ValueError):
        return True  # It is no text, or was edited since; then nobody knows.
    return any(
        isinstance(node, ast.Name) and node.id == "__name__"
        for statement in ast.walk(script)
        if isinstance(statement, ast.If)
        and statement.lineno <= line <= (statement.end_lineno or statement.lineno)
        for node in ast.walk(statement.test)
    )
