"""Scripts that are no part of the package, as modules and as programs."""

import importlib
import os
import runpy
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

import pytest
from pages import ROOT


def load_script(path: str) -> ModuleType:
    """A script, for instance "docs/render_results.py", imported.

    The benchmarks ask for single threads in the environment as they begin. It is put back: numba
    reads it at every compilation, and refuses another number than it has begun with.
    """
    with _beside(ROOT / path):
        return importlib.import_module(Path(path).stem)


def run_script(path: Path, *arguments: str) -> None:
    """Runs a script with arguments in this process, which has imported and compiled already."""
    with _beside(path) as patch:
        patch.setattr(sys, "argv", [str(path), *arguments])
        runpy.run_path(str(path), run_name="__main__")


@contextmanager
def _beside(script: Path) -> Iterator[pytest.MonkeyPatch]:
    """Modules beside a script are found; the environment is put back."""
    before = dict(os.environ)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(script.parent)
        try:
            yield patch
        finally:
            os.environ.clear()
            os.environ.update(before)
