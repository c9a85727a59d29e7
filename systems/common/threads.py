"""Linear algebra on one thread, so that its last bits do not depend on the number of threads."""

from __future__ import annotations

import contextlib
import functools
import importlib

from threadpoolctl import ThreadpoolController


def one_thread() -> contextlib.AbstractContextManager:
    """Within the block, NumPy's and SciPy's linear algebra uses one thread.

    More threads add in another order. And for the matrices of a flight they are slower, a hundred
    times so if the machine is busy.
    """
    return _libraries().limit(limits=1, user_api="blas")


@functools.cache
def _libraries() -> ThreadpoolController:
    """Those of NumPy and SciPy; only what is loaded is found."""
    importlib.import_module("scipy.linalg")
    return ThreadpoolController()
