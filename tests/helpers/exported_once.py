"""What takes seconds to make is made once a session, whichever process of it is first."""

import fcntl
import hashlib
import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path


def made_once(key: str, make: Callable[[Path], object]) -> Path:
    """What `make` writes into the path that it is given, at the first `key` of its kind only.

    Do not change it.
    """
    name = hashlib.sha256(key.encode()).hexdigest()[:16]
    made = Path(os.environ["PROXOPS_TESTS_FOLDER"]) / name
    with made.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not made.exists():
            part = made.with_suffix(".part")
            shutil.rmtree(part, ignore_errors=True)
            make(part)
            part.rename(made)
    return made


def exported_once(folder: Path, key: object, export: Callable[[Path], object]) -> Path:
    """Makes `folder` a copy of the bundle that `export` writes, once for each `key`."""
    made = made_once(repr(key), export)
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(made, folder)
    return folder


def copied(bundle: Path, folder: Path) -> Path:
    """A copy in `folder` that may be changed."""
    return Path(shutil.copytree(bundle, folder / "bundle"))


def change_json(path: Path, **changes: object) -> None:
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))
