"""Touch-and-goes at Bennu by the product's own flights: `task: !TouchAndGo`, lidar navigation.

    python benchmarks/touch.py --flights 24
    python benchmarks/touch.py --flights 10 --failure frames
    python benchmarks/touch.py --scenario bennu_mission --dispersions mission --flights 10

Each flies the scenario `bennu_touch_and_go` in a world of its own, drawn from `touch_and_go`, with
one of `FAILURES` if it is asked for. A mission makes its map first.
Run the command again to continue after an interruption: missions in `--out` are not flown twice.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from proxops.diagrams.flight import fly
from proxops.diagrams.scenario import (
    Body,
    MissionConfig,
    Scenario,
    dispersion_entries,
    load_body,
    load_scenario,
    with_site,
)
from proxops.diagrams.surveys import run_mission
from proxops.diagrams.yaml_files import write_yaml
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
# What goes wrong besides, as rows of dispersions. Only GM is told: that it is known so badly.
FAILURES: dict[str, dict[str, Any]] = {
    "thruster": {
        "truth.rigid_body.failed_thruster": {"uniform": [0, 15]},
        "truth.rigid_body.failure_time_s": {"uniform": [0.0, 2000.0]},
    },
    "frames": {
        "truth.lidar.outage_steps": 15,  # 60 s
        "truth.lidar.outage_from_step": {"uniform": [0, 450]},
    },
    "boulder": {"truth.boulders.lone_m": 2.0},
    "gravity": {"truth.gravity": {"uniform": [0.7, 1.3]}},
    "soft": {
        "truth.ground.modulus_pa": {"log_uniform": [2e3, 1e5]},
        "truth.ground.friction": {"uniform": [0.1, 1.0]},
    },
}
# How far beside the site the boulder's middle is, in m, at most, along each axis.
BESIDE = 1.0


def main() -> None:
    """Flies and prints."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenario", default="bennu_touch_and_go")
    parser.add_argument("--dispersions", default="touch_and_go")
    parser.add_argument("--flights", type=int, default=24)
    parser.add_argument("--seed", type=int, default=10000)
    parser.add_argument("--failure", choices=FAILURES, help="what goes wrong in each flight")
    parser.add_argument("--out", type=Path, default=Path("out/missions"), help="of missions")
    parser.add_argument("--set", action="append", default=[], help="KEY=VALUE of the scenario")
    parser.add_argument("--minutes", type=float, default=np.inf, help="no new flight after it")
    asked = parser.parse_args()
    if asked.failure is None:
        fly_all(asked, asked.dispersions)
        return
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "failures.yaml")
        rows = dispersion_entries(asked.dispersions) | FAILURES[asked.failure]
        path.write_text(write_yaml(rows))
        fly_all(asked, str(path))


def fly_all(asked: argparse.Namespace, dispersions: str) -> None:
    """Flies all that is asked for, in worlds of dispersions."""
    scenario = load_scenario(
        asked.scenario, [f"dispersions={dispersions}", "log_ranges=false", *asked.set]
    )
    body, began, found = load_body(scenario.body), time.process_time(), []
    is_mission = isinstance(scenario.task, MissionConfig)
    for index in range(asked.flights):
        if time.process_time() - began > 60.0 * asked.minutes:
            break
        scenario.transit.seed, scenario.transit.index = asked.seed, index
        if asked.failure == "boulder":
            site = np.array(with_site(scenario, body).task.site)
            beside = generator(asked.seed, index, 4).uniform(-BESIDE, BESIDE, 3)
            scenario.truth.boulders.lone_at_m = (site + beside).tolist()
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
        print(f"flight {index}: {told}, {parts}, {aborts}, {', '.join(figures)}", flush=True)
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
