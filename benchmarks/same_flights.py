"""Tells whether fourteen flights are still the same, bit for bit, after code was moved.

    python benchmarks/same_flights.py record out/flights.json    # before
    python benchmarks/same_flights.py compare out/flights.json   # after

`record` writes the hash of every array of the flights' logs, wall times aside; `compare` flies
again, names what differs, and exits with 1 if anything does. The hashes hold on one machine and one
set of installed packages, so they are not kept in the repository.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from proxops.diagrams.flight import fly
from proxops.diagrams.logs import FlightLog
from proxops.diagrams.scenario import load_scenario

WALL_TIMES = {"solve_time", "policy_time", "decision_time"}
OUTCOMES = ("arrival_time_s", "collided", "keep_out_violations", "force_delay_s")
ON_NAVIGATION = {"navigation": {"_tag": "!LidarNavigation"}}
# Transit 0 of a seed is clear, transit 1 is blocked by the keep-out ellipsoid.
FLIGHTS: dict[str, tuple[str, dict]] = {
    "mpc": ("mpc", {"transit.index": 0}),
    "mpc, blocked, disturbed": ("mpc", {"transit.index": 1, "disturbance": {}}),
    "mpc, blocked, with solve delay": (
        "mpc",
        {"transit.index": 1, "mpc.solve_delay_s": 5.0},
    ),
    "mpc, the paper's cost, another plant": (
        "mpc",
        {
            "transit.index": 2,
            "mpc.cost": "weighted",
            "mpc.estimator_gain": 0.1,
            "truth.mass": 1.05,
            "truth.thrusters.scale": [0.95] * 3,
        },
    ),
    "policy": ("policy", {"transit.index": 0}),
    "policy, blocked, noise, lidar errors": (
        "policy",
        {
            "transit.index": 1,
            "force_noise": {},
            "truth.lidar.dropout": 0.1,
            "truth.lidar.false_returns": 0.005,
            "truth.lidar.bias_m": 10.0,
            "noise_seed": 3,
        },
    ),
    "hybrid, disturbed": ("hybrid", {"transit.index": 0, "disturbance": {}}),
    "hybrid, blocked, adaptive": (
        "hybrid",
        {"transit.index": 4, "hybrid.period_rule": "adaptive"},
    ),
    "hybrid, blocked, kicks, noisy state, assurance": (
        "hybrid",
        {
            "transit.index": 7,
            "kicks": {},
            "assurance": {"bounds": {}},
            "hybrid.state_noise_position_m": 50.0,
            "hybrid.state_noise_velocity_m_s": 0.05,
        },
    ),
    "pd": ("pd", {"transit.index": 3}),
    "pd on the policy's estimate": ("pd:end-to-end", {"transit.index": 5}),
    "zero, with assurance": ("zero", {"transit.index": 6, "assurance": {}}),
    "on navigation, drawn world, assured": (
        "hybrid",
        {**ON_NAVIGATION, "dispersions": "after_survey", "assurance": {}, "transit.index": 3},
    ),
    "on navigation, much wrong": (
        "mpc",
        {
            **ON_NAVIGATION,
            "transit.index": 8,
            "kicks": {},
            "truth.attitude.constant_deg": [0.5, 0.0, 0.0],
            "truth.lidar.latency_steps": 1,
            "truth.thrusters.scale": [0.99, 1.0, 1.0],
            "truth.acceleration.constant_m_s2": [1e-6, 0.0, 0.0],
            "truth.specific_impulse_s": 220.0,
        },
    ),
}


def hashes(log: FlightLog) -> dict[str, str]:
    """The SHA-256 of each array of a log, and of how the flight ended."""
    arrays = {str(name): log.dataset[name].values for name in log.dataset.variables}
    arrays |= {name: np.asarray(float(log.dataset.attrs[name])) for name in OUTCOMES}
    return {
        name: hashlib.sha256(
            f"{array.dtype} {array.shape} ".encode() + np.ascontiguousarray(array).tobytes()
        ).hexdigest()
        for name, array in sorted(arrays.items())
        if name not in WALL_TIMES
    }


def fly_all(
    names: Sequence[str], known: dict[str, dict[str, str]] | None
) -> tuple[dict[str, dict[str, str]], int]:
    """The hashes of flights by name, and how many flights differ from the known ones."""
    found, changed = {}, 0
    for name in names:
        controller, settings = FLIGHTS[name]
        log = fly(load_scenario(None, settings, on_true_state=True), controller)
        found[name] = hashes(log)
        line = f"{name}: {len(log.dataset.time)} rows"
        if known is not None:
            before = known.get(name, {})
            differ = sorted(
                key for key in {*found[name], *before} if found[name].get(key) != before.get(key)
            )
            changed += bool(differ)
            line += f", differs in {', '.join(differ)}" if differ else ", the same"
        print(line, flush=True)
    return found, changed


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("action", choices=["record", "compare"])
    parser.add_argument("file", type=Path, help="JSON file of the hashes")
    parser.add_argument("--only", nargs="+", choices=FLIGHTS, default=list(FLIGHTS))
    asked = parser.parse_args()
    if asked.action == "compare":
        sys.exit(1 if fly_all(asked.only, json.loads(asked.file.read_text()))[1] else 0)
    found, _ = fly_all(asked.only, None)
    asked.file.parent.mkdir(parents=True, exist_ok=True)
    asked.file.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
