"""The gravity tables of this user's machine: one file each, named by what it was made from."""

from __future__ import annotations

import os
import sys
import zipfile
import zlib
from pathlib import Path

import numpy as np

from proxops.systems.common import InputError, make_folder, write_whole
from proxops.systems.gravity._harmonic_boxes import DEGREE, Boxes, entries


def read_boxes(name: str) -> Boxes | None:
    """The boxes stored under a name; None if there are none or the file is damaged."""
    path = _folder() / f"{name}.npz"
    try:
        # numpy leaves a file open that it cannot read. It checks a checksum of each array.
        with path.open("rb") as stored, np.load(stored, allow_pickle=False) as file:
            boxes = Boxes(*(file[field] for field in Boxes._fields))
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error):
        return None
    return boxes if _fits(boxes) else None


def store_boxes(name: str, boxes: Boxes) -> None:
    """Stores boxes under a name. If that is not possible, it says so on stderr."""
    try:
        make_folder(_folder())
        write_whole(_folder() / f"{name}.npz", lambda path: _write(path, boxes))
    except InputError as error:
        sys.stderr.write(f"proxops: the gravity table is not kept: {error}\n")


def _write(path: Path, boxes: Boxes) -> None:
    with path.open("wb") as file:  # To a path, numpy would add a suffix.
        np.savez(file, allow_pickle=False, **boxes._asdict())


def _fits(boxes: Boxes) -> bool:
    """Tells whether the compiled kernel, which checks no index, can read the arrays."""
    children, places, coefficients = boxes
    return (
        children.dtype == np.int32
        and places.dtype == coefficients.dtype == np.float64
        and children.ndim == 2
        and len(children) > 0
        and children.shape[1] == 8
        and places.shape == (len(places), 4)
        and coefficients.shape == (len(places), entries(DEGREE), 2)
        # A child comes after its node, so that every descent ends.
        and bool(np.all((children < 0) | (children > np.arange(len(children))[:, None])))
        and bool(np.all(children < len(children)))
        and bool(np.all(children >= -1 - len(places)))
    )


def _folder() -> Path:
    """The user's folder for files that can be made again."""
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local"
    else:
        base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "proxops" / "gravity"
