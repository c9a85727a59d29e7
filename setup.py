"""Which packages there are. Everything else about the distribution is in pyproject.toml.

The folder `front_door` is `proxops` itself, and each other top-level folder with an `__init__.py`
is a subpackage of it; each folder below that with an `__init__.py` is one of its rooms.
"""

from pathlib import Path

from setuptools import setup

ROOT = Path(__file__).parent
FRONT_DOOR = ROOT / "front_door"
FOLDERS = sorted({path.parent for path in ROOT.glob("*/__init__.py")} - {FRONT_DOOR})

setup(
    packages=["proxops"]
    + [
        ".".join(["proxops", *path.parent.relative_to(ROOT).parts])
        for folder in FOLDERS
        for path in sorted(folder.rglob("__init__.py"))
    ],
    package_dir={"proxops": FRONT_DOOR.name}
    | {f"proxops.{folder.name}": folder.name for folder in FOLDERS},
)
