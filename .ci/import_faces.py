"""Imports faces of proxops, and checks that each comes from one folder.

python import_faces.py FOLDER proxops.systems proxops.systems.lidar ...
"""

import importlib
import sys
from pathlib import Path

folder, *names = sys.argv[1:]
for name in names:
    file = Path(importlib.import_module(name).__file__ or "")
    if not file.is_relative_to(Path(folder).resolve()):
        sys.exit(f"{name} was imported from {file}, not from {folder}")
