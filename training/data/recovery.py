"""The kinds of expert flights in a training set, and mixes of kinds.

A policy that has only seen an expert fly well does not know what to do in states that the expert
avoids. So most flights are disturbed, or start after something has gone wrong. The label is always
the expert's command.
"""

from __future__ import annotations

import dataclasses as dc
import math
from collections.abc import Callable, Mapping
from typing import Any

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
    with_ends,
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
"""Named mixes: weights of the kinds."""
KINDS = tuple(MIXES["full"])
"""All kinds. The paper's random walk scales with the command, noise does not; kicks change the
velocity at once; the others begin where something has gone wrong, or at the goal."""

# Share of the thrust limit that a start leaves for braking before the keep-out ellipsoid.
_BRAKING_SHARE = 0.35
_ATTEMPTS = 10_000


def parse_mix(text: str) -> dict[str, int]:
    """Reads a mix: its name, or `kind=weight,kind=weight` with whole numbers as weights.

    Raises:
      InputError: there is no such name or kind, or a weight is no whole number.
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


def check_disturbances(scenario: Scenario, mix: Mapping[str, int]) -> None:
    """Raises `InputError` if a scenario has a disturbance that no flight of a mix would have."""
    for key, kind in (("disturbance", "random_walk"), ("force_noise", "noise"), ("kicks", "kicks")):
        if getattr(scenario, key) is not None and not mix.get(kind):
            raise InputError(
                f"the scenario has {key}, which only flights of kind {kind} have, and there are "
                f"none in the mix: give --recovery with {kind}, or leave out {key}"
            )


def kind_of(mix: Mapping[str, int], index: int) -> str:
    """The kind of flight number `index`; it depends on the mix and the index alone.

    The kinds repeat in a cycle whose length is the sum of the weights. In the cycle each kind is
    spread as evenly as possible. Blocked and clear transits repeat every ten, so the cycle shifts
    by one whenever both begin together: in the long run each kind gets each sort of transit equally
    often.
    """
    length = sum(mix.values())
    cycle: list[str] = []
    for place in range(1, length + 1):
        # The kind that is furthest behind its share; of several such kinds the first.
        behind = {kind: place * weight - length * cycle.count(kind) for kind, weight in mix.items()}
        cycle.append(max(behind, key=lambda kind: behind[kind]))
    return cycle[(index + index // math.lcm(length, 10)) % length]


def flight_scenario(kind: str, scenario: Scenario, body: Body, seed: int, index: int) -> Scenario:
    """The scenario of an expert flight of a kind; it depends on the arguments alone.

    Goals are those of the transits of `seed`. A disturbance has the settings in `scenario`. Without
    any, it has the default ones, in proportion to the spacecraft's thrust, speed limit and control
    period. Disturbances that belong to other kinds are left out.

    Raises:
      InputError: no such transit or start is found in the scenario.
    """
    plain = dc.replace(
        at_rest(of_transit(scenario, seed, index)), disturbance=None, force_noise=None, kicks=None
    )
    if kind in _STARTS:
        return _STARTS[kind](plain, body)
    return dc.replace(plain, **_disturbances(plain, scenario)[kind])


def _disturbances(plain: Scenario, wanted: Scenario) -> dict[str, dict[str, Any]]:
    """What the scenario has in flights of a kind: the disturbances asked for, or the usual ones."""
    thrust, speed = plain.spacecraft.thrust_limit_n, plain.spacecraft.speed_limit_m_s
    period = plain.control_period_s
    walk = RandomWalkDisturbanceConfig(reset_period_s=10.0 * period, increment_std_n=thrust / 14.0)
    noise = ForceNoiseConfig(std_n=thrust / 10.0, correlation_time_s=10.0 * period)
    kicks = KicksConfig(velocity_std_m_s=speed / 20.0, mean_interval_s=90.0 * period)
    return {
        "nominal": {},
        "random_walk": {"disturbance": wanted.disturbance or walk},
        "noise": {"force_noise": wanted.force_noise or noise},
        "kicks": {"kicks": wanted.kicks or kicks},
    }


def at_rest(scenario: Scenario) -> Scenario:
    """The scenario with a flight that begins at rest in K."""
    return dc.replace(scenario, transit=dc.replace(scenario.transit, start_velocity_m_s=None))


def _overshoot(plain: Scenario, body: Body) -> Scenario:
    """A flight that begins behind the goal, as seen from the start, and moves away from it.

    The distance is uniform up to `transit.end_clearance_m` (8 km), and the speed up to 8 times
    `arrival.speed_m_s`. Both directions are some 10 degrees off the line from start to goal.
    """
    drawn, random = _draw(plain, body, "overshoot")
    line = (drawn.goal - drawn.start) / np.linalg.norm(drawn.goal - drawn.start)
    for _ in range(_ATTEMPTS):
        ways = line + 0.15 * random.standard_normal((2, 3))
        ways /= np.linalg.norm(ways, axis=1, keepdims=True)
        place = drawn.goal + plain.transit.end_clearance_m * random.random() * ways[0]
        velocity = 8.0 * plain.arrival.speed_m_s * random.random() * ways[1]
        if (ways @ line > 0.5).all() and _can_start(place, velocity, plain, body):
            return with_ends(plain, place, drawn.goal, velocity)
    raise _no_start("overshoot", drawn)


def _keep_out(plain: Scenario, body: Body) -> Scenario:
    """A flight that begins near the keep-out ellipsoid, at up to `transit.end_clearance_m` (8 km).

    The clearance is uniform. The velocity per axis is normal, with an eighth of the speed limit
    (5 m/s) as standard deviation; a third of the thrust can always stop the spacecraft outside the
    ellipsoid. The start is between `transit.min_distance_m` and `transit.max_distance_m` from the
    goal, or farther if the goal is that far from the whole ellipsoid.
    """
    drawn, random = _draw(plain, body, "keep_out")
    axes, rules = body.keep_out_semi_axes, plain.transit
    nearest = float(clearances(axes, drawn.goal[None])[0])
    furthest = max(rules.max_distance_m, 1.25 * nearest + rules.end_clearance_m)
    for _ in range(_ATTEMPTS):
        way = random.standard_normal(3)
        surface = axes * way / np.linalg.norm(way)
        normal = surface / axes**2 / np.linalg.norm(surface / axes**2)
        # Along the normal of a convex surface the clearance is the distance from it.
        place = surface + rules.end_clearance_m * random.random() * normal
        velocity = plain.spacecraft.speed_limit_m_s / 8.0 * random.standard_normal(3)
        distance = float(np.linalg.norm(place - drawn.goal))
        fits = rules.min_distance_m <= distance <= furthest
        if fits and _can_start(place, velocity, plain, body):
            return with_ends(plain, place, drawn.goal, velocity)
    raise _no_start("keep_out", drawn)


def _holding(plain: Scenario, body: Body) -> Scenario:
    """A flight that begins at the goal: uniform within the radius and the speed of arrival."""
    drawn, random = _draw(plain, body, "holding")
    ways = random.standard_normal((2, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    reaches = np.array([plain.arrival.radius_m, plain.arrival.speed_m_s])
    away = (reaches * np.cbrt(random.random(2)))[:, None] * ways
    return with_ends(plain, drawn.goal + away[0], drawn.goal, away[1])


_STARTS: dict[str, Callable[[Scenario, Body], Scenario]] = {
    "overshoot": _overshoot,
    "keep_out": _keep_out,
    "holding": _holding,
}


def _draw(plain: Scenario, body: Body, kind: str) -> tuple[Transit, np.random.Generator]:
    """The transit with the goal, and the generator from which the start is drawn."""
    seed, index = plain.transit.seed, plain.transit.index
    stream = KINDS.index(kind)
    return draw_transit(seed, index, plain, body), generator(derived_seed(seed, stream), index)


def _can_start(place: np.ndarray, velocity: np.ndarray, plain: Scenario, body: Body) -> bool:
    """Whether the spacecraft can hover there, and stop before the keep-out ellipsoid."""
    craft = plain.spacecraft
    if np.abs(velocity).max() > craft.speed_limit_m_s:
        return False
    axes = body.keep_out_semi_axes
    clearance = float(clearances(axes, place[None])[0])
    if clearance <= 0.0:
        return False
    most = plain.transit.max_hover_share * craft.thrust_limit_n
    if hover_force(place[None], craft.mass_kg, body)[0] > most:
        return False
    outward = place - closest_point(axes, place)
    inward_speed = max(0.0, -float(velocity @ outward) / float(np.linalg.norm(outward)))
    braking = _BRAKING_SHARE * craft.thrust_limit_n / craft.mass_kg
    return inward_speed**2 / (2.0 * braking) < clearance


def _no_start(kind: str, drawn: Transit) -> InputError:
    return InputError(
        f"no start was found for flight {drawn.index} of seed {drawn.seed}, kind {kind}: check "
        "transit.end_clearance_m, arrival.speed_m_s and the spacecraft's thrust"
    )
