"""Which packages there are. Everything else about the distribution is in pyproject.toml.

Each top-level folder with an `__init__.py` is a subpackage of `proxops`, a namespace package that
has no folder of its own; each folder below it with an `__init__.py` is one of its rooms.
"""

from pathlib import Path

from setuptools import setup

ROOT = Path(__file__).parent
FOLDERS = sorted(path.parent for path in ROOT.glob("*/__init__.py"))

setup(
    packages=[
        ".".join(["proxops", *path.parent.relative_to(ROOT).parts])
        for folder in FOLDERS
        for path in sorted(folder.rglob("__init__.py"))
    ],
    package_dir={f"proxops.{folder.name}": folder.name for folder in FOLDERS},
)
