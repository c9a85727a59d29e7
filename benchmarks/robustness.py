"""Shows how a policy flies where it was not trained: worse lidar, another plant, other starts.

Every variant flies the transits of one seed to the same goals, with the same noise. In the first
variants the lidar is worse, or the plant differs from the one that the policy learned from; in the
last three the flight starts where no transit of the set starts. Flights are kept in the folder of
`--out`: run the command again to finish what was interrupted, or to add transits.

    python benchmarks/robustness.py [--controller policy] [--transits 50] [--seed 10001]
        [--workers N] [--out out/robustness] [--markdown table.md]

`--controller` takes the names that `proxops evaluate` takes: `policy:out/mine/bundle`, or `mpc` for
the expert under the same conditions. Give each controller a folder of its own.
"""

import os
from collections.abc import Callable, Sequence

for name in ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[name] = "1"

import numpy as np
from _campaign import campaign_parser, fly_with_bar, show

from proxops.diagrams.flight import Row
from proxops.diagrams.scenario import Body, Scenario, Transit, hover_force, load_scenario
from proxops.studies.evaluation import Variant
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


def variants(controller: str) -> list[Variant]:
    """All lines of the table, in order."""
    settings = [Variant(name, controller, changes) for name, changes in SETTINGS.items()]
    return settings + [Variant(name, controller, start=start) for name, start in STARTS.items()]


def _random(variant: str, transit: Transit) -> np.random.Generator:
    """Random numbers for one start; they depend on variant, seed and number of the transit."""
    stream = list(STARTS).index(variant)
    return generator(derived_seed(transit.seed, 1 + stream), transit.index)


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
    parser = campaign_parser(__doc__, "out/robustness", transits=50, seed=10001)
    parser.add_argument("--controller", default="policy")
    asked = parser.parse_args()
    scenario = load_scenario(None, {"log_ranges": False})
    rows = fly_with_bar(variants(asked.controller), scenario, asked)
    lines = {name: figures(flown) for name, flown in rows.items()}
    title = f"{asked.controller}, {asked.transits} transits of seed {asked.seed}"
    show(title, HEADINGS, lines, asked.markdown)


if __name__ == "__main__":
    main()
