"""`Progress`: how long-running work reports its progress."""

from collections.abc import Callable
from typing import Any

Progress = Callable[[float, str], Any]
"""Called now and then with the share of the work that is done, from 0 to 1, and a text."""


def silent(done: float, text: str) -> None:
    """The `Progress` that reports nothing."""


def part_of(progress: Progress, start: float, end: float) -> Progress:
    """The `Progress` of a part of the work, which takes the whole from share `start` to `end`."""
    return lambda done, text: progress(start + (end - start) * done, text)
