"""The examples run, each in a folder of its own."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from pages import ROOT

# As they are, but for how many flights and steps of learning there are.
IN_BRIEF = {"COUNT = 8": "COUNT = 2", "range(6)": "range(1)", "range(301)": "range(101)"}
EXAMPLES = sorted((ROOT / "examples").glob("*.py"), key=lambda path: int(path.stem.split("_")[0]))


@pytest.mark.slow
@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_it_runs_and_writes_what_it_says(path: Path, tmp_path: Path) -> None:
    scripts = str(Path(sys.executable).parent)
    environment = os.environ | {
        "MPLBACKEND": "Agg",
        "PATH": f"{scripts}{os.pathsep}{os.environ['PATH']}",
    }
    code = path.read_text()
    for printed, brief in IN_BRIEF.items():
        code = code.replace(printed, brief)
    (tmp_path / path.name).write_text(code)
    done = subprocess.run(
        [sys.executable, path.name],
        cwd=tmp_path,
        env=environment,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout
    for name in re.findall(r"\"(\w+\.(?:png|html))\"", code):
        assert (tmp_path / name).stat().st_size > 1000
