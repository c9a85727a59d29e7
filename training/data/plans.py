"""The expert's plans as labels: one solution labels the states at all knots of the plan.

The rest of an expert's plan is its plan from there (see `TransitProgram`). So the force that begins
at a knot is the expert's command in the knot's state, except close to the goal: see `labels_of`.
The later knots are states that successful flights pass through.
"""

from __future__ import annotations

import dataclasses as dc
import functools
from pathlib import Path

import numpy as np

from proxops.diagrams.flight import Provenance, Workers, make_mpc
from proxops.diagrams.scenario import Body, Scenario, dump_scenario, load_body, parse_scenario
from proxops.systems.common import InputError, SolverFailure, derived_seed, generator
from proxops.systems.expert import Plan, PlanProgram
from proxops.systems.shapes import blocks_segment
from proxops.training.data.label_files import Labels, joined_labels, kept_labels, labels_of
from proxops.training.data.scaling import body_length, scaling_for

# Transits whose plans are computed, and kept in one file, together.
_PORTION = 50
# Solutions for one transit: from its start, and from states off its plan.
_SOLUTIONS = 6
# Share of the solutions that start near the end of the plan, within this many least horizons of it:
# precision counts there, and knots are no labels.
_LATE, _LATE_HORIZONS = 0.3, 3.0
# Solutions start this far from the plan: limits of log-uniform standard deviations, at Kleopatra in
# m and m/s (see `Scaling`). How often the program is linearised from there: after four times it has
# converged in nine cases of ten.
_POSITION_OFF, _SPEED_OFF = (30.0, 6e3), (0.03, 4.0)
_ITERATIONS = 4
# Share of transits that the ellipsoid blocks: few random ones are, and those are hard.
_BLOCKED_SHARE = 0.65
# After this many draws a transit may be of either kind: a body of another shape may have only one.
_DRAWS, _MOST_DRAWS = 500, 100_000
_STREAM = 5


@dc.dataclass(frozen=True)
class Portion:
    """Transits whose plans are computed together."""

    name: str
    scenario: str
    body: str
    """The version of proxops and the body, as `Provenance` writes them."""
    seed: int
    first: int
    count: int

    @property
    def origin(self) -> str:
        """Names all that the plans depend on; the body by its content, so that folders may move."""
        scenario = parse_scenario(self.scenario)
        parts = scenario.spacecraft, scenario.mpc, scenario.transit
        count = f"{self.first}, {self.count}, {self.seed}"
        return f"{self.body}, share {_BLOCKED_SHARE} blocked, of {count}, {parts}"

    def compute(self) -> Labels:
        """Computes the plans; gives the labels at their knots."""
        scenario = parse_scenario(self.scenario)
        body = _body(scenario.body, self.body)
        program = make_mpc(scenario, body).program
        plans = []
        for index in range(self.first, self.first + self.count):
            plans += transit_plans(program, scenario, body, self.seed, index)
        return labels_of(plans, scenario.mpc.min_horizon_s)


# Bodies are large, so each worker loads them once. Where the file has changed, so has the content.
@functools.lru_cache(maxsize=1)
def _body(name: str, content: str) -> Body:
    return load_body(name)


def expert_plans(
    scenario: Scenario,
    seed: int,
    transits: int,
    folder: Path,
    workers: Workers = Workers(),
) -> Labels:
    """States (N, 6), goals (N, 3) and the expert's forces (N, 3) there, in K and SI.

    Transits are random, and the ellipsoid blocks two in three of them. Each is a function of
    (scenario, seed, number). Plans are kept in `folder`, in portions, and are not computed again.

    Args:
      workers: compute the plans, and report how many transits are ready.

    Raises:
      InputError: a file in the folder is damaged or holds other plans.
    """
    portions = portions_of(scenario, seed, transits)
    return joined_labels(kept_labels(portions, folder, workers, "plans of transits"))


def portions_of(scenario: Scenario, seed: int, transits: int, name: str = "plans") -> list[Portion]:
    """The transits 0 ... transits - 1 of a scenario and a seed, in portions.

    Args:
      scenario: in which they are flown.
      seed: of the transits.
      transits: number of transits.
      name: with it begin the names of the portions' files, which must differ in a folder.

    Raises:
      InputError: see `load_body`.
    """
    text, body = dump_scenario(scenario), str(Provenance.of(load_body(scenario.body)))
    return [
        Portion(
            f"{name}-{seed}-{first:06d}", text, body, seed, first, min(_PORTION, transits - first)
        )
        for first in range(0, transits, _PORTION)
    ]


def transit_plans(
    program: PlanProgram, scenario: Scenario, body: Body, seed: int, index: int
) -> list[Plan]:
    """Plans of one random transit: from its start, and from states near that plan."""
    random = generator(derived_seed(seed, _STREAM), index)
    start, goal = _ends(random, scenario, body)
    target = np.append(goal, np.zeros(3))
    moving = random.random() < 0.3
    speed = 0.2 * scenario.spacecraft.speed_limit_m_s * moving
    try:
        first = program.solve(
            np.append(start, speed * random.standard_normal(3)),
            target,
            iterations=scenario.mpc.cold_iterations,
        )
    except SolverFailure:
        return []
    craft = scenario.spacecraft
    scaling = scaling_for(body_length(body.keep_out_semi_axes), craft.mass_kg, craft.thrust_limit_n)
    late_time = _LATE_HORIZONS * scenario.mpc.min_horizon_s
    plans = [first]
    for _ in range(_SOLUTIONS - 1):
        late = random.random() < _LATE
        end = first.times[-1]
        age = end - late_time * random.random() if late else end * random.random()
        state = first.states_at(np.array([max(age, 0.0)]))[0]
        for part, (low, high), unit in (
            (slice(3), _POSITION_OFF, scaling.length),
            (slice(3, 6), _SPEED_OFF, scaling.speed),
        ):
            spread = unit * low * (high / low) ** random.random()
            state[part] += spread * random.standard_normal(3)
        try:
            plans.append(program.solve(state, target, first, max(age, 0.0), iterations=_ITERATIONS))
        except SolverFailure:
            continue
    return plans


def _ends(
    random: np.random.Generator, scenario: Scenario, body: Body
) -> tuple[np.ndarray, np.ndarray]:
    """Start and goal (3,) in m of a random transit."""
    axes, half = body.keep_out_semi_axes, 0.5 * scenario.transit.cube_m
    wide = axes + scenario.mpc.keep_out_margin_m
    blocked = random.random() < _BLOCKED_SHARE
    draws = 0
    while True:
        draws += 1
        if draws > _MOST_DRAWS:
            raise InputError(
                f"no start and goal were found in transit.cube_m ({2.0 * half:g} m) that lie "
                "outside of the keep-out ellipsoid with its margin, "
                f"of semi-axes {np.round(wide)} m"
            )
        start, goal = random.uniform(-half, half, (2, 3))
        near = np.linalg.norm(goal - start) < 1.15 * scenario.transit.max_distance_m
        outside = min(np.linalg.norm(start / wide), np.linalg.norm(goal / wide)) > 1.0
        if not (near and outside):
            continue
        if draws > _DRAWS or blocks_segment(axes, start, goal) == blocked:
            return start, goal
