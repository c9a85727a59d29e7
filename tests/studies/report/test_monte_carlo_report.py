"""What a report says of dispersed worlds: what drives failure, the worst, the unflyable."""

import dataclasses
from typing import Any

import pytest
from flight_rows import row, unflyable
from synthetic_log import synthetic_log

from proxops.studies.figures.results import Result, aggregate_all
from proxops.studies.figures.sensitivity import Ranked
from proxops.studies.report.evaluation_report import evaluation_sections
from proxops.studies.report.shown_flights import replayed_flights, shown_transits
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


# --- the worst flights ----------------------------------------------------------------------------


def test_the_five_worst_are_replayed(results: dict[str, Result]) -> None:
    assert [flown["transit"] for flown in replayed_flights(results["pd"])] == [8, 3, 7, 6, 5]
    assert len(replayed_flights(results["mpc"])) == 5  # Dispersed.
    plain = aggregate_all({"mpc": [row()], "pd": [row(success=False)]})
    assert [len(replayed_flights(result)) for result in plain.values()] == [0, 1]
    assert shown_transits(results)["pd"] == [0, 2, 3, 5, 6, 7, 8]


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
