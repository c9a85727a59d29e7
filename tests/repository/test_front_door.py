"""`import proxops` has what one begins with, takes no time, and is seen by editors."""

import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest

import proxops
from proxops.diagrams.flight import fly, fly_many
from proxops.diagrams.scenario import load_body, load_scenario
from proxops.studies.campaigns import evaluate


def test_its_names() -> None:
    assert proxops.fly is fly
    assert proxops.fly_many is fly_many
    assert proxops.load_body is load_body
    assert proxops.load_scenario is load_scenario
    assert proxops.evaluate is evaluate
    assert proxops.__version__ == metadata.version("proxops")
    assert {*proxops.__all__} <= {*dir(proxops)}


def test_another_name() -> None:
    with pytest.raises(AttributeError, match="'proxops' has no attribute 'flyy'"):
        _ = proxops.flyy  # pyright: ignore[reportAttributeAccessIssue]


def test_it_imports_nothing_that_is_slow() -> None:
    code = "import sys, proxops; print({'numpy', 'pydrake', 'numba', 'xarray'} & {*sys.modules})"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout == "set()\n"


def test_the_types_are_seen() -> None:
    """By PEP 561."""
    assert Path(proxops.__file__).with_name("py.typed").is_file()
