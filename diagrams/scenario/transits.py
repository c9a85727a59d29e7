"""The transits that are flown: random starts and goals, reproducible one by one."""

from __future__ import annotations

import dataclasses as dc

import numpy as np

from proxops.diagrams.scenario.body import Body, load_body
from proxops.diagrams.scenario.scenario import Scenario
from proxops.systems.common import InputError, generator
from proxops.systems.shapes import blocks_segment, clearances

# Of ten transits, these have the ellipsoid between start and goal.
_BLOCKED = (1, 4, 7)
_ATTEMPTS = 100_000


@dc.dataclass(frozen=True)
class Transit:
    """From `start` to rest in K at `goal`, both (3,) in m; at rest in K, unless it says not."""

    seed: int
    index: int
    start: np.ndarray
    goal: np.ndarray
    start_velocity: np.ndarray = dc.field(default_factory=lambda: np.zeros(3))
    """(3,) in m/s."""


def transit_set(seed: int, count: int, scenario: Scenario | None = None) -> list[Transit]:
    """The first `count` transits of a seed; a longer set begins with the shorter.

    Starts and goals are uniform in the scenario's cube, outside the keep-out ellipsoid with the
    end clearance added to each semi-axis, within the scenario's distances of each other, and
    where hovering takes no more than its share of the thrust limit. Three in ten have their
    straight line blocked by the ellipsoid, the others do not.
    """
    scenario = scenario or Scenario()
    body = load_body(scenario.body)
    return [draw_transit(seed, index, scenario, body) for index in range(count)]


def of_transit(scenario: Scenario, seed: int, index: int) -> Scenario:
    """The scenario, to fly transit number `index` of a seed instead of what it flies itself."""
    transit = dc.replace(scenario.transit, seed=seed, index=index, start_m=None, goal_m=None)
    return dc.replace(scenario, transit=transit)


def is_blocked(index: int) -> bool:
    """Whether the keep-out ellipsoid blocks the straight line of transit number `index`."""
    return index % 10 in _BLOCKED


def draw_transit(seed: int, index: int, scenario: Scenario, body: Body) -> Transit:
    """Transit number `index` of a seed: a function of its arguments alone.

    Raises:
      InputError: no such transit was found, so the cube, the distances or the thrust do not fit
        the body.
    """
    rules = scenario.transit
    want_blocked = is_blocked(index)
    random = generator(seed, index)
    for _ in range(_ATTEMPTS):
        start, goal = random.uniform(-0.5 * rules.cube_m, 0.5 * rules.cube_m, (2, 3))
        distance = np.linalg.norm(goal - start)
        if not rules.min_distance_m <= distance <= rules.max_distance_m:
            continue
        if blocks_segment(body.keep_out_semi_axes, start, goal) != want_blocked:
            continue
        outer = body.keep_out_semi_axes + rules.end_clearance_m
        if min(np.linalg.norm(start / outer), np.linalg.norm(goal / outer)) <= 1.0:
            continue
        share = hover_force(np.stack([start, goal]), scenario, body).max()
        if share <= rules.max_hover_share * scenario.spacecraft.thrust_limit_n:
            return Transit(seed, index, start, goal)
    raise InputError(
        f"no transit was found in {_ATTEMPTS} draws: check transit.cube_m, min_distance_m, "
        "max_distance_m, end_clearance_m and max_hover_share against the body's size and the "
        "spacecraft's thrust"
    )


def hover_force(positions: np.ndarray, scenario: Scenario, body: Body) -> np.ndarray:
    """Greatest force per axis (N,), in N, that hovering in K at positions (N, 3) takes."""
    apparent = body.gravity_field.evaluate(positions).acceleration.copy()
    apparent[:, :2] += body.spin_rate**2 * positions[:, :2]
    return scenario.spacecraft.mass_kg * np.abs(apparent).max(axis=1)


def scenario_transit(scenario: Scenario, body: Body) -> Transit:
    """The transit that a scenario asks for: its own start and goal, or one of a set.

    Raises:
      InputError: the start or goal is inside the body or the keep-out ellipsoid, or cannot be
        hovered at.
    """
    rules = scenario.transit
    velocity = np.array(rules.start_velocity_m_s or [0.0, 0.0, 0.0], dtype=np.float64)
    if rules.start_m is None or rules.goal_m is None:
        drawn = draw_transit(rules.seed, rules.index, scenario, body)
        return dc.replace(drawn, start_velocity=velocity)
    start = np.array(rules.start_m, dtype=np.float64)
    goal = np.array(rules.goal_m, dtype=np.float64)
    ends = np.stack([start, goal])
    inside = body.gravity_field.evaluate(ends).inside
    depth = -clearances(body.keep_out_semi_axes, ends)
    force = hover_force(ends, scenario, body)
    limit = scenario.spacecraft.thrust_limit_n
    for k, name in enumerate(("start_m", "goal_m")):
        where = f"transit.{name} = {ends[k].tolist()}"
        if inside[k]:
            raise InputError(f"{where} is inside {body.config.name}")
        if depth[k] > 0.0:
            raise InputError(f"{where} is {depth[k] / 1e3:.3g} km inside the keep-out ellipsoid")
        if force[k] > limit:
            raise InputError(
                f"{where} cannot be held: hovering there takes {force[k]:.3g} N per axis, the "
                f"thrusters give {limit:.3g} N"
            )
    return Transit(rules.seed, rules.index, start, goal, velocity)
