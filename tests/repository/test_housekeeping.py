"""The repository keeps its own rules.

Dependencies are used and declared, functions are short, there is one list of folders.
"""

import ast
import json
import re
import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
FOLDERS = sorted(path.parent.name for path in ROOT.glob("*/__init__.py"))
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
# What a package is imported as, if it isn't its own name.
IMPORTED_AS = {"drake": "pydrake", "pillow": "PIL", "pyyaml": "yaml"}
# What is used without being imported, and the words by which.
USED_BY_NAME = {
    "h5netcdf": r'engine="h5netcdf"',
    "imageio-ffmpeg": r'needed\("imageio_ffmpeg", "movie"\)',
    "mcap": r'needed\("mcap\.writer", "exchange"\)',
    "oem": r'needed\("oem", "exchange"\)',
    "onnx": r"torch\.onnx\.export",
    "onnxscript": r"torch\.onnx\.export",
    "tensorboard": r"torch\.utils\.tensorboard|TensorBoardLogger",
}
# Of the extra `notebook`: what shows pictures under a cell has IPython wherever it is called.
IN_NOTEBOOKS_ONLY = {"IPython"}
LONGEST_FUNCTION = 80
# Longer functions, as `path: name`, and why each is allowed to be. At most ten.
LONGER_FUNCTIONS: dict[str, str] = {
    "cli/shape.py: shape_command": "most of it is its eighteen options, with a help text each",
    "systems/vehicle/rigid_spacecraft.py: rigid_rates": "number by number, for AutoDiffXd as well",
    "systems/vehicle/rigid_spacecraft.py: RigidSpacecraft_": "a class, as Drake wants templates",
}


def sources(*folders: str) -> Iterator[Path]:
    for folder in folders:
        yield from (ROOT / folder).rglob("*.py")


@cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text())


@cache
def imported(path: Path) -> set[str]:
    """Top-level names of all that a module imports, anywhere in it."""
    found = set()
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.Import):
            found |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.module is not None, f"{path} imports relatively"
            found.add(node.module.partition(".")[0])
    return found


def named(requirements: list[str]) -> list[str]:
    """The packages that requirements name."""
    return [re.split(r"[^\w-]", requirement, maxsplit=1)[0] for requirement in requirements]


CORE = named(PROJECT["dependencies"])
TRAIN = named(PROJECT["optional-dependencies"]["train"])
GYM = named(PROJECT["optional-dependencies"]["gym"])
CLUSTER = named(PROJECT["optional-dependencies"]["cluster"])
EXCHANGE = named(PROJECT["optional-dependencies"]["exchange"])
SPICE = named(PROJECT["optional-dependencies"]["spice"])


def test_every_dependency_is_used() -> None:
    text = "\n".join(path.read_text() for path in sources(*FOLDERS))
    names = set[str]().union(*(imported(path) for path in sources(*FOLDERS)))
    for package in [*CORE, *TRAIN, *GYM, *CLUSTER, *EXCHANGE, *SPICE]:
        if package in USED_BY_NAME:
            assert re.search(USED_BY_NAME[package], text), package
        else:
            assert IMPORTED_AS.get(package, package) in names


def test_what_is_imported_is_a_dependency() -> None:
    extras = {"training": TRAIN + GYM, "studies": TRAIN + GYM, "systems": SPICE}
    extras |= {"diagrams": CLUSTER}
    standard = {*sys.stdlib_module_names, "proxops", "mpl_toolkits"}  # The last is matplotlib's.
    for folder in FOLDERS:
        packages = [*CORE, *extras.get(folder, [])]
        allowed = {IMPORTED_AS.get(package, package) for package in packages} | standard
        for path in sources(folder):
            assert imported(path) - allowed - IN_NOTEBOOKS_ONLY == set(), path


def test_contracts_are_about_all_folders() -> None:
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]
    assert sorted(contracts["root_packages"]) == [
        f"proxops.{folder}" for folder in FOLDERS if folder != "front_door"
    ]


def test_folders_are_imported_as_proxops() -> None:
    """From the repository's root `import systems` would load a second copy of each module."""
    for path in sources(*FOLDERS, "benchmarks", "docs", "examples", "tests"):
        assert imported(path).isdisjoint(FOLDERS), path


def test_functions_are_short() -> None:
    """From the first line of `def` to the last, docstring included."""
    longer = set()
    for path in sources(*FOLDERS, "benchmarks", "docs", "examples"):
        for node in ast.walk(parsed(path)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                assert node.end_lineno is not None
                if node.end_lineno - node.lineno + 1 > LONGEST_FUNCTION:
                    longer.add(f"{path.relative_to(ROOT).as_posix()}: {node.name}")
    assert longer - set(LONGER_FUNCTIONS) == set(), "split these functions"
    assert set(LONGER_FUNCTIONS) - longer == set(), "these need no exception now: remove them"
    assert all(LONGER_FUNCTIONS.values())
    assert len(LONGER_FUNCTIONS) <= 10


def test_notebooks_are_cleared() -> None:
    found = sorted((ROOT / "notebooks").glob("*.ipynb"))
    assert found
    for path in found:
        code = [c for c in json.loads(path.read_text())["cells"] if c["cell_type"] == "code"]
        assert all(cell["outputs"] == [] for cell in code), path
        assert all(cell["execution_count"] is None for cell in code), path


def test_the_citation_is_of_this_version() -> None:
    cited = re.search(r"^version: (\S+)$", (ROOT / "CITATION.cff").read_text(), re.MULTILINE)
    assert cited is not None
    assert cited[1] == PROJECT["version"]


def test_the_conda_recipe_has_all_dependencies() -> None:
    """Each with the least version of pyproject.toml; some under conda's name."""
    recipe = (ROOT / "conda" / "meta.yaml").read_text()
    for wanted in PROJECT["dependencies"]:
        name, _, version = wanted.partition(">=")
        assert re.search(rf"{name}(-base)? ?>={re.escape(version)}\b", recipe), wanted
