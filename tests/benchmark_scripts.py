"""Scripts of benchmarks/ as modules, for the tests of what they compute."""

import importlib
import os
from pathlib import Path
from types import ModuleType

import pytest

FOLDER = Path(__file__).parents[1] / "benchmarks"


def load_script(name: str) -> ModuleType:
    """A script of benchmarks/, imported.

    The scripts ask for single threads in the environment as they begin. It is put back: numba
    reads it at every compilation, and refuses another number than it has begun with.
    """
    before = dict(os.environ)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(FOLDER)
        try:
            return importlib.import_module(name)
        finally:
            os.environ.clear()
            os.environ.update(before)
