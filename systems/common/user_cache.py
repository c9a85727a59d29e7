"""Arrays that take long to compute, kept in the user's cache folder under a name that says all."""

from __future__ import annotations

import hashlib
import json
import logging
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from proxops.systems.common.errors import InputError
from proxops.systems.common.files import write_whole
from proxops.systems.common.user_folders import cache_folder

_log = logging.getLogger(__name__)


def name_of(*made_from: str | int | float) -> str:
    """A name for arrays that depend on these texts and numbers alone, to the last bit."""
    key = [each.hex() if isinstance(each, float) else each for each in made_from]
    return hashlib.sha256(json.dumps(key).encode()).hexdigest()


def kept_arrays(kind: str, name: str) -> dict[str, np.ndarray] | None:
    """The arrays kept under a name; None if there are none or the file is damaged.

    Some may be missing from a damaged file, but none is wrong.

    Args:
      kind: what they are a table of, in one word: the folder within the cache.
    """
    try:
        folder = cache_folder(kind)
        if folder is None:
            return None
        # numpy leaves a file open that it cannot read. It checks a checksum of each array.
        path = folder / f"{name}.npz"
        with path.open("rb") as stored, np.load(stored, allow_pickle=False) as file:
            return dict(file)
    except Exception:  # Those of a damaged archive have no common type.
        return None


def keep_arrays(kind: str, name: str, arrays: Mapping[str, np.ndarray | float]) -> None:
    """Keeps arrays under a name. If that is not possible, it warns in the log."""

    def write(path: Path) -> None:
        with path.open("wb") as file:  # To a path, numpy would add a suffix.
            np.savez(
                file,
                allow_pickle=False,
                **{name: np.asarray(each) for name, each in arrays.items()},
            )

    folder = cache_folder(kind)
    try:
        if folder is None:
            raise InputError("no folder for it can be written; set XDG_CACHE_HOME to one that can")
        write_whole(folder / f"{name}.npz", write)
        _log.info("the %s table is kept in %s", kind, folder)
    except InputError as error:
        _log.warning("the %s table is not kept: %s", kind, error)
