"""Stages: done once for the same inputs, anew for others, gone on with when interrupted."""

import json
from pathlib import Path
from typing import Any

import pytest

from proxops.studies.campaigns.stages import Progress, Stages
from proxops.studies.reproduction.paper_report import stage_table
from proxops.systems import InputError


class Work:
    """Notes the folders that it was called with; fails the first `failures` times."""

    def __init__(self, failures: int = 0):
        self.folders: list[Path] = []
        self.failures = failures

    def __call__(self, folder: Path, tell: Progress) -> dict[str, Any]:
        self.folders.append(folder)
        if len(self.folders) <= self.failures:
            raise KeyboardInterrupt
        return {"calls": len(self.folders), "pair": (1, 2)}


def test_same_inputs_are_not_worked_on_again(tmp_path: Path) -> None:
    work = Work()
    first = Stages(tmp_path).run("fly", {"seed": 1, "gate": "strict"}, work)
    assert (first.skipped, first.result) == (False, {"calls": 1, "pair": [1, 2]})
    again = Stages(tmp_path).run("fly", {"gate": "strict", "seed": 1}, work)
    assert (again.skipped, again.result, again.folder) == (True, first.result, first.folder)
    assert again.wall_s == first.wall_s
    assert len(work.folders) == 1


def test_interrupted_stage_finds_its_folder(tmp_path: Path) -> None:
    work = Work(failures=1)
    with pytest.raises(KeyboardInterrupt):
        Stages(tmp_path).run("fly", {}, work)
    assert Stages(tmp_path).latest("fly") is None
    stage = Stages(tmp_path).run("fly", {}, work)
    assert work.folders == [stage.folder] * 2
    assert not stage.skipped


@pytest.mark.parametrize("content", ["", "[]", json.dumps({"result": {}})])
def test_damaged_record(tmp_path: Path, content: str) -> None:
    stage = Stages(tmp_path).run("fly", {}, Work())
    (tmp_path / "stages" / f"{stage.folder.name}.json").write_text(content)
    with pytest.raises(InputError, match="is not the record of a stage"):
        Stages(tmp_path).run("fly", {}, Work())


def test_the_latest_may_have_to_be_of_this_version(tmp_path: Path) -> None:
    stages = Stages(tmp_path)
    stages.run("fly", {"seed": 1}, Work())
    (record,) = (tmp_path / "stages").glob("fly-*.json")
    assert stages.latest("fly") is not None
    content = json.loads(record.read_text())
    content["inputs"]["proxops"] = "0.0.1"
    record.write_text(json.dumps(content))
    assert stages.latest("fly") is None
    found = stages.latest("fly", any_version=True)
    assert found is not None
    assert found.version == "0.0.1"
    table = stage_table([found, stages.run("now", {}, Work())])
    assert [line[-1] for line in table.lines] == ["before, by proxops 0.0.1", "now"]


def test_what_ended_is_found_by_its_inputs(tmp_path: Path) -> None:
    stages = Stages(tmp_path)
    assert stages.ended("fly", {"seed": 1}) is None
    made = stages.run("fly", {"seed": 1, "pair": (1, 2)}, Work())
    stages.run("fly", {"seed": 2}, Work())
    found = stages.ended("fly", {"pair": [1, 2], "seed": 1})
    assert found is not None
    assert (found.folder, found.result, found.skipped) == (made.folder, made.result, True)
    assert stages.ended("fly", {"seed": 3}) is None
