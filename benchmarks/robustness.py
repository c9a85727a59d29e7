"""A policy where it was not trained: worse lidar, another plant, other starts.

Every variant flies transits of one seed to the same goals, with the same noise. In the first ones
the lidar is worse, or the plant is not what the policy learned from; in the last three the flight
starts where no transit does. Flights are kept one by one in the folder of `--out`: run it again to
finish what was interrupted, or to add transits.

    python benchmarks/robustness.py [--controller policy] [--transits 50] [--seed 10001]
        [--workers N] [--out out/robustness] [--markdown table.md]

`--controller` takes what `proxops evaluate` does: `policy:out/mine/bundle`, or `mpc` to see what
the expert makes of the same.
"""

import argparse
import dataclasses
import os
from collections.abc import Callable, Sequence
from pathlib import Path

for name in ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[name] = "1"

import numpy as np
from _table import flying, show

from proxops.assets import ASSETS
from proxops.diagrams.flight import (
    Flight,
    Row,
    Workers,
    file_label,
    run_groups,
    transit_flights,
)
from proxops.diagrams.scenario import (
    Body,
    Scenario,
    Transit,
    draw_transit,
    dump_scenario,
    hover_force,
    load_body,
    load_scenario,
    parse_scenario,
)
from proxops.systems.common import InputError, derived_seed, generator
from proxops.systems.shapes import clearances

SETTINGS: dict[str, dict] = {
    "nominal": {},
    "lidar noise x 4": {"lidar.noise_std_m": 200.0},
    "20 % dropout": {"lidar.dropout": 0.2},
    "1 % false returns": {"lidar.false_returns": 0.01},
    "attitude error 0.1°": {"lidar.attitude_error_deg": 0.1},
    "gravity x 0.8": {"mismatch.gravity": 0.8},
    "gravity x 1.2": {"mismatch.gravity": 1.2},
    "mass x 0.9": {"mismatch.mass": 0.9},
    "mass x 1.1": {"mismatch.mass": 1.1},
    "thrust x 0.9": {"mismatch.thrust": 0.9},
    "thrust x 1.1": {"mismatch.thrust": 1.1},
    "the paper's disturbance": {"disturbance": {}},
}
SHIPPED = ASSETS / "policy"
OUTSIDE, INSIDE_MARGIN, MOVING = "start outside the cube", "start inside the margin", "start moving"
HEADINGS = (
    "success", "success (2 km)", "collisions", "keep-out violations", "end error, median (m)",
    "p95 (m)", "Δv, median (m/s)",
)  # fmt: skip

# Starts outside the cube: from the origin, in m.
NEAREST, FURTHEST = 190e3, 220e3
# Starts inside the margin, from the ellipsoid, in m: from rest there is time to act.
LEAST_CLEARANCE, GREATEST_CLEARANCE = 300.0, 3e3
SPEED = 20.0
# Share of the thrust limit that must suffice to stop before the ellipsoid.
BRAKING_SHARE = 0.5
ATTEMPTS = 10_000

Start = tuple[np.ndarray, np.ndarray]
"""Position (3,) in m and velocity (3,) in m/s, in K."""


def outside_cube(transit: Transit, scenario: Scenario, body: Body) -> Start:
    """At rest, 190 to 220 km out on that half of an axis which the goal is furthest along."""
    axis = np.argmax(np.abs(transit.goal))
    place = np.zeros(3)
    distance = _random(OUTSIDE, transit).uniform(NEAREST, FURTHEST)
    place[axis] = np.copysign(distance, transit.goal[axis])
    return place, np.zeros(3)


def inside_margin(transit: Transit, scenario: Scenario, body: Body) -> Start:
    """At rest, 0.3 to 3 km from the keep-out ellipsoid, as far from the goal as transits are."""
    random, axes, rules = _random(INSIDE_MARGIN, transit), body.keep_out_semi_axes, scenario.transit
    # A goal in a corner of the cube may be further from all of the ellipsoid than transits are.
    nearest = float(clearances(axes, transit.goal[None])[0])
    furthest = max(rules.max_distance_m, nearest + rules.min_distance_m)
    for _ in range(ATTEMPTS):
        way = random.standard_normal(3)
        surface = axes * way / np.linalg.norm(way)
        normal = surface / axes**2 / np.linalg.norm(surface / axes**2)
        place = surface + random.uniform(LEAST_CLEARANCE, GREATEST_CLEARANCE) * normal
        distance = float(np.linalg.norm(place - transit.goal))
        if not rules.min_distance_m <= distance <= furthest:
            continue
        limit = rules.max_hover_share * scenario.spacecraft.thrust_limit_n
        if hover_force(place[None], scenario, body)[0] <= limit:
            return place, np.zeros(3)
    raise InputError(f"no start inside the margin for transit {transit.index}")


def moving(transit: Transit, scenario: Scenario, body: Body) -> Start:
    """Where the transit starts, at 20 m/s in any direction from which it can still stop."""
    random, craft = _random(MOVING, transit), scenario.spacecraft
    braking = BRAKING_SHARE * craft.thrust_limit_n / craft.mass_kg
    for _ in range(ATTEMPTS):
        way = random.standard_normal(3)
        way /= np.linalg.norm(way)
        # Straight on until it stands.
        stop = transit.start + np.linspace(0.0, SPEED**2 / (2.0 * braking), 50)[:, None] * way
        if clearances(body.keep_out_semi_axes, stop).min() > 0.0:
            return transit.start, SPEED * way
    raise InputError(f"no way to move from the start of transit {transit.index}")


STARTS: dict[str, Callable[[Transit, Scenario, Body], Start]] = {
    OUTSIDE: outside_cube,
    INSIDE_MARGIN: inside_margin,
    MOVING: moving,
}
VARIANTS = (*SETTINGS, *STARTS)


def _random(variant: str, transit: Transit) -> np.random.Generator:
    """Numbers of one start: a function of variant, seed and number of the transit."""
    stream = list(STARTS).index(variant)
    return generator(derived_seed(transit.seed, 1 + stream), transit.index)


def flights_of(variant: str, controller: str, seed: int, count: int) -> list[Flight]:
    """The flights of a variant, in the order of the transits."""
    scenario = load_scenario(None, {"log_ranges": False, **SETTINGS.get(variant, {})})
    body = load_body(scenario.body)
    label = file_label(variant)
    flights = []
    for index, flight in enumerate(transit_flights(scenario, controller, seed, count)):
        text = flight.scenario
        if variant in STARTS:
            transit = draw_transit(seed, index, scenario, body)
            place, velocity = STARTS[variant](transit, scenario, body)
            wanted = parse_scenario(text)
            wanted.transit.start_m, wanted.transit.goal_m = place.tolist(), transit.goal.tolist()
            wanted.transit.start_velocity_m_s = velocity.tolist()
            text = dump_scenario(wanted)
        flights.append(dataclasses.replace(flight, name=f"{label}-{flight.name}", scenario=text))
    return flights


def fly_all(
    variants: Sequence[str],
    controller: str,
    seed: int,
    count: int,
    folder: Path,
    workers: Workers,
) -> dict[str, list[Row]]:
    """Each variant's rows in the order of the transits."""
    groups = {name: flights_of(name, controller, seed, count) for name in variants}
    return run_groups(groups, folder, workers=workers)


def figures(rows: Sequence[Row]) -> list[str]:
    """One line of the table; Δv is of the flights that succeeded."""
    errors = [row["terminal_position_error_m"] for row in rows]
    spent = [row["delta_v_m_s"] for row in rows if row["success"]]
    return [
        f"{sum(row['success'] for row in rows)}/{len(rows)}",
        f"{sum(row['success_2km'] for row in rows)}/{len(rows)}",
        str(sum(row["collided"] for row in rows)),
        str(sum(row["keep_out_violations"] for row in rows)),
        f"{np.median(errors):.1f}",
        f"{np.percentile(errors, 95):.1f}",
        f"{np.median(spent):.1f}" if spent else "–",
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--controller", default="policy")
    parser.add_argument("--transits", type=int, default=50)
    parser.add_argument("--seed", type=int, default=10001)
    parser.add_argument("--workers", type=int, help="processes; default: one for each core")
    parser.add_argument("--out", type=Path, default=Path("out/robustness"))
    parser.add_argument("--markdown", type=Path, help="also write the table there")
    asked = parser.parse_args()
    if asked.controller == "policy" and not SHIPPED.is_dir():
        print("No policy ships yet: name one with --controller policy:BUNDLE.")
        return  # No failure: all benchmarks run one after the other.
    with flying(asked.workers) as workers:
        rows = fly_all(VARIANTS, asked.controller, asked.seed, asked.transits, asked.out, workers)
    lines = {variant: figures(rows[variant]) for variant in VARIANTS}
    title = f"{asked.controller}, {asked.transits} transits of seed {asked.seed}"
    show(title, HEADINGS, lines, asked.markdown)


if __name__ == "__main__":
    main()
