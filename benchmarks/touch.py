"""Touch-and-goes at Bennu by the product's own flights: `task: !TouchAndGo`, lidar navigation.

    python benchmarks/touch.py --flights 24
    python benchmarks/touch.py --flights 24 --controller hybrid
    python benchmarks/touch.py --flights 10 --failure frames
    python benchmarks/touch.py --scenario bennu_mission --dispersions mission --flights 10

Each flies the scenario `bennu_touch_and_go` in a world of its own, drawn from `touch_and_go`, with
one of `FAILURES` if it is asked for. A mission makes its map first.
Run the command again to continue after an interruption: what has a summary in `--out` is not flown
twice.
"""

from __future__ import annotations

import argparse
import dataclasses as dc
import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from proxops.diagrams.flight import Workers, fly
from proxops.diagrams.scenario import (
    MissionConfig,
    Scenario,
    dispersion_entries,
    load_body,
    load_scenario,
    of_transit,
    with_site,
)
from proxops.diagrams.surveys import run_mission
from proxops.diagrams.yaml_files import write_yaml
from proxops.systems.common import InputError, generator, make_folder, write_json

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
    "touch_policy_share": ("by the policy (%)", 100.0),
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


@dc.dataclass(frozen=True)
class Wanted:
    """A touch-and-go or a mission of a world of its own."""

    name: str
    scenario: Scenario
    controller: str
    folder: Path
    """For its summary, and for all that a mission writes."""

    def flown(self) -> dict[str, Any]:
        """Its summary; it is flown once a folder."""
        path = self.folder / "summary.json"
        if not path.is_file():
            make_folder(self.folder)
            write_json(path, self._summary())
        return json.loads(path.read_text(encoding="utf-8"))

    def _summary(self) -> dict[str, Any]:
        body = load_body(self.scenario.body)
        try:
            if not isinstance(self.scenario.task, MissionConfig):
                return fly(self.scenario, self.controller, body=body).summary
            surveyed, log = run_mission(self.scenario, body, self.folder)
        except InputError as error:
            return {"refused": str(error)}
        return log.summary | {f"survey_{name}": x for name, x in surveyed.figures.items()}


def main() -> None:
    """Flies and prints."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenario", default="bennu_touch_and_go")
    parser.add_argument("--dispersions", default="touch_and_go")
    parser.add_argument("--flights", type=int, default=24)
    parser.add_argument("--seed", type=int, default=10000)
    parser.add_argument("--controller", default="mpc", help="of descents: mpc, policy or hybrid")
    parser.add_argument("--failure", choices=FAILURES, help="what goes wrong in each flight")
    parser.add_argument("--out", type=Path, default=Path("out/touches"))
    parser.add_argument("--set", action="append", default=[], help="KEY=VALUE of the scenario")
    parser.add_argument("--workers", type=int, help="processes; as many as cores, if not given")
    asked = parser.parse_args()
    make_folder(asked.out)
    dispersions = asked.dispersions
    if asked.failure is not None:
        path = asked.out / f"{asked.failure}.yaml"
        path.write_text(write_yaml(dispersion_entries(dispersions) | FAILURES[asked.failure]))
        dispersions = str(path)
    scenario = load_scenario(
        asked.scenario, [f"dispersions={dispersions}", "log_ranges=false", *asked.set]
    )
    scenario = with_site(scenario, load_body(scenario.body))
    kind = asked.failure or asked.controller
    pieces = [
        Wanted(f"{asked.seed}-{k}", one, asked.controller, asked.out / f"{kind}-{asked.seed}-{k}")
        for k, one in enumerate(worlds(scenario, asked))
    ]
    began, found = time.monotonic(), []
    for name, summary in Workers(asked.workers).results(pieces, Wanted.flown):
        print(f"flight {name}: {_told(summary)}", flush=True)
        if "refused" not in summary:
            found.append(summary)
    _print(found)
    print(f"{time.monotonic() - began:.0f} s, without the flights that were flown before")


def worlds(scenario: Scenario, asked: argparse.Namespace) -> Iterator[Scenario]:
    """The scenario of each flight."""
    for index in range(asked.flights):
        flown = of_transit(scenario, asked.seed, index)
        if asked.failure == "boulder":
            beside = generator(asked.seed, index, 4).uniform(-BESIDE, BESIDE, 3)
            at = (np.array(scenario.task.site) + beside).tolist()
            boulders = dc.replace(flown.truth.boulders, lone_at_m=at)
            flown = dc.replace(flown, truth=dc.replace(flown.truth, boulders=boulders))
        yield flown


def _told(summary: dict[str, Any]) -> str:
    if "refused" in summary:
        return summary["refused"]
    figures = [f"{key[6:]} {summary[key]:.3g}" for key in list(FIGURES)[:3] if key in summary]
    safe = "safe" if summary["safe"] else "NOT SAFE"
    parts = f"{summary['touch_parts_force_n']:.3g} N on bus and panels"
    return f"{safe}, {parts}, aborts {summary['touch_aborts']}, {', '.join(figures)}"


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
