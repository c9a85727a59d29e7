"""Many surveys and missions: each is flown once, and one that ends early is counted as it is."""

import dataclasses as dc
import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from proxops.cli.main import app
from proxops.diagrams import surveys
from proxops.diagrams.flight import Workers
from proxops.diagrams.logs import FlightLog
from proxops.diagrams.scenario import Body, Scenario, SurveyConfig, load_scenario
from proxops.studies.campaigns import Variant, all_campaigns, fly_tasks, makes_a_map
from proxops.studies.figures import aggregate_all, figure_rows
from proxops.studies.reproduction import fly_and_tell
from proxops.systems.common import InputError
from proxops.systems.mapping import matched

FIGURES = {
    "map_rms_of_size": 3e-4, "within_3_sigma": 0.999, "gravity_error": -2e-3, "rate_error": 1e-6,
    "pole_error_deg": 0.01, "hours": 20.0, "delta_v_m_s": 12.0, "keep_out_entries": 0,
    "collided": False, "flight_s": 20.0, "estimation_s": 30.0,
}  # fmt: skip
SURVEY = [Variant("survey", "survey")]


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Numbers of the surveys that are flown; number 1 sees too little."""
    numbers: list[int] = []

    def survey(scenario: Scenario, body: Body, folder: Path, estimator: str) -> Any:
        assert estimator == "survey"
        number = scenario.transit.index
        numbers.append(number)
        if number == 1:
            raise InputError("the survey saw 60 % of the surface")
        world = SimpleNamespace(scenario=dc.replace(scenario, dispersed=["truth.gravity"]))
        figures = FIGURES | {"keep_out_entries": int(number == 2)}
        return SimpleNamespace(figures=figures, flight=SimpleNamespace(world=world))

    monkeypatch.setattr(surveys, "run_survey", survey)
    return numbers


def survey(hours: float = 20.0) -> Scenario:
    return dc.replace(load_scenario(), task=SurveyConfig(hours=hours), dispersions="first_look")


def test_each_is_flown_once(tmp_path: Path, asked: list[int]) -> None:
    told: list[str] = []
    workers = Workers(1, progress=lambda done, text: told.append(text))
    rows = fly_tasks(SURVEY, survey(), 5, 3, tmp_path, workers)["survey"]
    assert asked == [0, 1, 2]
    assert told[-1] == "3 of 3, 2 without success"
    assert [row["success"] for row in rows] == [True, False, False]
    assert [row["transit"] for row in rows] == [0, 1, 2]
    assert rows[0]["survey_gravity_error"] == 2e-3
    assert rows[0]["dispersed"] == {"truth.gravity": 1.0}
    assert rows[1]["ended_early"] == "the survey saw 60 % of the surface"
    assert fly_tasks(SURVEY, survey(), 5, 4, tmp_path, Workers(1))["survey"][:3] == rows
    assert asked == [0, 1, 2, 3]
    with pytest.raises(InputError, match=r"row\.json is of another scenario"):
        fly_tasks(SURVEY, survey(hours=30.0), 5, 1, tmp_path, Workers(1))


def test_figures_of_surveys_are_no_flights(tmp_path: Path, asked: list[int]) -> None:
    rows = fly_tasks(SURVEY, survey(), 5, 3, tmp_path, Workers(1))
    [result] = aggregate_all(rows).values()
    shown = {row.label: row.cells[0] for row in figure_rows({"survey": result}, None)}
    assert shown["success"] == "1 of 3"
    assert shown["ended early"] == "1"
    assert shown["map, rms over the size (%)"] == "0.03"
    assert shown["surface within 3 sigma, least (%)"] == "99.9"
    assert "distance to the goal at the end (m)" not in shown
    assert "touched" not in shown
    assert result.successes_2km is None
    assert result.keep_out_violations == 1


def test_what_makes_a_map() -> None:
    assert makes_a_map(survey())
    assert makes_a_map(load_scenario("bennu_mission"))
    assert not makes_a_map(load_scenario("bennu_touch_and_go"))


def test_surveys_by_the_command(tmp_path: Path, asked: list[int]) -> None:
    words = ["evaluate", "kleopatra", "--set", "task=!Survey {}", "--transits", "2", "--seed", "5"]
    app([*words, "--workers", "1", "--out", str(tmp_path)], standalone_mode=False)
    found = json.loads((tmp_path / "results.json").read_text())["controllers"]
    assert found["survey"]["successes"] == 1
    assert "the survey saw 60 % of the surface" in (tmp_path / "report.md").read_text()
    row = json.loads((tmp_path / "flights/survey-5-00000/row.json").read_text())
    assert "dispersions: first_look" in row["task"]["scenario"]


def test_a_part_of_the_evidence(tmp_path: Path, asked: list[int]) -> None:
    (known,) = (each for each in all_campaigns() if each.name == "map-kleopatra")
    wanted = [dc.replace(known, transits=3)]
    content = fly_and_tell(wanted, wanted, Scenario(), tmp_path, workers=Workers(1))
    entry = content["campaigns"]["map-kleopatra"]
    assert entry["controllers"]["survey"]["successes"] == 1
    assert entry["controllers"]["survey"]["ended_early"] == 1
    told = (tmp_path / "report.md").read_text()
    assert "proxops reproduce map-kleopatra" in told
    assert "map, rms over the size (%)" in told
    fly_and_tell(wanted, wanted, Scenario(), tmp_path, workers=Workers(1))
    assert asked == [0, 1, 2]


@pytest.mark.slow
@pytest.mark.filterwarnings("default")
def test_a_mission(tmp_path: Path) -> None:
    mission = ["evaluate", "bennu_mission", "--dispersions", "mission", "--controllers", "hybrid"]
    given = ["--transits", "1", "--seed", "6200", "--workers", "1", "--out", str(tmp_path)]
    app([*mission, *given], standalone_mode=False)
    [summary] = json.loads((tmp_path / "results.json").read_text())["controllers"]["hybrid"][
        "flights"
    ]
    assert summary["success"]
    assert summary["touched"]
    assert summary["touch_miss_m"] < 5.0
    assert summary["policy_share"] > 0.5
    assert summary["survey_map_rms_of_size"] < 5e-4
    assert summary["survey_keep_out_entries"] == 0
    assert (tmp_path / "worst/hybrid-00000.html").is_file()
    assert "worst/hybrid-00000.html" in (tmp_path / "report.html").read_text()
    # What the survey measured lies on the true surface, but for returns that are false.
    log = FlightLog.load(tmp_path / "flights/hybrid-6200-00000/flight.nc")
    data, row = log.dataset, log.dataset["survey_frame"].values
    turns = Rotation.from_quat(data["survey_attitude"].values[row], scalar_first=True)
    along = turns.apply(log.scenario.lidar_geometry.directions[data["survey_ray"].values])
    points = data["survey_state"].values[row, :3] + data["survey_range"].values[:, None] * along
    shape = log.true_body.shape
    off = np.abs(matched(points[::50], shape.vertices, shape.facets).heights)
    assert np.percentile(off, 75.0) < 1.0
    np.testing.assert_allclose(data["survey_state"][-1], data["state"][0], rtol=1e-12)
