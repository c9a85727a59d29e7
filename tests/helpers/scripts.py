"""Scripts that are no part of the package, as modules, for the tests of what they compute."""

import importlib
import os
from types import ModuleType

import pytest
from pages import ROOT


def load_script(path: str) -> ModuleType:
    """A script, for instance "docs/render_results.py", imported.

    The benchmarks ask for single threads in the environment as they begin. It is put back: numba
    reads it at every compilation, and refuses another number than it has begun with.
    """
    script, before = ROOT / path, dict(os.environ)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(script.parent)
        try:
            return importlib.import_module(script.stem)
        finally:
            os.environ.clear()
            os.environ.update(before)
