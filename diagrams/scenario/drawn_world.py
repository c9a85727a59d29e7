"""The world of each flight, drawn from the scenario's dispersions."""

from __future__ import annotations

import copy
import hashlib
import typing
from collections.abc import Callable

from proxops.diagrams.scenario.body import Body
from proxops.diagrams.scenario.dispersions import Dispersion, loaded_dispersions
from proxops.diagrams.scenario.dotted_keys import set_value, value_at
from proxops.diagrams.scenario.quantities import KNOWN_ON_THE_DAY, QUANTITY
from proxops.diagrams.scenario.scenario_checks import check_scenario
from proxops.diagrams.scenario.scenario_config import Scenario
from proxops.diagrams.scenario.told_bounds import with_bounds
from proxops.diagrams.scenario.told_errors import errors_of_dispersions
from proxops.diagrams.scenario.transits import scenario_transit
from proxops.systems.common import InputError, derived_seed, generator
from proxops.systems.navigation import LidarNavigationConfig


def draw_world(scenario: Scenario, body: Body) -> Scenario:
    """Draws the world of a scenario's flight from the scenario's dispersions.

    Each draw depends on seed and number of the transit and on the dispersed key alone. The transit
    is the one of the scenario before the draw. The navigation is told the dispersions, as
    `navigation.expected`, and not the draw.

    Args:
      scenario: the scenario.
      body: the body of the scenario.

    Returns:
      The scenario with the drawn values, with their keys in `dispersed`, and without `dispersions`.
      Without dispersions nothing is drawn. The bounds of runtime assurance are values in any case.

    Raises:
      InputError: see `load_dispersions`; or a value may be drawn that is beyond its limits.
    """
    if scenario.dispersions is None:
        return with_bounds(scenario, body, [])
    dispersions = loaded_dispersions(scenario.dispersions)
    check_dispersions(dispersions, scenario, body)

    def drawn(each: Dispersion, uniform: float) -> typing.Any:
        return each.in_its_unit(each.distribution.value(uniform), scenario, body)

    world = world_of(scenario, body, dispersions, drawn)
    world.dispersed = [each.key for each in dispersions if each.is_random]
    check_scenario(world, f"{scenario.dispersions}, transit {scenario.transit.index}")
    return world


def world_of(
    scenario: Scenario,
    body: Body,
    dispersions: typing.Sequence[Dispersion],
    value: Callable[[Dispersion, float], typing.Any],
) -> Scenario:
    """Makes the world of a scenario's flight from random numbers of its transit.

    Args:
      scenario: the scenario.
      body: the body of the scenario.
      dispersions: what is dispersed.
      value: gives the value of a dispersed quantity, or of one number of a list, from a uniform
        random number (0 to 1). The number depends on seed and number of the transit, on the key and
        on the place in the list alone.

    Returns:
      A copy of the scenario with the values, without `dispersions`. Its navigation is told how much
      is dispersed, unless the scenario says what it is to expect. It is not checked.
    """
    transit, world = scenario.transit, copy.deepcopy(scenario)
    if any(each.key in KNOWN_ON_THE_DAY for each in dispersions) and transit.start_m is None:
        # Another mass would permit other transits.
        ends = scenario_transit(scenario, body)
        world.transit.start_m, world.transit.goal_m = ends.start.tolist(), ends.goal.tolist()
    for each in dispersions:
        size = each.size
        values = [
            value(each, _uniform(transit.seed, transit.index, each.key, k))
            for k in range(size or 1)
        ]
        set_value(world, each.key, values[0] if size is None else values)
    if isinstance(world.navigation, LidarNavigationConfig) and world.navigation.expected is None:
        spread = _spread(dispersions, scenario, body)
        world.navigation.expected = errors_of_dispersions(spread, scenario, body)
    world.assurance = with_bounds(scenario, body, dispersions).assurance
    world.dispersions = None
    return world


def dispersed_values(scenario: Scenario) -> dict[str, typing.Any]:
    """Gives the values that were drawn for a scenario, by their keys."""
    return {key: value_at(scenario, key) for key in scenario.dispersed}


def check_dispersions(
    dispersions: typing.Sequence[Dispersion], scenario: Scenario, body: Body
) -> None:
    """Checks that no value can be drawn that is beyond its limits.

    Raises:
      InputError: one can; the message gives the key, the bound and the limit.
    """
    for each in dispersions:
        try:
            unit = each.unit(scenario, body)
        except InputError as error:
            raise InputError(f"{scenario.dispersions}: {error}") from error
        bounds, limits = each.distribution.bounds(), each.limits
        if bounds is None or limits is None:
            continue
        low, high = sorted(unit * bound for bound in bounds)
        for bound, beyond in ((low, low < limits[0]), (high, high > limits[1])):
            if beyond:
                raise InputError(
                    f"{scenario.dispersions}: {each.key} may be drawn as {bound:g}, but it must be "
                    f"from {limits[0]:g} to {limits[1]:g}"
                )


def _spread(
    dispersions: typing.Sequence[Dispersion], scenario: Scenario, body: Body
) -> Callable[[str], float | None]:
    """Gives a function of a key: the rms of the value's error."""
    by_key = {each.key: each for each in dispersions}

    def spread(key: str) -> float | None:
        if key not in by_key:
            return None
        unit = by_key[key].unit(scenario, body)
        found = by_key[key].distribution.rms(QUANTITY[key].about / unit)
        return None if found is None else abs(unit) * found

    return spread


def _uniform(seed: int, index: int, key: str, component: int) -> float:
    """A number from 0 to 1 that depends on the arguments alone."""
    name = int.from_bytes(hashlib.sha256(key.encode()).digest()[:4])
    return float(generator(derived_seed(seed, name), index, component).random())
