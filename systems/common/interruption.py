"""Lets Ctrl-C wait for the end of a block of code."""

from __future__ import annotations

import contextlib
import signal
import threading
import types
from collections.abc import Generator


@contextlib.contextmanager
def interruption_waits() -> Generator[None]:
    """Within the block, Ctrl-C waits; it acts at the end.

    HDF5's library for Python calls weak references' callbacks all the time. Python prints an
    exception that is raised in one of them and goes on, so that every tenth Ctrl-C would be lost.

    Only the main thread receives signals: in another one, this does nothing.
    """
    handler = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(handler):
        yield
        return
    came: list[tuple[int, types.FrameType | None]] = []
    signal.signal(signal.SIGINT, lambda number, frame: came.append((number, frame)))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler)
        if came:
            handler(*came[0])
