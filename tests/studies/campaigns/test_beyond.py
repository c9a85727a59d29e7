"""What goes beyond the paper: the list of campaigns, how they resume, and what is told of them."""

import dataclasses as dc
import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from short_flights import BRIEF, short_scenario, write_blob

from proxops.diagrams.flight import Workers, named_controller
from proxops.diagrams.scenario import (
    MissionConfig,
    Scenario,
    SurveyConfig,
    TouchAndGoConfig,
    dump_scenario,
    load_body,
    load_scenario,
)
from proxops.studies.campaigns import BODIES, PARTS, Campaign, Variant, all_campaigns
from proxops.studies.campaigns.flying import _inputs, campaign_scenario
from proxops.studies.reproduction import chosen_campaigns, fly_and_tell, own_bodies, success_lines
from proxops.systems import InputError
from proxops.systems.policy import PolicyConfig


def small(name: str, **changes: Any) -> Campaign:
    """Two flights each without control and with the MPC."""
    flown = [Variant("mpc", "mpc"), Variant("zero", "zero")]
    return dc.replace(Campaign(name, "worlds", name.upper(), "Told all.", flown, 2), **changes)


def brief() -> Scenario:
    return short_scenario(**BRIEF, log_ranges=False)


# --- the list -------------------------------------------------------------------------------------


def test_nobody_sees_the_truth_unless_it_is_said() -> None:
    for each in all_campaigns():
        told = [change for change in each.changes if "TrueState" in change]
        assert bool(told) == each.true_state == (each.name == "true-state")


def test_scenarios_that_ship_are_flown_as_they_are(tmp_path: Path) -> None:
    """But for what the campaign says, and with one place of all touches."""
    known = {each.name: each for each in all_campaigns()}
    assert {each.part for each in known.values()} == set(PARTS)
    assert len(known) == len(all_campaigns())

    def flown(name: str) -> Scenario:
        shared = Scenario(log_ranges=False, gravity="table")
        return campaign_scenario(known[name], shared, tmp_path)

    ryugu = load_scenario("ryugu", dispersions="after_survey", log_ranges=False)
    assert flown("real-ryugu") == ryugu
    assert flown("rigid-after-survey").is_rigid
    survey, mission, touch = map(flown, ("map-bennu", "bennu-mission", "touch-learned"))
    assert isinstance(survey.task, SurveyConfig)
    assert survey.dispersions == "approach"
    assert isinstance(mission.task, MissionConfig)
    assert isinstance(touch.task, TouchAndGoConfig)
    assert touch.task.site is not None


def test_the_papers_recipe_must_be_trained_first() -> None:
    with pytest.raises(InputError, match=r"train it first: proxops reproduce paper$"):
        chosen_campaigns(["paper-recipe"], all_campaigns())
    (papers,) = chosen_campaigns(["paper-recipe"], all_campaigns(Path("recipe")))
    assert papers.name == "paper-recipe"


@pytest.mark.parametrize("key", ["margin_m", "beyond_family"])
def test_how_a_policy_flies_counts_and_where_it_lies_does_not(key: str, tmp_path: Path) -> None:
    """What was flown with another margin is flown anew; the usual inputs are as they were."""
    body = load_body("kleopatra")

    def inputs(policy: PolicyConfig) -> dict[str, Any]:
        return _inputs(small("one"), Scenario(policy=policy), body)

    usual = inputs(PolicyConfig())
    assert usual["scenario"] == dump_scenario(Scenario(policy=PolicyConfig(), body=""))
    assert inputs(PolicyConfig(bundle=str(tmp_path))) == usual
    changed: Any = {"margin_m": 500.0, "beyond_family": True}
    assert inputs(PolicyConfig(**{key: changed[key]})) != usual


# --- bodies ---------------------------------------------------------------------------------------


def test_own_bodies(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no body's YAML file; proxops shape FILE --body"):
        own_bodies(tmp_path)
    path = write_blob(tmp_path)
    assert [str(each) for each in own_bodies(tmp_path)] == [path]
    (tmp_path / "more.yml").write_text("name: [")
    with pytest.raises(InputError, match=r"more\.yml"):
        own_bodies(tmp_path)


@pytest.mark.parametrize("name", ["blob.yml", "22-0.yaml"])
def test_bodies_of_one_name_are_refused(tmp_path: Path, name: str) -> None:
    """Their campaigns would be one; 22:0 is generated."""
    shutil.copy(write_blob(tmp_path), tmp_path / name)
    with pytest.raises(InputError, match="rename the file"):
        own_bodies(tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("body", BODIES)
def test_the_policy_takes_all_bodies(body: str, tmp_path: Path) -> None:
    scenario = campaign_scenario(small("at", body=body), Scenario(gravity="table"), tmp_path)
    assert scenario.gravity == "table"
    assert Path(scenario.body).is_relative_to(tmp_path)
    named_controller("policy", scenario, load_body(scenario.body))  # Raises if it refuses.


# --- flights --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """The first of two known campaigns was flown."""
    out = tmp_path_factory.mktemp("beyond")
    known = [small("first"), small("second")]
    return out, fly_and_tell(known, known[:1], brief(), out, workers=Workers(1))


@pytest.mark.slow
def test_figures_are_those_of_the_flights(told: tuple[Path, dict[str, Any]]) -> None:
    out, content = told
    assert json.loads((out / "results.json").read_text()) == content
    (folder,) = out.glob("first-*")
    for name, figures in content["campaigns"]["first"]["controllers"].items():
        paths = folder.glob(f"{name}-25000-*.json")
        flights = [json.loads(path.read_text())["summary"] for path in paths]
        assert figures["transits"] == len(flights) == 2
        assert figures["min_clearance_m"] == pytest.approx(
            min(flight["min_clearance_m"] for flight in flights), rel=1e-5
        )
        assert "flights" not in figures
    assert success_lines(content)[0][0] == "FIRST: mpc"


@pytest.mark.slow
def test_who_refuses_is_told_and_the_others_fly(tmp_path: Path) -> None:
    """The policy did not learn to hold a force that long."""
    slow = {"control_period_s": 1800.0}
    flown = [Variant("zero", "zero"), Variant("policy", "policy", slow)]
    known = [small("at", body="22:7", variants=flown)]
    scenario = Scenario(log_ranges=False)
    content = fly_and_tell(known, known, scenario, tmp_path, workers=Workers(1))
    entry = content["campaigns"]["at"]
    assert list(entry["controllers"]) == ["zero"]
    assert "period is" in entry["refused"]["policy"]
    assert "policy refuses to fly: " in (tmp_path / "report.md").read_text()


@pytest.mark.slow
def test_run_again_it_flies_only_what_is_new(
    told: tuple[Path, dict[str, Any]], tmp_path: Path
) -> None:
    out, before = told
    stamps = {path: path.stat().st_mtime_ns for path in out.glob("first-*/*")}
    assert len(stamps) >= 4
    known = [small("first"), small("second", dispersions="after_survey")]
    content = fly_and_tell(known, known, brief(), out, workers=Workers(1))
    assert {path: path.stat().st_mtime_ns for path in out.glob("first-*/*")} == stamps
    assert content["campaigns"]["first"] == before["campaigns"]["first"]
    assert content["campaigns"]["second"]["dispersions"] == "after_survey"
    (folder,) = out.glob("second-*")
    worlds = [
        json.loads(path.read_text())["summary"]["dispersed"] for path in folder.glob("zero-*.json")
    ]
    assert len(worlds) == 2
    assert worlds[0] != worlds[1]
