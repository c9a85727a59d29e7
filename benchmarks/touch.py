"""Touch-and-goes at Bennu by the product's own flights: `task: !TouchAndGo`, lidar navigation.

    python benchmarks/touch.py --flights 24
    python benchmarks/touch.py --flights 10 --fail
    python benchmarks/touch.py --scenario bennu_mission --dispersions mission --flights 10

Each flies the scenario `bennu_touch_and_go` in a world of its own, drawn from `touch_and_go`. With
`--fail`, one of its thrusters fails at a time that is drawn, too. A mission makes its map first.
Run the command again to continue after an interruption: missions in `--out` are not flown twice.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np

from proxops.diagrams.flight import fly
from proxops.diagrams.scenario import (
    Body,
    MissionConfig,
    Scenario,
    load_body,
    load_scenario,
    load_spacecraft,
)
from proxops.diagrams.surveys import run_mission
from proxops.systems.common import InputError, generator, write_json

# What is told of each touch: the key of the summary, its name, and its factor.
FIGURES = {
    "touch_miss_m": ("miss (m)", 1.0),
    "touch_down_m_s": ("down (cm/s)", 100.0),
    "touch_across_m_s": ("across (cm/s)", 100.0),
    "touch_tilt_deg": ("tilt (deg)", 1.0),
    "touch_rate_deg_s": ("rate (deg/s)", 1.0),
    "touch_later_rate_deg_s": ("rate at +10 s (deg/s)", 1.0),
    "touch_navigation_error_m": ("navigated position off (m)", 1.0),
    "touch_force_n": ("peak force (N)", 1.0),
    "touch_duration_s": ("contact (s)", 1.0),
    "touch_stroke_m": ("stroke (cm)", 100.0),
    "touch_again": ("second touches", 1.0),
    "delta_v_m_s": ("delta-v, home again (m/s)", 1.0),
    "navigation_consistent": ("navigation in 3 sigma", 1.0),
    # Of a mission's survey.
    "survey_map_rms_of_size": ("map, rms over its size (%)", 100.0),
    "survey_gravity_error": ("GM off (%)", 100.0),
    "survey_pole_error_deg": ("pole off (deg)", 1.0),
    "survey_hours": ("in orbit (h)", 1.0),
    "survey_delta_v_m_s": ("delta-v, survey (m/s)", 1.0),
}
# The time in s within which a thruster fails: that of a flight.
LATEST = 2000.0


def main() -> None:
    """Flies and prints."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenario", default="bennu_touch_and_go")
    parser.add_argument("--dispersions", default="touch_and_go")
    parser.add_argument("--flights", type=int, default=24)
    parser.add_argument("--seed", type=int, default=10000)
    parser.add_argument("--fail", action="store_true", help="a thruster fails in each flight")
    parser.add_argument("--out", type=Path, default=Path("out/missions"), help="of missions")
    parser.add_argument("--set", action="append", default=[], help="KEY=VALUE of the scenario")
    parser.add_argument("--minutes", type=float, default=np.inf, help="no new flight after it")
    asked = parser.parse_args()
    scenario = load_scenario(
        asked.scenario, [f"dispersions={asked.dispersions}", "log_ranges=false", *asked.set]
    )
    body, began, found = load_body(scenario.body), time.process_time(), []
    thrusters = load_spacecraft(scenario.spacecraft.model).thrusters.count
    is_mission = isinstance(scenario.task, MissionConfig)
    for index in range(asked.flights):
        if time.process_time() - began > 60.0 * asked.minutes:
            break
        scenario.transit.seed, scenario.transit.index = asked.seed, index
        failure = scenario.truth.rigid_body
        if asked.fail:
            random = generator(asked.seed, index, 4)
            failure.failed_thruster = int(random.integers(thrusters))
            failure.failure_time_s = float(random.uniform(0.0, LATEST))
        try:
            if is_mission:
                summary = flown_mission(scenario, body, asked.out / f"{asked.seed}-{index}")
            else:
                summary = fly(scenario, body=body).summary
        except InputError as error:
            print(f"flight {index}: {error}", flush=True)
            continue
        found.append(summary)
        figures = [f"{key[6:]} {summary[key]:.3g}" for key in list(FIGURES)[:3] if key in summary]
        told = "safe" if summary["safe"] else "NOT SAFE"
        parts = f"{summary['touch_parts_force_n']:.3g} N on bus and panels"
        aborts = f"aborts {summary['touch_aborts']}"
        failed = ""
        if asked.fail:
            failed = f"thruster {failure.failed_thruster} at {failure.failure_time_s:.0f} s, "
        print(
            f"flight {index}: {failed}{told}, {parts}, {aborts}, {', '.join(figures)}", flush=True
        )
    _print(found)
    spent = (time.process_time() - began) / max(len(found), 1)
    print(f"seed {asked.seed}: {spent:.0f} s of processor a flight")


def flown_mission(scenario: Scenario, body: Body, folder: Path) -> dict[str, Any]:
    """The summary of a mission's flight, with that of its survey; it is flown once a folder."""
    path = folder / "summary.json"
    if not path.is_file():
        surveyed, log = run_mission(scenario, body, folder)
        write_json(path, log.summary | {"survey": surveyed.figures})
    summary = json.loads(path.read_text(encoding="utf-8"))
    return summary | {f"survey_{name}": value for name, value in summary["survey"].items()}


def _print(found: list[dict]) -> None:
    touched = [each for each in found if each["touched"]]
    counts = {
        "touched": len(touched),
        "safe": sum(each["safe"] for each in found),
        "with an abort": sum(bool(each["touch_aborts"]) for each in found),
        "a force on bus or panels": sum(each["touch_parts_force_n"] > 0.0 for each in found),
    }
    print(f"of {len(found)} flights: {', '.join(f'{n} {what}' for what, n in counts.items())}")
    if not touched:
        return
    print(f"| {'':26} | least | median | 95 % | greatest |")
    for key, (name, factor) in FIGURES.items():
        column = factor * np.array([each[key] for each in touched if key in each], dtype=float)
        if column.size:
            figures = [column.min(), *np.percentile(column, [50, 95]), column.max()]
            print(f"| {name:26} | " + " | ".join(f"{x:.3g}" for x in figures) + " |")


if __name__ == "__main__":
    main()
