"""Linear algebra on one thread, so that its last bits do not depend on the number of threads."""

from __future__ import annotations

import contextlib
import contextvars
import functools
import importlib
import os
from collections.abc import Generator

from threadpoolctl import ThreadpoolController

_WITHIN: contextvars.ContextVar[bool] = contextvars.ContextVar("one_thread", default=False)


@contextlib.contextmanager
def one_thread() -> Generator[None]:
    """Within the block, or the function that it decorates, linear algebra uses one thread.

    More threads of NumPy's and SciPy's libraries add in another order. And for the matrices of a
    flight they are slower, a hundred times so if the machine is busy.
    """
    if _WITHIN.get():
        yield
        return
    within = _WITHIN.set(True)
    try:
        with _libraries().limit(limits=1):
            yield
    finally:
        _WITHIN.reset(within)


def threads_to_use() -> int:
    """How many threads a piece of numerical work may use: one within `one_thread`.

    Elsewhere OMP_NUM_THREADS, or one for each core.
    """
    if _WITHIN.get():
        return 1
    return int(os.environ.get("OMP_NUM_THREADS") or os.cpu_count() or 1)


@functools.cache
def _libraries() -> ThreadpoolController:
    """Those of NumPy and SciPy; only what is loaded is found."""
    importlib.import_module("scipy.linalg")
    return ThreadpoolController().select(user_api="blas")
