"""The report of an evaluation: its table, which flights it looks into, its figures and pages."""

import itertools
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import proxops, settings
from hypothesis import given
from hypothesis import strategies as st
from known_policies import Counting, DeadReckoning, write_policy
from test_evaluation import ESTIMATE_ERRORS, row

from proxops.diagrams.logs.flight_log import FlightLog
from proxops.diagrams.scenario.scenario_config import ArrivalConfig
from proxops.studies.evaluation.evaluation import aggregate
from proxops.studies.evaluation.figures import controller_looks, plot_delta_v, plot_end_errors
from proxops.studies.evaluation.flights import shown_transits, worst_flights
from proxops.studies.evaluation.table import arrival_text, figure_rows, outcome

POLICY = {"policy_sha256": "1" * 64, "mpc_solves": 0, "policy_share": 1.0}
ESTIMATES = {f"estimate_{name}": value for name, value in ESTIMATE_ERRORS.items()}


def results() -> dict[str, Any]:
    expert = [row(transit=k, delta_v_m_s=100.0) for k in range(20)]
    flown = [
        row(transit=k, delta_v_m_s=105.0, control_ms_median=0.125, **POLICY, **ESTIMATES)
        for k in range(20)
    ]
    flown[7] |= {"success": False, "collided": True, "terminal_position_error_m": 3e4}
    flown[11] |= {"success": False, "arrival_time_s": None, "terminal_position_error_m": 9e4}
    flown[13] |= {"terminal_position_error_m": 250.0}
    none = {"control_ms_median": None, "control_ms_p99": None, "arrival_time_s": None}
    idle = [row(transit=k, success=False, success_2km=False, mpc_solves=0, **none)
            for k in range(20)]  # fmt: skip
    return {
        "mpc": aggregate(expert),
        "policy:a": aggregate(flown, expert),
        "zero": aggregate(idle, expert),
    }


# --- the table ------------------------------------------------------------------------------------


def test_table() -> None:
    rows = figure_rows(results(), ArrivalConfig())
    table = {label: cells for label, cells in rows if label != "95 % interval"}
    assert all(len(cells) == 3 for _, cells in rows)
    assert table["success (1 km, 1 m/s)"] == ["20 of 20", "18 of 20", "0 of 20"]
    assert table["success (2 km, 2 m/s)"] == ["20 of 20", "20 of 20", "0 of 20"]
    intervals = [cells for label, cells in rows if label == "95 % interval"]
    # Newcombe 1998, table I: 0 of 20 is 0 to 16.11 %.
    assert [cells[2] for cells in intervals] == ["0.0–16.1 %"] * 2
    assert [cells[0] for cells in intervals] == ["83.9–100.0 %"] * 2
    assert table["collisions"] == ["0", "1", "0"]
    assert table["end error, greatest (m)"][1] == "90000"
    assert table["delta-v, median (m/s)"] == ["100", "105", "–"]
    assert table["over the expert's, median"] == ["–", "1.050", "–"]
    assert table["over the expert's, of sums"] == ["–", "1.050", "–"]
    assert table["transits compared"] == ["–", "18", "0"]
    assert table["position off, median (m)"] == ["–", "40.0", "–"]
    assert table["velocity off, p95 (m/s)"] == ["–", "0.300", "–"]
    assert table["policy's share (%)"] == ["0.0", "100.0", "0.0"]
    assert table["step, median (ms)"] == ["4.00", "0.12", "–"]


def test_what_nobody_has_is_left_out() -> None:
    labels = [label for label, _ in figure_rows({"mpc": results()["mpc"]}, ArrivalConfig())]
    assert not [label for label in labels if "expert" in label or " off" in label]
    assert "step, median (ms)" in labels


def test_arrival_in_words() -> None:
    assert arrival_text(ArrivalConfig(), 2.0) == "2 km, 2 m/s"
    assert arrival_text(ArrivalConfig(radius_m=5.5, speed_m_s=0.01)) == "5.5 m, 0.01 m/s"


def test_outcomes() -> None:
    assert outcome(row()) == "arrived"
    assert outcome(row(success=False, collided=True, keep_out_violations=1)) == "collision"
    assert outcome(row(success=False, keep_out_violations=2)) == "inside the keep-out"
    assert outcome(row(success=False)) == "arrived too late"
    assert outcome(row(success=False, arrival_time_s=None)) == "no arrival"


# --- which flights are looked into ----------------------------------------------------------------


def test_first_and_worst() -> None:
    # 7 and 11 failed; of those that arrived, 13 ended furthest off.
    assert [flight["transit"] for flight in worst_flights(results()["policy:a"]["flights"])] == [
        11, 7, 13,
    ]  # fmt: skip
    first = [0, 1, 2, 3]
    assert shown_transits(results()) == {
        "mpc": first, "policy:a": [*first, 7, 11, 13], "zero": [*first, 4],
    }  # fmt: skip


@given(st.lists(st.tuples(st.booleans(), st.floats(0.0, 1e6)), min_size=1, max_size=12))
def test_no_flight_left_out_is_worse(ends: list[tuple[bool, float]]) -> None:
    rows = [
        row(transit=k, success=success, terminal_position_error_m=error)
        for k, (success, error) in enumerate(ends)
    ]
    chosen = worst_flights(rows)
    assert len(chosen) == min(3, len(rows))
    left = [flight for flight in rows if flight not in chosen]
    for one, other in itertools.product(chosen, left):
        assert one["success"] <= other["success"]
        if one["success"] == other["success"]:
            assert one["terminal_position_error_m"] >= other["terminal_position_error_m"]


# --- figures --------------------------------------------------------------------------------------


def test_shares_of_end_errors() -> None:
    errors = {"mpc": np.array([5.0, 1.0, 2.0, 2000.0]), "zero": np.array([0.0])}
    looks = controller_looks(list(errors))
    [axis] = plot_end_errors(errors, 1000.0, looks).axes
    line = axis.lines[0]
    assert line.get_label() == "mpc"
    across, up = (np.asarray(values, dtype=float) for values in line.get_data())

    def share_within(metres: float) -> float:
        return float(up[np.flatnonzero(across <= metres / 1e3)[-1]])

    for metres, share in ((0.9, 0.0), (1.5, 0.25), (4.0, 0.5), (6.0, 0.75), (2500.0, 1.0)):
        assert share_within(metres) == share
    assert np.asarray(axis.lines[1].get_data()[0], dtype=float).min() > 0.0  # On a log scale.


def test_delta_v_dots() -> None:
    pairs = {"policy": np.array([[110.0, 100.0], [180.0, 150.0]])}
    looks = controller_looks(["mpc", "policy"])
    [axis] = plot_delta_v(pairs, looks).axes
    [dots] = [line for line in axis.lines if line.get_marker() == "o"]
    np.testing.assert_array_equal(dots.get_data(), [[100.0, 150.0], [110.0, 180.0]])
    assert axis.get_xlim() == axis.get_ylim()
    assert axis.get_xlim()[0] < 100.0 < 180.0 < axis.get_xlim()[1]


def test_looks_stay_with_a_controller() -> None:
    names = ["mpc", *(f"policy:{letter}" for letter in "abcde")]
    looks = controller_looks(names)
    assert len(set(looks.values())) == 6
    assert looks["mpc"] == controller_looks(["zero", "mpc"])["mpc"]


# --- the command ----------------------------------------------------------------------------------


@pytest.fixture
def evaluate(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    monkeypatch.chdir(tmp_path)

    def run(*arguments: object) -> Path:
        brief = settings({"arrival.deadline_s": 100, "arrival.dwell_s": 50})
        assert proxops("evaluate", *arguments, *brief, "--workers", 1, "--out", "out") == 0
        return tmp_path / "out"

    return run


@pytest.mark.slow
def test_evaluate_policies_side_by_side(evaluate, tmp_path: Path) -> None:
    """One that estimates and one that does not; then one transit more, and all logs kept."""
    write_policy(tmp_path / "a", DeadReckoning(proportional=1e-5))
    write_policy(tmp_path / "b", Counting())
    names = ["mpc", "policy:a", "pd:a", "policy:b"]
    command = ("--controllers", ",".join(names), "--seed", 31)
    out = evaluate(*command, "--transits", 1)
    found = json.loads((out / "results.json").read_text())
    assert list(found) == names
    assert {flight["controller"] for flight in found["pd:a"]["flights"]} == {"pd:a"}
    assert found["policy:a"]["expert_pairs"] == 0
    assert "estimate_position_error_m_p95" in found["pd:a"]
    assert "estimate_position_error_m_p95" not in found["policy:b"]

    text = (out / "report.md").read_text()
    assert "proxops evaluate --controllers mpc,policy:a,pd:a,policy:b --seed 31" in text
    figures = re.findall(r"\]\((figures/.*?)\)$", text, re.MULTILINE)
    assert len(figures) == 5  # End errors, paths, and the worst of three that fly a policy.
    assert all((out / name).is_file() for name in figures)
    page = (out / "report.html").read_text()
    assert page.count("data:image/png;base64,") == 5
    for cells in figure_rows(found, ArrivalConfig(deadline_s=100.0, dwell_s=50.0)):
        assert all(cell in text for cell in cells[1])

    # The flights that are looked into are those that were flown, without their lidar frames.
    shown = sorted((out / "shown").glob("*.nc"))
    assert len(shown) == 4
    logs = [FlightLog.load(path) for path in shown]
    ends = {log.summary["controller"]: log.summary["terminal_position_error_m"] for log in logs}
    assert ends == {
        name: result["flights"][0]["terminal_position_error_m"] for name, result in found.items()
    }
    assert all("ranges" not in log.dataset for log in logs)

    times = {path: path.stat().st_mtime_ns for path in shown}
    evaluate(*command, "--transits", 2, "--keep-logs")
    assert {path: path.stat().st_mtime_ns for path in (out / "shown").glob("*.nc")} == times
    kept = sorted((out / "flights").glob("*.nc"))
    assert len(kept) == 8
    assert "ranges" in FlightLog.load(kept[0]).dataset
