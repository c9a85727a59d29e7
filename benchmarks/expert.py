"""The expert over a set of transits: its two costs, and a plant that is not what it believes.

Every variant flies the same transits from the same starts to the same goals, with the same noise.
`time_and_fuel` is the default cost, in a plant as believed; `weighted` is the paper's. In the
other variants the plant differs from the model, each without and with the estimator of what
pushes besides gravity. Δv is what the plant felt. Flights are kept one by one in the folder of
`--out`: run it again to finish what was interrupted, or to add transits.

    python benchmarks/expert.py [--transits 50] [--seed 10001] [--workers N] [--out out/expert]
        [--markdown table.md]
"""

import argparse
import dataclasses
import os
from collections.abc import Sequence
from pathlib import Path

for name in ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[name] = "1"

import numpy as np
from _table import flying, show

from proxops.diagrams.flight import (
    Flight,
    Row,
    Workers,
    file_label,
    run_groups,
    transit_flights,
)
from proxops.diagrams.scenario import load_scenario

MATCHED = "time_and_fuel"
MISMATCHES: dict[str, dict] = {
    "gravity x 0.8": {"mismatch.gravity": 0.8},
    "gravity x 1.2": {"mismatch.gravity": 1.2},
    "point mass believed": {"mpc.point_mass": True},
    "mass x 0.9": {"mismatch.mass": 0.9},
    "mass x 1.1": {"mismatch.mass": 1.1},
    "thrust x 0.9": {"mismatch.thrust": 0.9},
    "thrust x 1.1": {"mismatch.thrust": 1.1},
    "the paper's disturbance": {"disturbance": {}},
}
GAIN = 0.3
VARIANTS: dict[str, dict] = {
    MATCHED: {},
    f"{MATCHED}, estimator {GAIN}": {"mpc.estimator_gain": GAIN},
    "weighted": {"mpc.cost": "weighted"},
    **{
        name + (f", estimator {gain}" if gain else ""): {**wrong, "mpc.estimator_gain": gain}
        for name, wrong in MISMATCHES.items()
        for gain in (0.0, GAIN)
    },
}
HEADINGS = (
    "success", "end error, median (m)", "greatest (m)", "end speed, greatest (m/s)",
    "Δv, median (m/s)", "Δv over matched", "arrival, median (s)", "keep-out violations",
    "collisions", "least clearance (km)",
)  # fmt: skip


def fly_all(
    variants: Sequence[str],
    seed: int,
    count: int,
    folder: Path,
    workers: Workers,
) -> dict[str, list[Row]]:
    """Each variant's rows in the order of the transits."""
    groups: dict[str, list[Flight]] = {variant: [] for variant in variants}
    for variant in variants:
        label = file_label(variant)
        scenario = load_scenario(None, VARIANTS[variant])
        for flight in transit_flights(scenario, "mpc", seed, count):
            groups[variant].append(dataclasses.replace(flight, name=f"{label}-{flight.name}"))
    return run_groups(groups, folder, workers=workers)


def figures(rows: list[Row], matched: list[Row]) -> list[str]:
    """One line of the table; Δv and arrival are of the flights that arrived."""

    def values(name: str) -> np.ndarray:
        return np.array([row[name] for row in rows])

    def median(numbers: list[float], form: str) -> str:
        return format(np.median(numbers), form) if numbers else "–"

    arrived = [row for row in rows if row["arrival_time_s"] is not None]
    ratios = [
        row["delta_v_m_s"] / best["delta_v_m_s"]
        for row, best in zip(rows, matched, strict=True)
        if row["arrival_time_s"] is not None and best["arrival_time_s"] is not None
    ]
    return [
        f"{values('success').sum()}/{len(rows)}",
        f"{np.median(values('terminal_position_error_m')):.1f}",
        f"{values('terminal_position_error_m').max():.1f}",
        f"{values('terminal_speed_m_s').max():.3f}",
        median([row["delta_v_m_s"] for row in arrived], ".1f"),
        median(ratios, ".3f"),
        median([row["arrival_time_s"] for row in arrived], ".0f"),
        str(values("keep_out_violations").sum()),
        str(values("collided").sum()),
        f"{values('min_clearance_m').min() / 1e3:.2f}",
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--transits", type=int, default=50)
    parser.add_argument("--seed", type=int, default=10001)
    parser.add_argument("--workers", type=int, help="processes; default: one for each core")
    parser.add_argument("--out", type=Path, default=Path("out/expert"))
    parser.add_argument("--markdown", type=Path, help="also write the table there")
    asked = parser.parse_args()
    with flying(asked.workers) as workers:
        rows = fly_all(
            list(VARIANTS), asked.seed, asked.transits, asked.out, workers
        )  # fmt: skip
    lines = {variant: figures(rows[variant], rows[MATCHED]) for variant in VARIANTS}
    title = f"{asked.transits} transits of seed {asked.seed}"
    show(title, HEADINGS, lines, asked.markdown)


if __name__ == "__main__":
    main()
