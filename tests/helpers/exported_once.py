"""Bundles for tests: PyTorch takes a second or two to export one, so each is exported once."""

import atexit
import shutil
from collections.abc import Callable, Hashable
from pathlib import Path
from tempfile import mkdtemp

_EXPORTED: dict[Hashable, Path] = {}


def exported_once(folder: Path, key: Hashable, export: Callable[[Path], object]) -> Path:
    """Makes `folder` a copy of what `export` writes into the path that it is given.

    `export` is called at the first `key` of its kind only.
    """
    if key not in _EXPORTED:
        made = Path(mkdtemp(prefix="bundle-"))
        atexit.register(shutil.rmtree, made, ignore_errors=True)
        export(made / "bundle")
        _EXPORTED[key] = made / "bundle"
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(_EXPORTED[key], folder)
    return folder
