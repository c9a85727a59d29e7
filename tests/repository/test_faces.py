"""The faces of folders and rooms export what is there, and cost no torch before it is needed."""

import importlib
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FACES = sorted(
    ".".join(["proxops", *path.parent.relative_to(ROOT).parts])
    for folder in ("systems", "diagrams", "training", "studies")
    for path in (ROOT / folder).rglob("__init__.py")
)
ROOMS = [name for name in FACES if name.count(".") == 2]
# All that needs no PyTorch: flying, its data, its evaluation.
WITHOUT_TORCH = [
    *(name for name in FACES if name.startswith(("proxops.systems", "proxops.diagrams"))),
    "proxops.training.data",
    "proxops.training.reports",
    "proxops.studies.figures",
    "proxops.studies.campaigns",
    "proxops.studies.report",
    "proxops.studies.reproduction",
]


@pytest.mark.parametrize("name", [*ROOMS, "proxops.systems"])
def test_everything_exported_is_there(name: str) -> None:
    face = importlib.import_module(name)
    assert face.__all__ == sorted(set(face.__all__), key=face.__all__.index)
    assert all(hasattr(face, each) for each in face.__all__)


@pytest.mark.parametrize("name", ["systems", "diagrams", "training", "studies"])
def test_no_exported_name_hides_a_module(name: str) -> None:
    """Or `import proxops.FOLDER.ROOM.MODULE as m` would give a function."""
    for room in (room for room in ROOMS if room.startswith(f"proxops.{name}.")):
        face = importlib.import_module(room)
        folder = Path(face.__file__ or "").parent
        modules = {path.stem for path in folder.glob("*.py")} - {"__init__"}
        assert modules & set(face.__all__) == set(), room


def test_what_is_slow_to_import_waits_until_it_is_needed() -> None:
    """By the commands, which start without it; and PyTorch by all that flies and evaluates."""
    slow = ["matplotlib", "onnxruntime", "proxops.systems.mapping", "scipy.interpolate"]
    slow += ["scipy.ndimage", "scipy.stats", "torch", "trimesh"]
    code = (
        "import gc, sys; from proxops.cli.main import COMMANDS, command\n"
        f"[*map(command, COMMANDS)]; print([x for x in {slow} if x in sys.modules])\n"
        "import proxops.studies.campaigns  # As each worker of `evaluate` does.\n"
        "print('matplotlib' in sys.modules, gc.isenabled())\n"
        f"import {', '.join(WITHOUT_TORCH)}; print('torch' in sys.modules)"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout == "[]\nFalse True\nFalse\n"


def test_one_system_alone_needs_little() -> None:
    slow = ["numba", "pydrake.multibody", "pydrake.perception", "scipy.linalg", "scipy.spatial"]
    code = f"import sys, proxops.systems; print([x for x in {slow} if x in sys.modules])"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout == "[]\n"
