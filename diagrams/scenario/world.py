"""`World`: what one flight is flown in, and what is believed of it; made once for a flight."""

from __future__ import annotations

import copy
import hashlib
import typing
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

from proxops.diagrams.scenario.body import Body, load_body
from proxops.diagrams.scenario.bounds import uncertainty_set, with_bounds
from proxops.diagrams.scenario.dispersions import Dispersion, Dispersions
from proxops.diagrams.scenario.keys import set_value, value_at
from proxops.diagrams.scenario.quantities import KNOWN_ON_THE_DAY
from proxops.diagrams.scenario.scenario_checks import check_scenario
from proxops.diagrams.scenario.scenario_config import Scenario, TruthConfig
from proxops.diagrams.scenario.tasks import MissionConfig, SurveyConfig
from proxops.diagrams.scenario.tasks import Transit as TransitTask
from proxops.diagrams.scenario.touchable import with_site
from proxops.diagrams.scenario.transits import Transit, check_flyable, scenario_transit
from proxops.diagrams.scenario.true_body import TrueBody, make_true_body
from proxops.diagrams.scenario.tuning import expected_errors, filter_tuning
from proxops.systems.assurance import AssuranceBounds
from proxops.systems.common import InputError, derived_seed, generator
from proxops.systems.navigation import ExpectedErrors, LidarNavigationConfig


@dataclass(frozen=True)
class World:
    """The world of one flight. What is on board is made from `belief` and `body` alone."""

    scenario: Scenario
    """The scenario with the values of this flight: those that its dispersions drew, and the bounds
    of runtime assurance."""
    body: Body
    """The body as believed."""
    true_body: TrueBody
    transit: Transit

    @classmethod
    def of(
        cls, scenario: Scenario, body: Body | None = None, true_body: TrueBody | None = None
    ) -> World:
        """Makes the world of a scenario's flight.

        Args:
          scenario: the scenario; the world of its transit is drawn from its dispersions, if any.
          body: the body as believed; None: the body that the scenario names.
          true_body: the body as it is; None: it is made from `truth`.

        Raises:
          UnflyableWorldError: the flight cannot begin in its world.
          InputError: the scenario cannot be flown.
        """
        if isinstance(scenario.task, SurveyConfig | MissionConfig):
            raise InputError(
                "a survey is flown by run_survey or proxops survey, a mission by run_mission or "
                "proxops fly: for a transit, set task: !Transit {}"
            )
        body = (body or load_body(scenario.body)).with_gravity(scenario.gravity)
        drawn = with_site(draw_world(scenario, body), body)
        true_body = true_body or make_true_body(body, drawn.truth)
        transit = scenario_transit(drawn, body)
        check_flyable(true_body, transit, drawn)
        return cls(drawn, body, true_body, transit)

    @cached_property
    def belief(self) -> Scenario:
        """The scenario as it is known on board: with the world as believed."""
        return believed(self.scenario)

    @cached_property
    def filter_tuning(self) -> ExpectedErrors:
        """One standard deviation of what the navigation may be wrong about.

        Raises:
          InputError: see `filter_tuning`.
        """
        return filter_tuning(self.belief, self.body)

    @cached_property
    def uncertainty_set(self) -> AssuranceBounds:
        """The greatest errors within which runtime assurance keeps its promise."""
        return uncertainty_set(self.scenario, self.body)


def believed(scenario: Scenario) -> Scenario:
    """Gives the scenario as the controllers know it: the world is as they are told."""
    return replace(scenario, truth=TruthConfig(), dispersions=None, dispersed=[])


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
    dispersions = Dispersions.of(scenario, body)
    if scenario.dispersions is None:
        return replace(scenario, assurance=with_bounds(dispersions))
    dispersions.check()

    def drawn(each: Dispersion, uniform: float) -> typing.Any:
        return each.in_its_unit(each.distribution.value(uniform), scenario, body)

    world = world_of(dispersions, drawn)
    world.dispersed = [each.key for each in dispersions.each if each.is_random]
    check_scenario(world, f"{scenario.dispersions}, transit {scenario.transit.index}")
    return world


def world_of(
    dispersions: Dispersions, value: Callable[[Dispersion, float], typing.Any]
) -> Scenario:
    """Makes the world of a scenario's flight from random numbers of its transit.

    Args:
      dispersions: what is dispersed.
      value: gives the value of a dispersed quantity, or of one number of a list, from a uniform
        random number (0 to 1). The number depends on seed and number of the transit, on the key and
        on the place in the list alone.

    Returns:
      A copy of the scenario with the values, without `dispersions`. Its navigation is told how much
      is dispersed, unless the scenario says what it is to expect. It is not checked.
    """
    scenario = dispersions.scenario
    transit, world = scenario.transit, copy.deepcopy(scenario)
    if (
        transit.start_m is None
        and isinstance(scenario.task, TransitTask)
        and not {*KNOWN_ON_THE_DAY}.isdisjoint(dispersions.keys)
    ):
        # Another mass would permit other transits.
        ends = scenario_transit(scenario, dispersions.body)
        world.transit.start_m, world.transit.goal_m = ends.start.tolist(), ends.goal.tolist()
    for each in dispersions.each:
        size = each.size
        values = [
            value(each, _uniform(transit.seed, transit.index, each.key, k))
            for k in range(size or 1)
        ]
        set_value(world, each.key, values[0] if size is None else values)
    if isinstance(world.navigation, LidarNavigationConfig) and world.navigation.expected is None:
        world.navigation.expected = expected_errors(dispersions)
    world.assurance = with_bounds(dispersions)
    world.dispersions = None
    return world


def dispersed_values(scenario: Scenario) -> dict[str, typing.Any]:
    """Gives the values that were drawn for a scenario, by their keys."""
    return {key: value_at(scenario, key) for key in scenario.dispersed}


def _uniform(seed: int, index: int, key: str, component: int) -> float:
    """A number from 0 to 1 that depends on the arguments alone."""
    name = int.from_bytes(hashlib.sha256(key.encode()).digest()[:4])
    return float(generator(derived_seed(seed, name), index, component).random())
