"""What a report says of dispersed worlds: what drives failure, the worst, the unflyable."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from flight_rows import row, unflyable
from synthetic_log import synthetic_log

from proxops.studies.figures.results import Result, aggregate_all
from proxops.studies.figures.sensitivity import Ranked
from proxops.studies.report import shown_flights
from proxops.studies.report.evaluation_report import evaluation_sections
from proxops.studies.report.plots import plot_drivers, strongest
from proxops.studies.report.shown_flights import replayed_flights, shown_transits, write_worst
from proxops.systems.vehicle import ArrivalConfig
from proxops.training.reports import markdown_page


def entry(name: str, index: float, above: bool = True) -> Ranked:
    return Ranked(name, index, index - 0.05, index + 0.05, above)


CHANCE = [entry("dummy", 0.10, above=False), entry("truth.mass", 0.08, above=False)]
RANKINGS = {
    "failure": [entry("truth.attitude[0]", 0.5), entry("truth.mesh", 0.3), *CHANCE],
    "terminal_position_error_m": [entry("truth.attitude[0]", 0.4), *CHANCE],
    "delta_v_m_s": [entry("truth.gravity", 0.6), *CHANCE],
}


def dispersed_rows(count: int, failures: tuple[int, ...]) -> list[dict[str, Any]]:
    return [
        row(
            transit=k, success=k not in failures, delta_v_m_s=100.0 + k,
            terminal_position_error_m=1e4 + k if k in failures else 10.0 + k,
            dispersed={
                "truth.gravity": 1.0 + 1e-3 * k, "truth.attitude": [0.1 * k, 0.2],
                "truth.mesh": "ab"[k % 2], "truth.mass": 1.0,
            },
        )
        for k in range(count)
    ]  # fmt: skip


@pytest.fixture(scope="module")
def results() -> dict[str, Result]:
    flown = dispersed_rows(9, (3, 8))
    flown[1] = unflyable(1)
    flown[4] = unflyable(4, "hovering needs 9 N")
    found = aggregate_all({"mpc": dispersed_rows(9, ()), "pd": flown})
    return found | {"pd": dataclasses.replace(found["pd"], sensitivity=RANKINGS)}


def page(results: dict[str, Result]) -> str:
    log = synthetic_log(20, False)
    logs = {name: dict.fromkeys(numbers, log) for name, numbers in shown_transits(results).items()}
    return markdown_page("Report", evaluation_sections(results, logs, ArrivalConfig()))


@pytest.fixture(scope="module")
def text(results: dict[str, Result]) -> str:
    return page(results)


# --- rankings -------------------------------------------------------------------------------------


def test_strongest_are_taken_in_turns() -> None:
    assert strongest(RANKINGS) == ["truth.attitude[0]", "truth.gravity", "truth.mesh"]
    many = {"failure": [entry(f"x{k}", 1.0 - 0.1 * k) for k in range(9)]}
    assert strongest(many) == ["x0", "x1", "x2", "x3"]
    assert strongest({"failure": CHANCE}) == strongest({}) == []


def test_bars_end_at_the_index_and_chance_is_marked() -> None:
    figure = plot_drivers({name: each for name, each in RANKINGS.items() if name != "delta_v_m_s"})
    assert [axis.get_title() for axis in figure.axes] == ["failure", "end error"]
    axis = figure.axes[0]
    bars: Any = axis.patches
    assert [bar.get_width() for bar in bars] == [0.08, 0.10, 0.3, 0.5]
    assert [bool(bar.get_hatch()) for bar in bars] == [False, True, False, False]
    colours = [bar.get_facecolor() for bar in bars]
    assert colours[0] == colours[1] != colours[2] == colours[3]
    [floor] = [line for line in axis.lines if line.get_linestyle() == "--"]
    np.testing.assert_allclose(np.asarray(floor.get_xdata(), dtype=float), 0.15)


# --- the worst flights ----------------------------------------------------------------------------


def test_the_five_worst_are_replayed(results: dict[str, Result]) -> None:
    assert [flown["transit"] for flown in replayed_flights(results["pd"])] == [8, 3, 7, 6, 5]
    assert len(replayed_flights(results["mpc"])) == 5  # Dispersed.
    plain = aggregate_all({"mpc": [row()], "pd": [row(success=False)]})
    assert [len(replayed_flights(result)) for result in plain.values()] == [0, 1]
    assert shown_transits(results)["pd"] == [0, 2, 3, 5, 6, 7, 8]


@pytest.mark.slow
def test_report_leads_to_the_replays(
    results: dict[str, Result], text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shown_flights, "write_replay", lambda log, path: path.write_text(str(log)))
    logs = {name: {k: k for k in numbers} for name, numbers in shown_transits(results).items()}
    written: Any = logs
    write_worst(tmp_path, results, written)
    names = [f"mpc-{k:05d}.html" for k in range(4, 9)] + [
        f"pd-{k:05d}.html" for k in (3, 5, 6, 7, 8)
    ]
    assert sorted(path.name for path in (tmp_path / "worst").iterdir()) == names
    assert (tmp_path / "worst" / "pd-00003.html").read_text() == "3"
    assert all(f"(worst/{name})" in text for name in names)
    assert "| truth.attitude | (0.8, 0.2) | (0.3, 0.2) |" in text
    assert "| truth.mesh | a | b |" in text


# --- the report -----------------------------------------------------------------------------------


def test_report_says_what_drives_failure(text: str) -> None:
    assert "## What drives failure" in text
    assert r"failure: truth.attitude\[0\], truth.mesh." in text
    assert "mpc: nothing can be told, fewer than 50 flights." in text
    assert "(figures/drivers-1.png)" in text
    assert "(figures/scatter-1.png)" in text
    assert "## Worlds that can't be flown" in text
    plain = page(aggregate_all({"mpc": [row()]}))
    for title in ("What drives failure", "Worlds that can't", "Worst flights", "without success"):
        assert title not in plain
