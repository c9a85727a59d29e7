"""The report of an evaluation: its table, which flights it looks into, its figures and pages."""

import itertools
import json
import re
from pathlib import Path

import pytest
from commands import proxops, settings
from flight_rows import ESTIMATE_ERRORS, row
from hypothesis import given
from hypothesis import strategies as st
from known_policies import Counting, DeadReckoning, write_policy

from proxops.diagrams.logs import outcome
from proxops.diagrams.logs.flight_log import FlightLog
from proxops.studies.figures.results import Result, aggregate, figure_rows, results_from_json
from proxops.studies.report import may_be_shown
from proxops.studies.report.shown_flights import shown_transits, worst_flights
from proxops.systems.vehicle import ArrivalConfig

POLICY = {"policy_sha256": "1" * 64, "mpc_solves": 0, "policy_share": 1.0}
ESTIMATES = {f"estimate_{name}": value for name, value in ESTIMATE_ERRORS.items()}


def results() -> dict[str, Result]:
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


def test_what_is_shown_was_kept_as_it_was_flown() -> None:
    """Of 20 flights of each controller, which end one after the other, as in a campaign."""
    for name, transits in shown_transits(results()).items():
        kept: dict[str, dict] = {}
        for flown in results()[name].flights:
            kept[str(flown["transit"])] = {**flown, "controller": name}
            kept = {each: kept[each] for each in may_be_shown(kept)}
        assert len(kept) <= 9
        assert {str(k) for k in transits} <= kept.keys()


# --- the table ------------------------------------------------------------------------------------


def test_table() -> None:
    rows = figure_rows(results(), ArrivalConfig())
    table = {row.label: row.cells for row in rows}
    assert all(len(row.cells) == len(row.good) == 3 for row in rows)
    assert table["success (within 1 km, 1 m/s)"] == ["20 of 20", "18 of 20", "0 of 20"]
    assert table["success (within 2 km, 2 m/s)"] == ["20 of 20", "20 of 20", "0 of 20"]
    # Newcombe 1998, table I: 0 of 20 is 0 to 16.11 %.
    for label in ("95 % interval of success", "95 % interval of that"):
        assert table[label][2] == "0.0–16.1 %"
        assert table[label][0] == "83.9–100.0 %"
    assert table["collisions"] == ["0", "1", "0"]
    assert table["end error, greatest (m)"][1] == "90000"
    assert table["Δv (m/s)"] == ["100", "105", "–"]
    assert table["Δv over the MPC's"] == ["–", "1.050", "–"]
    assert table["Δv over the MPC's, of sums"] == ["–", "1.050", "–"]
    assert table["transits compared"] == ["–", "18", "0"]
    assert table["policy's position error, median (m)"] == ["–", "40.0", "–"]
    assert table["policy's velocity error, 95th percentile (m/s)"] == ["–", "0.300", "–"]
    assert table["steps flown by the policy (%)"] == ["0.0", "100.0", "0.0"]
    assert table["computing a control step (ms)"] == ["4.00", "0.12", "–"]


def test_first_figures_are_few_and_told_good_or_bad() -> None:
    rows = figure_rows(results(), ArrivalConfig())
    first = [row for row in rows if row.group]
    assert rows[: len(first)] == first
    assert len(first) <= 10
    good = {row.label: row.good for row in first}
    # All, some, and none of 20 arrived; one of the second collided.
    assert good["success (within 1 km, 1 m/s)"] == [True, None, False]
    assert good["collisions"] == [True, False, True]
    assert good["Δv (m/s)"] == [None] * 3


def test_outcomes() -> None:
    assert outcome(row()) == "arrived"
    assert outcome(row(touched=True)) == "touched, and home again"
    missed = row(success=False, touched=False, safe=True)
    assert outcome(missed) == "home again without a touch"
    assert outcome(row(success=False, collided=True, keep_out_violations=1)) == "collision"
    assert outcome(row(success=False, keep_out_violations=2)) == "inside the keep-out"
    assert outcome(row(success=False)) == "arrived too late"
    assert outcome(row(success=False, arrival_time_s=None)) == "no arrival"


def test_first_and_worst() -> None:
    # 7 and 11 failed; of those that arrived, 13 ended furthest off.
    assert [flight["transit"] for flight in worst_flights(results()["policy:a"].flights)] == [
        11, 7, 13,
    ]  # fmt: skip
    first = [0, 1, 2, 3]
    assert shown_transits(results()) == {
        "mpc": first, "policy:a": [*first, 7, 11, 13], "zero": [*first, 4],
    }  # fmt: skip


# --- which flights are looked into ----------------------------------------------------------------


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
    found = json.loads((out / "results.json").read_text())["controllers"]
    assert list(found) == names
    assert {flight["controller"] for flight in found["pd:a"]["flights"]} == {"pd:a"}
    assert found["policy:a"]["expert_pairs"] == 0
    assert found["pd:a"]["estimate_position_error_m_p95"] is not None
    assert found["policy:b"]["estimate_position_error_m_p95"] is None

    text = (out / "report.md").read_text()
    assert "proxops evaluate --controllers mpc,policy:a,pd:a,policy:b --seed 31" in text
    figures = re.findall(r"\]\((figures/.*?)\)$", text, re.MULTILINE)
    assert len(figures) == 5  # End errors, paths, and the worst of three that fly a policy.
    assert all((out / name).is_file() for name in figures)
    page = (out / "report.html").read_text()
    assert page.count("data:image/png;base64,") == 5
    for cells in figure_rows(
        results_from_json(found), ArrivalConfig(deadline_s=100.0, dwell_s=50.0)
    ):
        assert all(cell in text for cell in cells[1])

    # The flights that are looked into are those that were flown.
    shown = sorted((out / "flights").glob("*.nc"))
    assert len(shown) == 4
    logs = [FlightLog.load(path) for path in shown]
    ends = {log.summary["controller"]: log.summary["terminal_position_error_m"] for log in logs}
    assert ends == {
        name: result["flights"][0]["terminal_position_error_m"] for name, result in found.items()
    }

    times = {path: path.stat().st_mtime_ns for path in shown}
    evaluate(*command, "--transits", 2, "--keep-logs")
    assert {path: path.stat().st_mtime_ns for path in shown} == times
    kept = sorted((out / "flights").glob("*.nc"))
    assert len(kept) == 8
    assert "ranges" in FlightLog.load(kept[0]).dataset
