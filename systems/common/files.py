"""Files and folders: written completely or not at all, and identified by their hashes."""

from __future__ import annotations

import contextlib
import glob
import hashlib
import json
import os
import shutil
import tempfile
import typing
from collections.abc import Callable, Generator
from pathlib import Path

from proxops.systems.common.errors import InputError

# To ask for it means to set it, which is done once, before there are threads.
_umask = os.umask(0)
os.umask(_umask)


def make_folder(folder: Path) -> None:
    """Makes an output folder and its parents.

    Raises:
      InputError: it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot make the folder {folder}: {error.strerror}") from error


def last_change(path: Path) -> int:
    """Gives when a file was last changed, in ns, for caches of what is in it; 0: there is none."""
    return path.stat().st_mtime_ns if path.is_file() else 0


def write_whole(path: Path, write: Callable[[Path], typing.Any]) -> None:
    """Writes a file completely or not at all.

    Calls `write` with a temporary path in the same folder, then renames that file to `path`.

    Raises:
      InputError: the folder does not exist or cannot be written, or the disk is full.
    """
    try:
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=".part")
        os.close(handle)
    except OSError as error:
        raise InputError(f"cannot write in {path.parent}: {error.strerror}") from error
    temporary = Path(name)
    try:
        write(temporary)
        with temporary.open("rb") as file:
            os.fsync(file.fileno())
        temporary.chmod(0o666 & ~_umask)
        temporary.replace(path)
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror or error}") from error
    finally:
        temporary.unlink(missing_ok=True)


@contextlib.contextmanager
def whole_folder(folder: Path) -> Generator[Path]:
    """Inside, gives an empty folder to fill; afterwards this replaces `folder`, as a whole.

    What an earlier call left that was killed is removed; if it was killed between taking the older
    folder away and putting the new one in its place, the older one is put back first. No two
    processes may write one folder at once.

    Raises:
      InputError: the folder cannot be written.
    """
    make_folder(folder.parent)
    try:
        for left in folder.parent.glob(f".{glob.escape(folder.name)}.*.folder"):
            if left.stem.endswith(".old") and not folder.exists():
                left.rename(folder)
            else:
                shutil.rmtree(left)
        part = Path(
            tempfile.mkdtemp(dir=folder.parent, prefix=f".{folder.name}.", suffix=".folder")
        )
        part.chmod(0o777 & ~_umask)
        try:
            yield part
            older = part.with_suffix(".old.folder")
            if folder.exists():
                folder.rename(older)
            part.rename(folder)
            shutil.rmtree(older, ignore_errors=True)
        finally:
            shutil.rmtree(part, ignore_errors=True)
    except OSError as error:
        raise InputError(f"cannot write {folder}: {error.strerror or error}") from error


def write_json(path: Path, content: typing.Any, indent: int | None = 2) -> None:
    """Writes `content` as JSON, completely or not at all.

    Args:
      indent: of nested values; None: all stands on one line.

    Raises:
      InputError: see `write_whole`.
    """
    text = json.dumps(content, indent=indent) + "\n"
    write_whole(path, lambda name: name.write_text(text, encoding="utf-8"))


def file_sha256(path: Path) -> str:
    """SHA-256 of a file's bytes, as hexadecimal digits.

    Raises:
      InputError: the file cannot be read.
    """
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}") from error
