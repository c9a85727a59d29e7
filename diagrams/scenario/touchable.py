"""What touching takes of a scenario: the world of its places, and a spacecraft with an arm."""

from __future__ import annotations

import numpy as np

from proxops.diagrams.scenario.body import Body, apparent_gravity
from proxops.diagrams.scenario.scenario_config import Scenario
from proxops.diagrams.scenario.spacecraft_model import SpacecraftModel
from proxops.diagrams.scenario.spacecraft_solids import solids_of
from proxops.systems.common import Vectors3, rotation_matrix
from proxops.systems.touch import Arm, SiteWorld, TouchCraft
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


def touch_craft(model: SpacecraftModel, arm: Arm) -> TouchCraft:
    """A rigid spacecraft with an arm, whose solids may touch the ground.

    Args:
      model: mass and inertia, arm included, and solids. Each stands for the box about it along S's
        axes. arm: where it is, and how it gives way.
    """
    parts = {}
    for k, solid in enumerate(solids_of(model)):
        low, high = solid.corners.min(axis=0), solid.corners.max(axis=0)
        parts[f"solid {k}"] = (0.5 * (low + high), high - low)
    return TouchCraft(model.mass, model.inertia, arm, parts)
