"""What the places of a scenario's body are measured in, by which it is decided where to touch."""

from __future__ import annotations

import numpy as np

from proxops.diagrams.scenario.body import Body, apparent_gravity
from proxops.diagrams.scenario.scenario_config import Scenario
from proxops.systems.common import Vectors3, rotation_matrix
from proxops.systems.touch import SiteWorld
from proxops.systems.vehicle import sun_direction

# Times in a turn of the body at which it is looked where the Sun is.
_TIMES = 72


def site_world(scenario: Scenario, body: Body) -> SiteWorld:
    """Apparent gravity at the start, the spacecraft's mass, and the Sun over one turn of the body.

    Args:
      scenario: of its Sun there is none unless it has `sunlight`. body: as believed.
    """

    def acceleration(positions: Vectors3) -> Vectors3:
        gravity = body.exact_field.evaluate(positions).acceleration
        return apparent_gravity(gravity, positions, body.spin)

    suns = np.zeros((0, 3))
    if scenario.sunlight is not None:
        times = np.arange(_TIMES) / _TIMES * 2.0 * np.pi / body.spin_rate
        suns = np.array(
            [
                rotation_matrix(body.spin.attitude(time)).T @ sun_direction(time, scenario.sunlight)
                for time in times.tolist()
            ]
        )
    return SiteWorld(acceleration, scenario.spacecraft.mass_kg, suns)
