"""Transits: random starts and goals; each can be drawn again from its seed and number."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Iterator

import numpy as np

from proxops.diagrams.scenario.body import Body, apparent_gravity
from proxops.diagrams.scenario.scenario_config import Scenario
from proxops.diagrams.scenario.tasks import TouchAndGoConfig
from proxops.diagrams.scenario.touchable import touch_ends
from proxops.diagrams.scenario.true_body import TrueBody, UnflyableWorldError
from proxops.systems.common import InputError, Values, Vector3, Vectors3, generator
from proxops.systems.gravity import moon_position
from proxops.systems.shapes import blocks_segment, clearances

# Of every ten transits, the ones with these numbers are blocked by the keep-out ellipsoid.
_BLOCKED = (1, 4, 7)
_MASS = "spacecraft.mass_kg"
# Draws before the search for a transit is given up.
_ATTEMPTS = 100_000
# Control steps from one look at where moons are to the next.
_LOOKS = 5


@dc.dataclass(frozen=True)
class Transit:
    """A transit from `start` to rest in K at `goal`, both positions (3,) in K, in m."""

    seed: int
    index: int
    start: np.ndarray
    goal: np.ndarray
    start_velocity: Vector3 = dc.field(default_factory=lambda: np.zeros(3))
    """Velocity (3,) in K at the start, in m/s; by default the spacecraft is at rest in K."""


def of_transit(scenario: Scenario, seed: int, index: int) -> Scenario:
    """Gives a copy of the scenario that flies transit number `index` of a seed."""
    transit = dc.replace(scenario.transit, seed=seed, index=index, start_m=None, goal_m=None)
    return dc.replace(scenario, transit=transit)


def with_ends(
    scenario: Scenario, start: Vector3, goal: Vector3, velocity: Vector3 | None = None
) -> Scenario:
    """Gives a copy of the scenario whose transit has these ends.

    Args:
      scenario: the scenario; its transit keeps seed and number.
      start, goal: positions (3,) in K, in m.
      velocity: (3,) in K at the start, in m/s; None: that of the scenario.
    """
    transit = dc.replace(scenario.transit, start_m=start.tolist(), goal_m=goal.tolist())
    if velocity is not None:
        transit.start_velocity_m_s = velocity.tolist()
    return dc.replace(scenario, transit=transit)


def is_blocked(index: int) -> bool:
    """Tells whether the keep-out ellipsoid blocks the straight line of transit number `index`."""
    return index % 10 in _BLOCKED


def draw_transit(seed: int, index: int, scenario: Scenario, body: Body) -> Transit:
    """Draws transit number `index` of a seed; the result depends on the arguments alone.

    Starts and goals are uniform in the scenario's cube, outside the keep-out ellipsoid with the
    end clearance added to each semi-axis, and at a distance from each other that the scenario
    permits. Hovering there takes at most the permitted share of the thrust limit. The ellipsoid
    blocks the straight line of three transits in ten, and of no other.

    Raises:
      InputError: no transit was found, because the cube, the distances or the thrust do not fit
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
        share = hover_force(np.stack([start, goal]), scenario.spacecraft.mass_kg, body).max()
        if share <= rules.max_hover_share * scenario.spacecraft.thrust_limit_n:
            return Transit(seed, index, start, goal)
    raise InputError(
        f"no transit was found in {_ATTEMPTS} draws: check transit.cube_m, min_distance_m, "
        "max_distance_m, end_clearance_m and max_hover_share against the body's size and the "
        "spacecraft's thrust"
    )


def hover_force(positions: Vectors3, mass: float, body: Body) -> Values:
    """Gives the greatest force per axis (N,), in N, that hovering takes.

    Args:
      positions: (N, 3) in K, in m.
      mass: of the spacecraft, in kg.
      body: gives gravity and spin.
    """
    gravity = body.gravity_field.evaluate(positions).acceleration
    return mass * np.abs(apparent_gravity(gravity, positions, body.spin)).max(axis=1)


def _met_by_moons(scenario: Scenario, body: Body, ends: Vectors3) -> Iterator[str]:
    """Yields a sentence for each end (2, 3) of a transit that a moon's ball meets in time.

    Nothing on board avoids moons; the ways between the ends are not looked at.
    """
    arrival, period = scenario.arrival, scenario.control_period_s
    times = np.arange(0.0, arrival.deadline_s + arrival.dwell_s, _LOOKS * period)
    for moon in body.moons:
        way = np.array([moon_position(moon.config, time, body.spin) for time in times])
        away = np.linalg.norm(way[:, None] - ends, axis=2)
        # Its start is left at once, its goal is kept.
        for name, gone in (("start", away[:1, 0]), ("goal", away[:, 1])):
            if gone.min() < moon.config.radius_m:
                yield (
                    f"the {name} is {gone.min():.4g} m from the centre of a moon of "
                    f"{body.config.name} at {times[gone.argmin()]:.0f} s, within its ball of "
                    f"{moon.config.radius_m:g} m, which nothing on board avoids"
                )


def scenario_transit(scenario: Scenario, body: Body) -> Transit:
    """Gives the transit of a scenario: its given start and goal, or one that is drawn.

    That of a touch-and-go, whose site is a position, begins near home and leads there.

    Raises:
      UnflyableWorldError: hovering at the start or goal exceeds the thrust limit, with a mass that
        was drawn for this flight.
      InputError: the start or goal is inside the body or the keep-out ellipsoid, hovering there
        exceeds the thrust limit, or no transit was found (see `draw_transit`).
    """
    rules = scenario.transit
    if isinstance(scenario.task, TouchAndGoConfig):
        return _way_home(scenario, body, scenario.task)
    velocity = np.array(rules.start_velocity_m_s or [0.0, 0.0, 0.0], dtype=np.float64)
    if rules.start_m is None or rules.goal_m is None:
        drawn = draw_transit(rules.seed, rules.index, scenario, body)
        for complaint in _met_by_moons(scenario, body, np.stack([drawn.start, drawn.goal])):
            raise UnflyableWorldError(complaint)
        return dc.replace(drawn, start_velocity=velocity)
    start = np.array(rules.start_m, dtype=np.float64)
    goal = np.array(rules.goal_m, dtype=np.float64)
    ends = np.stack([start, goal])
    inside = body.gravity_field.evaluate(ends).inside
    depth = -clearances(body.keep_out_semi_axes, ends)
    force = hover_force(ends, scenario.spacecraft.mass_kg, body)
    limit = scenario.spacecraft.thrust_limit_n
    for complaint in _met_by_moons(scenario, body, ends):
        raise InputError(f"transit: {complaint}")
    for k, name in enumerate(("start_m", "goal_m")):
        where = f"transit.{name} = {ends[k].tolist()}"
        if inside[k]:
            raise InputError(f"{where} is inside {body.config.name}")
        if depth[k] > 0.0:
            raise InputError(f"{where} is {depth[k] / 1e3:.3g} km inside the keep-out ellipsoid")
        if force[k] > limit:
            # Of a mass that was drawn, only this flight is to blame: a campaign goes on.
            drawn = _MASS in scenario.dispersed
            raise (UnflyableWorldError if drawn else InputError)(
                f"{where} cannot be held: hovering there takes {force[k]:.3g} N per axis, but the "
                f"thrusters give only {limit:.3g} N"
            )
    return Transit(rules.seed, rules.index, start, goal, velocity)


def _way_home(scenario: Scenario, body: Body, task: TouchAndGoConfig) -> Transit:
    """Where a touch-and-go begins, which may be within the keep-out ellipsoid, and its home.

    Raises:
      InputError: a transit should come first, and its home is where the MPC does not go.
    """
    rules = scenario.transit
    start, home = touch_ends(scenario, body)
    velocity = np.array(rules.start_velocity_m_s or [0.0, 0.0, 0.0], dtype=np.float64)
    if task.transit:
        if rules.start_m is None:
            start = draw_transit(rules.seed, rules.index, scenario, body).start
        clearance = float(clearances(body.keep_out_semi_axes, home[None])[0])
        lacking = scenario.mpc.keep_out_margin_m - clearance
        if lacking > 0.0:
            lower = f"mpc.keep_out_margin_m below {clearance:.3g}, or " if clearance > 0.0 else ""
            raise InputError(
                f"home, {task.descent.home_m:g} m above the place, is {lacking:.3g} m too near for "
                f"a transit, which keeps mpc.keep_out_margin_m, {scenario.mpc.keep_out_margin_m:g} "
                f"m, away from the keep-out ellipsoid: set {lower}task.descent.home_m (of a "
                "mission, task.touch.descent.home_m) higher, or choose another task.site"
            )
    return Transit(rules.seed, rules.index, start, home, velocity)


def check_flyable(true_body: TrueBody, transit: Transit, scenario: Scenario) -> None:
    """Checks that a spacecraft can be at rest at both ends of a transit in the true world.

    Raises:
      UnflyableWorldError: the start or the goal is inside the true body, or hovering there takes
        more than the true thrust; the message says which.
    """
    truth, craft = scenario.truth, scenario.spacecraft
    ends = np.stack([transit.start, transit.goal])
    inside = true_body.gravity_field.evaluate(ends).inside
    need = truth.mass * craft.mass_kg * np.abs(true_body.apparent_gravity(ends))
    limit = craft.thrust_limit_n * np.array(truth.thrusters.scale)
    for k, name in enumerate(("start", "goal")):
        if inside[k]:
            raise UnflyableWorldError(f"the {name} is inside the true body")
        axis = int(np.argmax(need[k] - limit))
        if need[k][axis] > limit[axis]:
            raise UnflyableWorldError(
                f"hovering at the {name} takes {need[k][axis]:.3g} N along {'xyz'[axis]}, but the "
                f"true thrusters give {limit[axis]:.3g} N"
            )
