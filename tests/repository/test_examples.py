"""The examples run as they are, each in a folder of its own, and stay short."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from pages import ROOT

EXAMPLES = sorted((ROOT / "examples").glob("*.py"), key=lambda path: int(path.stem.split("_")[0]))


@pytest.mark.slow
@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_it_runs_and_writes_what_it_says(path: Path, tmp_path: Path) -> None:
    scripts = str(Path(sys.executable).parent)
    environment = os.environ | {
        "MPLBACKEND": "Agg",
        "PATH": f"{scripts}{os.pathsep}{os.environ['PATH']}",
    }
    done = subprocess.run(
        [sys.executable, path],
        cwd=tmp_path,
        env=environment,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout
    for name in re.findall(r"\"(\w+\.(?:png|html))\"", path.read_text()):
        assert (tmp_path / name).stat().st_size > 1000
