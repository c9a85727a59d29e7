"""The examples run, each in a folder of its own."""

import os
import re
import sys
from pathlib import Path

import pytest
from pages import ROOT
from scripts import run_script

# As they are, but for how many flights, steps of learning and seconds of some flights there are.
IN_BRIEF = {
    "COUNT = 8": "COUNT = 2", "range(6)": "range(1)", "range(301)": "range(101)",
    "load_scenario(transit=1": 'load_scenario(None, {"arrival.deadline_s": 500}, transit=1',
    "load_scenario(spacecraft": 'load_scenario(None, {"arrival.deadline_s": 500}, spacecraft',
}  # fmt: skip
EXAMPLES = sorted((ROOT / "examples").glob("*.py"), key=lambda path: int(path.stem.split("_")[0]))


@pytest.mark.slow
@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_it_runs_and_writes_what_it_says(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    scripts = str(Path(sys.executable).parent)
    monkeypatch.setenv("PATH", f"{scripts}{os.pathsep}{os.environ['PATH']}")
    code = path.read_text()
    for printed, brief in IN_BRIEF.items():
        code = code.replace(printed, brief)
    (tmp_path / path.name).write_text(code)
    run_script(tmp_path / path.name)
    assert capfd.readouterr().out
    for name in re.findall(r"\"(\w+\.(?:png|html))\"", code):
        assert (tmp_path / name).stat().st_size > 1000
