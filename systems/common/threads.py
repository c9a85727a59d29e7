"""Linear algebra on one thread, so that its last bits do not depend on the number of threads."""

from __future__ import annotations

import contextlib
import functools
import importlib
from collections.abc import Generator

from threadpoolctl import ThreadpoolController


@contextlib.contextmanager
def one_thread() -> Generator[None]:
    """Within the block, or the function that it decorates, linear algebra uses one thread.

    More threads of NumPy's and SciPy's libraries add in another order. And for the matrices of a
    flight they are slower, a hundred times so if the machine is busy.
    """
    libraries = _libraries()
    # To look takes a thirtieth of the time that it takes to limit.
    if all(library.get_num_threads() == 1 for library in libraries.lib_controllers):
        yield
        return
    with libraries.limit(limits=1):
        yield


@functools.cache
def _libraries() -> ThreadpoolController:
    """Those of NumPy and SciPy; only what is loaded is found."""
    importlib.import_module("scipy.linalg")
    return ThreadpoolController().select(user_api="blas")
