"""`World`: what one flight is flown in, and what is believed of it; made once for a flight."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

from proxops.diagrams.scenario.body import Body, load_body
from proxops.diagrams.scenario.drawn_world import draw_world
from proxops.diagrams.scenario.scenario_config import Scenario
from proxops.diagrams.scenario.told_bounds import assurance_bounds
from proxops.diagrams.scenario.told_errors import expected_errors
from proxops.diagrams.scenario.transits import Transit, scenario_transit
from proxops.diagrams.scenario.true_body import TrueBody, check_flyable, make_true_body
from proxops.diagrams.scenario.truth_config import TruthConfig
from proxops.systems.assurance import AssuranceBounds
from proxops.systems.navigation import ExpectedErrors


@dataclass(frozen=True)
class World:
    """The world of one flight. What is on board is made from `belief` and `body` alone."""

    given: Scenario
    """The scenario as it was given."""
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
        body = (body or load_body(scenario.body)).with_gravity(scenario.gravity)
        drawn = draw_world(scenario, body)
        true_body = true_body or make_true_body(body, drawn.truth)
        transit = scenario_transit(drawn, body)
        check_flyable(true_body, transit, drawn)
        return cls(scenario, drawn, body, true_body, transit)

    @cached_property
    def belief(self) -> Scenario:
        """The scenario as it is known on board: with the world as believed."""
        return believed(self.scenario)

    @cached_property
    def filter_tuning(self) -> ExpectedErrors:
        """One standard deviation of what the navigation may be wrong about.

        Raises:
          InputError: see `expected_errors`.
        """
        return expected_errors(self.belief, self.body)

    @cached_property
    def uncertainty_set(self) -> AssuranceBounds:
        """The greatest errors within which runtime assurance keeps its promise."""
        return assurance_bounds(self.scenario, self.body)


def believed(scenario: Scenario) -> Scenario:
    """Gives the scenario as the controllers know it: the world is as they are told."""
    return replace(scenario, truth=TruthConfig(), dispersions=None, dispersed=[])
