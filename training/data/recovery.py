"""The kinds of expert flights that a training set is made of, and the mixes of them.

A policy that has only seen an expert fly well does not know what to do where the expert never is.
So most flights are disturbed, or start where something has gone wrong already; the label stays
what the expert commands there.
"""

from __future__ import annotations

import dataclasses as dc
import math
from collections.abc import Callable, Mapping

import numpy as np

from proxops.diagrams.scenario import (
    Body,
    ForceNoiseConfig,
    KicksConfig,
    RandomWalkDisturbanceConfig,
    Scenario,
    Transit,
    draw_transit,
    hover_force,
    of_transit,
)
from proxops.systems.common import InputError, derived_seed, generator
from proxops.systems.shapes import clearances, closest_point

MIXES = {
    "paper": {"nominal": 1, "random_walk": 3},
    "full": {
        "nominal": 3, "random_walk": 3, "noise": 4, "kicks": 2, "overshoot": 3, "keep_out": 2,
        "holding": 3,
    },
}  # fmt: skip
"""Named mixes: shares of the kinds."""

# Share of the thrust limit that a start leaves for braking before the keep-out ellipsoid.
_BRAKING_SHARE = 0.35
_ATTEMPTS = 10_000


def parse_mix(text: str) -> dict[str, int]:
    """A mix by its name, or from `kind=weight,kind=weight` with whole weights.

    Raises:
      InputError: an unknown name or kind, or weights that are none.
    """
    if text in MIXES:
        return dict(MIXES[text])
    mix: dict[str, int] = {}
    for part in text.split(","):
        kind, equals, weight = (word.strip() for word in part.partition("="))
        if not equals and kind not in KINDS:
            raise InputError(
                f"mix {text!r}: {kind!r} is none; name one of {', '.join(MIXES)}, or give "
                f"kind=weight with kinds of {', '.join(KINDS)}"
            )
        if kind not in KINDS:
            raise InputError(f"mix {text!r}: no kind {kind!r}; there are {', '.join(KINDS)}")
        if kind in mix:
            raise InputError(f"mix {text!r} names {kind} twice")
        if not weight.isascii() or not weight.isdigit():
            raise InputError(f"mix {text!r}: the weight of {kind} must be a whole number")
        mix[kind] = int(weight)
    if not 0 < sum(mix.values()) <= 10_000:
        raise InputError(f"mix {text!r}: the weights must come to between 1 and 10,000")
    return mix


def kind_of(mix: Mapping[str, int], index: int) -> str:
    """The kind of flight number `index`: a function of mix and index alone.

    The kinds follow each other in a cycle as long as the sum of the weights, in which each is as
    evenly spread as can be. As transits repeat a pattern every ten, the cycle is shifted by one
    each time that both begin together: in the long run each kind meets each sort of transit alike.
    """
    length = sum(mix.values())
    cycle: list[str] = []
    for place in range(1, length + 1):
        # The one that is furthest behind its share, the first of them if several are.
        behind = {kind: place * weight - length * cycle.count(kind) for kind, weight in mix.items()}
        cycle.append(max(behind, key=lambda kind: behind[kind]))
    return cycle[(index + index // math.lcm(length, 10)) % length]


def flight_scenario(kind: str, scenario: Scenario, body: Body, seed: int, index: int) -> Scenario:
    """The scenario of an expert flight of a kind: a function of its arguments alone.

    Goals are those of `transit_set(seed)`. What disturbs a flight has the settings that `scenario`
    has for it, or the usual ones: for the default spacecraft the defaults, for others in proportion
    to its thrust, speed limit and control period. What belongs to other kinds is left out.

    Raises:
      InputError: the scenario has no such transit or start.
    """
    plain = dc.replace(
        at_rest(of_transit(scenario, seed, index)), disturbance=None, force_noise=None, kicks=None
    )
    return KINDS[kind](plain, scenario, body)


def at_rest(scenario: Scenario) -> Scenario:
    """The scenario, its flight begun at rest in K."""
    return dc.replace(scenario, transit=dc.replace(scenario.transit, start_velocity_m_s=None))


def _nominal(plain: Scenario, wanted: Scenario, body: Body) -> Scenario:
    """As the expert flies it."""
    return plain


def _random_walk(plain: Scenario, wanted: Scenario, body: Body) -> Scenario:
    """With the paper's disturbance, which scales with the command."""
    thrust, period = plain.spacecraft.thrust_limit_n, plain.control_period_s
    usual = RandomWalkDisturbanceConfig(reset_period_s=10.0 * period, increment_std_n=thrust / 14.0)
    return dc.replace(plain, disturbance=wanted.disturbance or usual)


def _noise(plain: Scenario, wanted: Scenario, body: Body) -> Scenario:
    """With noise of its own size on the command."""
    thrust, period = plain.spacecraft.thrust_limit_n, plain.control_period_s
    usual = ForceNoiseConfig(std_n=thrust / 10.0, correlation_time_s=10.0 * period)
    return dc.replace(plain, force_noise=wanted.force_noise or usual)


def _kicks(plain: Scenario, wanted: Scenario, body: Body) -> Scenario:
    """With pushes from outside."""
    speed, period = plain.spacecraft.speed_limit_m_s, plain.control_period_s
    usual = KicksConfig(velocity_std_m_s=speed / 20.0, mean_interval_s=90.0 * period)
    return dc.replace(plain, kicks=wanted.kicks or usual)


def _overshoot(plain: Scenario, wanted: Scenario, body: Body) -> Scenario:
    """As if the goal had been flown past: beyond it on the line of flight, moving away.

    The distance is uniform up to `transit.end_clearance_m` (8 km), the speed up to 8 times
    `arrival.speed_m_s`; both turn from the line by some 15 degrees.
    """
    drawn, random = _draw(plain, body, "overshoot")
    line = (drawn.goal - drawn.start) / np.linalg.norm(drawn.goal - drawn.start)
    for _ in range(_ATTEMPTS):
        ways = line + 0.15 * random.standard_normal((2, 3))
        ways /= np.linalg.norm(ways, axis=1, keepdims=True)
        place = drawn.goal + plain.transit.end_clearance_m * random.random() * ways[0]
        velocity = 8.0 * plain.arrival.speed_m_s * random.random() * ways[1]
        if (ways @ line > 0.5).all() and _can_start(place, velocity, plain, body):
            return _starting(plain, drawn, place, velocity)
    raise _no_start("overshoot", drawn)


def _keep_out(plain: Scenario, wanted: Scenario, body: Body) -> Scenario:
    """Near the keep-out ellipsoid, at a clearance uniform up to `transit.end_clearance_m` (8 km).

    The velocity per axis is normal with an eighth of the speed limit (5 m/s), but never so much
    towards the ellipsoid that a third of the thrust could not stop it outside. It is no nearer the
    goal than `transit.min_distance_m`, nor further than `transit.max_distance_m`, unless the goal
    is nearly as far from all of the ellipsoid.
    """
    drawn, random = _draw(plain, body, "keep_out")
    axes, rules = body.keep_out_semi_axes, plain.transit
    nearest = float(clearances(axes, drawn.goal[None])[0])
    furthest = max(rules.max_distance_m, 1.25 * nearest + rules.end_clearance_m)
    for _ in range(_ATTEMPTS):
        way = random.standard_normal(3)
        surface = axes * way / np.linalg.norm(way)
        normal = surface / axes**2 / np.linalg.norm(surface / axes**2)
        # Along the normal of a convex surface the clearance is the distance gone.
        place = surface + rules.end_clearance_m * random.random() * normal
        velocity = plain.spacecraft.speed_limit_m_s / 8.0 * random.standard_normal(3)
        distance = float(np.linalg.norm(place - drawn.goal))
        fits = rules.min_distance_m <= distance <= furthest
        if fits and _can_start(place, velocity, plain, body):
            return _starting(plain, drawn, place, velocity)
    raise _no_start("keep_out", drawn)


def _holding(plain: Scenario, wanted: Scenario, body: Body) -> Scenario:
    """At the goal, uniform in place and velocity within the radius and speed of arrival."""
    drawn, random = _draw(plain, body, "holding")
    ways = random.standard_normal((2, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    reaches = np.array([plain.arrival.radius_m, plain.arrival.speed_m_s])
    away = (reaches * np.cbrt(random.random(2)))[:, None] * ways
    return _starting(plain, drawn, drawn.goal + away[0], away[1])


KINDS: dict[str, Callable[[Scenario, Scenario, Body], Scenario]] = {
    "nominal": _nominal,
    "random_walk": _random_walk,
    "noise": _noise,
    "kicks": _kicks,
    "overshoot": _overshoot,
    "keep_out": _keep_out,
    "holding": _holding,
}
"""Each makes the scenario of a flight from the plain transit, the scenario wanted, and the body."""


def _draw(plain: Scenario, body: Body, kind: str) -> tuple[Transit, np.random.Generator]:
    """The transit whose goal is flown to, and the numbers that the start is drawn from."""
    seed, index = plain.transit.seed, plain.transit.index
    stream = list(KINDS).index(kind)
    return draw_transit(seed, index, plain, body), generator(derived_seed(seed, stream), index)


def _can_start(place: np.ndarray, velocity: np.ndarray, plain: Scenario, body: Body) -> bool:
    """Whether a flight may start so: it can hover there, and stop before the keep-out ellipsoid."""
    craft = plain.spacecraft
    if np.abs(velocity).max() > craft.speed_limit_m_s:
        return False
    axes = body.keep_out_semi_axes
    clearance = float(clearances(axes, place[None])[0])
    if clearance <= 0.0:
        return False
    if hover_force(place[None], plain, body)[0] > plain.transit.max_hover_share * (
        craft.thrust_limit_n
    ):
        return False
    outward = place - closest_point(axes, place)
    inward_speed = max(0.0, -float(velocity @ outward) / float(np.linalg.norm(outward)))
    braking = _BRAKING_SHARE * craft.thrust_limit_n / craft.mass_kg
    return inward_speed**2 / (2.0 * braking) < clearance


def _starting(plain: Scenario, drawn: Transit, place: np.ndarray, velocity: np.ndarray) -> Scenario:
    transit = dc.replace(
        plain.transit,
        start_m=place.tolist(),
        goal_m=drawn.goal.tolist(),
        start_velocity_m_s=velocity.tolist(),
    )
    return dc.replace(plain, transit=transit)


def _no_start(kind: str, drawn: Transit) -> InputError:
    return InputError(
        f"no start was found for flight {drawn.index} of seed {drawn.seed}, kind {kind}: check "
        "transit.end_clearance_m, arrival.speed_m_s and the spacecraft's thrust"
    )
