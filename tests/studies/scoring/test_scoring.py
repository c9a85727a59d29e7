"""The benchmark that stays: tracks against what is drawn today, rows against the flights."""

import dataclasses as dc
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import proxops
from scipy.stats import beta

from proxops.diagrams.flight import Flight, Workers, fly
from proxops.diagrams.scenario import SurveyConfig, load_scenario, of_transit
from proxops.studies.campaigns import TaskRun
from proxops.studies.scoring import (
    TRACKS,
    ScoreRow,
    Track,
    draw_track,
    load_row,
    load_track,
    row_table,
    save_row,
    save_track,
    score,
    with_expert,
)
from proxops.studies.scoring.row import Outcome
from proxops.systems import InputError

ROOT = Path(__file__).parents[3]
SEED = 22000
# Over after a few steps, wherever it is then.
SHORT = {"arrival.deadline_s": 30.0, "arrival.dwell_s": 20.0, "log_ranges": False}


@pytest.fixture(scope="module")
def brief() -> Track:
    return draw_track("brief", load_scenario(None, SHORT, on_true_state=True), 3, 2)


def outcome(**changes: Any) -> Outcome:
    good: dict[str, Any] = {"success": True, "collided": False, "keep_out_violations": 0}
    good |= {"delta_v_m_s": 100.0, "terminal_position_error_m": 10.0, "arrival_time_s": 5000.0}
    return Outcome(**good | changes)


def row_of(track: Track, name: str, *flights: Outcome) -> ScoreRow:
    return ScoreRow(name, "mine:make", "proxops 1", track.name, track.sha256, flights)


def values(flight: Flight) -> dict[str, object]:
    """All values of a flight's scenario. Between processors they may differ in last bits."""

    def leaves(tree: object, key: str) -> dict[str, object]:
        if isinstance(tree, dict | list):
            parts = tree.items() if isinstance(tree, dict) else enumerate(tree)
            return {k: v for name, part in parts for k, v in leaves(part, f"{key}.{name}").items()}
        return {key: tree}

    return leaves(dc.asdict(flight.scenario), "")


# --- tracks ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", TRACKS)
def test_tracks_are_what_was_drawn(name: str) -> None:
    """Today's code still draws their first transits; should it not, the tracks stay as they are."""
    track, many = load_track(name), {"touch": 40, "mission": 20, "survey": 20}.get(name, 200)
    assert (track.name, track.sha256, len(track.changes)) == (name, TRACKS[name], many)
    of_track = {"lidar-after-survey": "after_survey", "touch": "touch_and_go"}
    of_track["survey"] = "first_look"
    settings: dict[str, Any] = {"log_ranges": False}
    if name in of_track:
        settings["dispersions"] = of_track[name]
    if name == "mission":  # Since 1.23 missions park, and their surveys may last longer.
        settings["task.phases"] = ["survey", "transit", "touch_and_go"]
        settings["task.survey.hours"] = 24.0
    file = {"touch": "bennu_touch_and_go", "mission": "bennu_mission"}.get(name)
    given = load_scenario(file, settings, on_true_state=name == "state")
    if name == "survey":
        given = dc.replace(given, task=SurveyConfig())
    drawn = draw_track(name, given, SEED + 1 if name == "survey" else SEED, 2)
    assert drawn.body_sha256 == track.body_sha256
    kept = dc.replace(track, changes=track.changes[:2], drawn=track.drawn[:2])
    for one, other in zip(drawn.flights("zero"), kept.flights("zero"), strict=True):
        expected = values(other)
        # Since 1.14 a rigid spacecraft is told its star tracker's error, since 1.15 its noise, and
        # since 1.17 a point its least impulse; since 1.18 a touch-and-go has a hybrid's gate, and
        # since 1.19 it is told what each thruster has of its own.
        attitude = ("attitude_deg", "attitude_noise_deg", "attitude_noise_correlation_s")
        own = ("thrust_varying", "thruster", "thruster_direction_deg")
        parts = {"touch": (*attitude, *own), "lidar-after-survey": ("least_impulse_n_s",)}.get(
            name, ()
        )
        keys = [f".navigation.expected.{part}" for part in parts]
        keys += [".hybrid.epsilon_magnitude_n", ".hybrid.dead_band_n"] if name == "touch" else []
        told = {key: expected[key] for key in keys}
        assert values(one) | told == pytest.approx(expected)
    assert len({json.dumps(change, sort_keys=True) for change in track.changes}) == many


def test_a_mission_draws_what_is_written_down(tmp_path: Path) -> None:
    track = load_track("mission")
    drawn = [{**track.drawn[0], "truth.gravity": 1.0}, *track.drawn[1:]]
    with pytest.raises(InputError, match="this version of proxops draws other worlds"):
        dc.replace(track, drawn=drawn).flights("hybrid")
    save_track(track, tmp_path / "mission.json")
    assert load_track(str(tmp_path / "mission.json")) == track


def test_a_row_of_missions(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One that touched, and one whose survey saw too little."""
    flown = {"success": True, "collided": False, "touched": True, "safe": True}
    flown |= {"delta_v_m_s": 2.5, "mission_delta_v_m_s": 2.6, "touch_miss_m": 0.3}
    flown |= {"arrival_time_s": 5000.0, "terminal_position_error_m": 1.0}
    early = {"success": False, "ended_early": "the survey saw 60 % of the surface"}

    def row(run: TaskRun) -> dict[str, Any]:
        return {"transit": run.scenario.transit.index, **(early if run.name[-1] == "1" else flown)}

    monkeypatch.setattr(TaskRun, "row", row)
    track = load_track("mission")
    short = dc.replace(track, changes=track.changes[:2], drawn=track.drawn[:2])
    found = score(short, "hybrid", tmp_path, workers=Workers(1)).flights
    assert found == [
        Outcome(True, False, 0, 2.6, 0.3, 5000.0), Outcome(False, False, 0, 0.0, 0.0, None)
    ]  # fmt: skip


def test_a_row_of_surveys(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A good one, one too rough, one that is surer than it is, and one that saw too little."""
    good = {"success": True, "collided": False, "keep_out_violations": 0}
    good |= {"survey_map_rms_of_size": 2e-4, "survey_within_3_sigma": 0.999, "survey_hours": 20.0}
    good |= {"survey_length_m": 2e5, "survey_delta_v_m_s": 25.0}
    rows = [good, good | {"survey_map_rms_of_size": 7e-4}, good | {"survey_within_3_sigma": 0.9}]
    rows.append({"success": False, "ended_early": "the survey saw 60 % of the surface"})

    def row(run: TaskRun) -> dict[str, Any]:
        index = int(run.name[-1])
        assert run.controller == "own_map:estimate"
        return {"transit": index, **rows[index]}

    monkeypatch.setattr(TaskRun, "row", row)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own_map.py").write_text("def estimate(returns, around, expected, progress): ...")
    track = load_track("survey")
    short = dc.replace(track, changes=track.changes[:4], drawn=track.drawn[:4])
    found = score(short, "own_map:estimate", tmp_path / "out", workers=Workers(1)).flights
    assert found == [
        Outcome(True, False, 0, 25.0, 40.0, 72000.0),
        Outcome(False, False, 0, 25.0, 140.0, 72000.0),
        Outcome(False, False, 0, 25.0, 40.0, 72000.0),
        Outcome(False, False, 0, 0.0, 0.0, None),
    ]


def test_flights_are_those_of_the_seed(brief: Track, tmp_path: Path) -> None:
    row = score(brief, "pd", tmp_path, workers=Workers(1))
    scenario = load_scenario(None, SHORT, on_true_state=True)
    for number, flight in enumerate(row.flights):
        summary = fly(of_transit(scenario, 3, number), "pd").summary
        assert flight.delta_v_m_s == pytest.approx(summary["delta_v_m_s"], abs=1e-4)
        assert flight.terminal_position_error_m == pytest.approx(
            summary["terminal_position_error_m"], abs=0.01
        )
    assert score(brief, "pd", tmp_path, workers=Workers(1)) == row
    assert len(list(tmp_path.glob("*.json"))) == 2


def test_a_world_that_cannot_be_flown_is_named(brief: Track, tmp_path: Path) -> None:
    heavy = dc.replace(brief, changes=[brief.changes[0], {**brief.changes[1], "truth.mass": 20.0}])
    with pytest.raises(InputError, match="track brief: transit 1 cannot be flown: hovering at"):
        score(heavy, "zero", tmp_path, workers=Workers(1))


def test_tracks_that_were_changed(
    brief: Track, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "brief.json"
    save_track(brief, path)
    assert load_track(str(path)) == brief
    other = dc.replace(brief, body_sha256="0" * 64)
    assert other.sha256 != brief.sha256
    with pytest.raises(InputError, match="the body kleopatra is not the one of the track"):
        other.flights("zero")
    with pytest.raises(InputError, match="no track 'nowhere': name one of state, lidar, "):
        load_track("nowhere")
    fields = dc.asdict(brief)
    for wrong in (
        {"changes": []}, {"changes": 5}, {"changes": [1]}, {"scenario": 3},
        {"expert_delta_v_m_s": [50.0]}, {"expert_delta_v_m_s": 50.0},
        {"expert_delta_v_m_s": [50.0, "none"]},
    ):  # fmt: skip
        path.write_text(json.dumps(fields | wrong))
        with pytest.raises(InputError, match=r"brief\.json is not a track"):
            load_track(str(path))
    path.write_text("{}")
    with pytest.raises(InputError, match=r"brief\.json is not a track"):
        load_track(str(path))
    monkeypatch.setitem(TRACKS, "state", "0" * 64)
    with pytest.raises(InputError, match="not the track 'state' any more: its hash is"):
        load_track("state")


@pytest.mark.parametrize("name", TRACKS)
def test_what_the_mpc_took_is_what_its_row_says(name: str) -> None:
    """The lists that ship are of 0.10.0, whose MPC did not arrive in transit 181; the rows of
    0.11.0, which does."""
    track = load_track(name)
    file = "survey-survey" if name == "survey" else f"{name}-mpc"
    row = load_row(ROOT / "docs" / "benchmark" / f"{file}.json")
    found = with_expert(track, row)
    kept = list(track.expert_delta_v_m_s)
    if name not in ("touch", "mission", "survey"):
        assert kept[181] is None
        kept[181] = found.expert_delta_v_m_s[181]
    assert found.expert_delta_v_m_s == kept
    assert found == dc.replace(track, expert_delta_v_m_s=kept)


def test_of_what_did_not_succeed_nothing_is_taken(brief: Track) -> None:
    row = row_of(brief, "mpc", outcome(delta_v_m_s=80.0), outcome(success=False))
    found = with_expert(brief, row)
    assert found.expert_delta_v_m_s == [80.0, None]
    assert found.sha256 != brief.sha256
    with pytest.raises(InputError, match="'mpc' is not of the track 'brief' as it is"):
        with_expert(found, row)


# --- rows -----------------------------------------------------------------------------------------


def test_figures(brief: Track) -> None:
    track = dc.replace(brief, expert_delta_v_m_s=[50.0, None, 80.0, 40.0])
    flights = [
        outcome(terminal_position_error_m=30.0),
        outcome(arrival_time_s=5600.0),
        outcome(success=False, collided=True, keep_out_violations=2),
        outcome(success=False, keep_out_violations=1),
    ]
    figures = row_of(track, "mine", *flights).figures(track)
    assert (figures.transits, figures.successes, figures.violations) == (4, 2, 2)
    # Only in the first did both succeed.
    assert figures.delta_v_ratio == 2.0
    assert (figures.error_m, figures.time_s) == (20.0, 5300.0)
    expected = (beta.ppf(0.025, 2, 3), beta.ppf(0.975, 3, 2))
    np.testing.assert_allclose(figures.interval, expected)
    with pytest.raises(InputError, match="'mine' is not of the track 'brief' as it is"):
        row_of(track, "mine", *flights).figures(brief)


def test_of_a_touch_its_miss_and_its_end_count() -> None:
    summary: Any = {"success": False, "collided": False, "keep_out_violations": 1, "safe": True}
    summary |= {"touched": True, "touch_miss_m": 0.3, "delta_v_m_s": 1.5}
    summary |= {"terminal_position_error_m": 4.0, "arrival_time_s": 2000.0}
    assert Outcome.of(summary) == Outcome(False, False, 0, 1.5, 0.3, 2000.0)
    del summary["touch_miss_m"]
    assert Outcome.of(summary | {"touched": False, "safe": False}) == Outcome(
        False, False, 1, 1.5, 4.0, 2000.0
    )


def test_table_is_best_first(brief: Track) -> None:
    track = dc.replace(brief, expert_delta_v_m_s=[50.0, 50.0])
    late, bad = outcome(success=False), outcome(success=False, keep_out_violations=1)
    rows = [
        row_of(track, "none", late, late),
        row_of(track, "enters", outcome(), bad),
        row_of(track, "late", outcome(), late),
        row_of(track, "costly", outcome(), outcome()),
        row_of(track, "good", outcome(delta_v_m_s=60.0), outcome(delta_v_m_s=55.0)),
    ]
    head, *lines = row_table(track, rows)
    assert [line[0] for line in lines] == ["good", "costly", "late", "enters", "none"]
    assert lines[0][1:8] == ["1", "2 of 2", "15.8 to 100.0", "0", "1.150", "10", "5000"]
    assert lines[-1][5:8] == ["–", "–", "–"]
    assert len(head) == len(lines[0])


def test_rows_keep_their_hash(brief: Track, tmp_path: Path) -> None:
    row, path = row_of(brief, "mine", outcome(), outcome(success=False)), tmp_path / "row.json"
    save_row(row, path)
    assert load_row(path) == dc.replace(row, flights=list(row.flights))
    content = json.loads(path.read_text())
    content["flights"][1]["success"] = True
    path.write_text(json.dumps(content))
    with pytest.raises(InputError, match="was changed after it was written"):
        load_row(path)
    path.write_text("[]")
    with pytest.raises(InputError, match="is not a row of the benchmark"):
        load_row(path)


def test_command(brief: Track, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path, out = tmp_path / "brief.json", tmp_path / "out"
    save_track(brief, path)
    words = ["score", path, "--controller", "zero", "--name", "nothing", "--out", out]
    assert proxops(*words, "--workers", 1) == 0
    told = capfd.readouterr().out
    row = load_row(out / f"brief-{brief.sha256[:12]}-zero.json")
    assert (row.name, row.controller, len(row.flights)) == ("nothing", "zero", 2)
    assert row.sha256[:12] in told
    assert "0 of 2" in told
    assert proxops(*words, "--set", "truth.gravity=2") == 2
    assert "only what is on board may be changed" in capfd.readouterr().err


# --- the page -------------------------------------------------------------------------------------


def test_page_shows_the_rows_that_were_sent() -> None:
    page = (ROOT / "docs" / "benchmark.md").read_text()
    sent = [load_row(path) for path in sorted((ROOT / "docs" / "benchmark").glob("*.json"))]
    for name, digest in TRACKS.items():
        assert f"| `{name}` |" in page
        assert f"`{digest[:12]}`" in page
        track = load_track(name)
        rows = [row for row in sent if row.track == name]
        assert rows
        for line in row_table(track, rows):
            assert f"| {' | '.join(line)} |" in page
