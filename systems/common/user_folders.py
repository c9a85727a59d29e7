"""The user's folders for files that can be made again."""

from __future__ import annotations

import contextlib
import os
import stat
import tempfile
from pathlib import Path


def cache_folder(kind: str) -> Path | None:
    """Makes the user's folder for files of a kind that can be made again.

    It lies in XDG_CACHE_HOME or ~/.cache. Where that cannot be written, it lies in a folder of the
    user's own among the temporary files. None if that cannot be written either.
    """
    for place in (_in_home, _among_temporary_files):
        with contextlib.suppress(OSError, RuntimeError):  # RuntimeError: the user has no home.
            folder = place() / kind
            folder.mkdir(parents=True, exist_ok=True)
            if os.access(folder, os.W_OK | os.X_OK):
                return folder
    return None


def _in_home() -> Path:
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "proxops"


def _among_temporary_files() -> Path:
    """Anyone may have made it before, so it must be the user's: code that is run is kept in it.

    Raises:
      PermissionError: another user owns it or may write in it.
    """
    folder = Path(tempfile.gettempdir()) / f"proxops-{os.getuid()}"
    folder.mkdir(mode=0o700, exist_ok=True)
    found = folder.lstat()
    others_write = found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid() or others_write:
        raise PermissionError(f"{folder} is not the user's own")
    return folder
