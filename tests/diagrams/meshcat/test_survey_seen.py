"""The survey of a mission is the first chapter of its replay, and its log can be read again."""

import re
from pathlib import Path

import numpy as np
import pytest
from meshcat_pages import known, points_of
from synthetic_log import APPROACH, surveyed_log, synthetic_log

from proxops.diagrams.logs import FlightLog
from proxops.diagrams.meshcat import write_replay
from proxops.diagrams.meshcat.meshcat_page import PLAYBACK_SPEED
from proxops.diagrams.meshcat.survey_chapter import shown_times, survey_rows, with_survey_rows
from proxops.systems.common import InputError

UNIT = 100e3  # m for a unit of the picture.


@pytest.fixture(scope="module")
def log() -> FlightLog:
    return surveyed_log()


@pytest.fixture(scope="module")
def page(log: FlightLog, tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("survey") / "replay.html"
    write_replay(log, path)
    return path.read_text(encoding="utf-8")


def test_it_comes_before_the_flight_and_ends_where_that_begins(log: FlightLog) -> None:
    whole = with_survey_rows(log).dataset
    shown, count = shown_times(whole), survey_rows(whole)
    assert (np.diff(shown) > 0.0).all()
    assert 200 < count < 400
    assert whole["time"].values[0] == log.dataset["survey_time"].values[APPROACH]
    np.testing.assert_allclose(
        shown[count:] - shown[count], log.dataset["time"].values / PLAYBACK_SPEED
    )
    flown = whole.isel(time=slice(count, None))
    for name in ("state", "force", "decision", "ranges"):
        np.testing.assert_array_equal(flown[name], log.dataset[name])


def test_the_panel_has_its_chapter_and_counts_down(log: FlightLog, page: str) -> None:
    told = known(page)
    chapters = {name: at for at, name in told["chapters"]}
    assert list(chapters) == ["survey", "transit"]
    assert chapters["survey"] == told["shown"][0] == 0.0
    row = told["shown"].index(chapters["transit"])
    assert told["time"][row] == 0.0
    assert told["time"][0] == pytest.approx(float(log.dataset["survey_time"][APPROACH]), abs=0.01)
    names = [told["names"][str(who)][0] for who in told["who"]]
    assert {*names[:row]} == {"survey"}
    assert "survey" not in names[row:]
    assert re.search(r"160 times real time, its survey 1,79\d times", page)


def test_its_returns_lie_where_they_were_measured(page: str) -> None:
    """On a circle of 100 km; the last group has what was seen last."""
    distances = np.linalg.norm(points_of(page, "/survey/60"), axis=1)
    np.testing.assert_allclose(distances * UNIT, 100e3, rtol=2e-3)


def test_a_flight_alone_begins_at_once(log: FlightLog) -> None:
    flight = synthetic_log(60)
    assert with_survey_rows(flight) is flight
    np.testing.assert_array_equal(
        shown_times(flight.dataset), flight.dataset["time"] / PLAYBACK_SPEED
    )


def test_the_log_is_read_again(log: FlightLog, tmp_path: Path) -> None:
    log.to_netcdf(tmp_path / "flight.nc")
    assert FlightLog.load(tmp_path / "flight.nc").dataset.identical(log.dataset)


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("survey_frame", lambda values: values + 1),
        ("survey_ray", lambda values: -1 - values),
        ("survey_ray", lambda values: values + 0.5),
        ("survey_range", lambda values: values * np.nan),
        ("survey_time", lambda values: values + 1.0),
        ("survey_time", lambda values: values[::-1]),
    ],
)
def test_a_damaged_survey_is_refused(name: str, change, log: FlightLog, tmp_path: Path) -> None:
    data = log.dataset.assign({name: (log.dataset[name].dims, change(log.dataset[name].values))})
    FlightLog(data, log.body).to_netcdf(tmp_path / "flight.nc")
    with pytest.raises(InputError, match=f"wrong {name}"):
        FlightLog.load(tmp_path / "flight.nc")


def test_rays_that_the_lidar_has_not_are_refused(log: FlightLog, tmp_path: Path) -> None:
    wrong = log.dataset.assign(survey_ray=log.dataset["survey_ray"] + 4320)
    with pytest.raises(InputError, match=r"survey_ray is up to .*: the lidar has 4320 rays"):
        write_replay(FlightLog(wrong, log.body), tmp_path / "replay.html")
