"""What Sun and moons may do at most, and what a spacecraft shows to the Sun."""

from __future__ import annotations

import functools

import numpy as np

from proxops.diagrams.scenario.body import Body
from proxops.diagrams.scenario.scenario_config import Scenario
from proxops.diagrams.scenario.spacecraft_model import (
    RigidBodyConfig,
    SpacecraftModel,
    load_spacecraft,
)
from proxops.diagrams.scenario.spacecraft_solids import CORNERS, solids_of
from proxops.systems.common import Vector3, spread_directions
from proxops.systems.gravity import greatest_tide
from proxops.systems.vehicle import Facets, at_its_distance, greatest_sunlight, light_on_facets

# Directions from which the light on facets is looked at, and what covers the gaps between them.
_WAYS, _GAPS = 1000, 1.02


def facets_of(model: SpacecraftModel, centre: Vector3 | None = None) -> Facets:
    """The faces of the boxes about a spacecraft's solids.

    What one solid hides of another counts as lit.

    Args:
      model: the spacecraft. centre: (3,) of the centre of mass in m in S; None: as believed.
    """
    centres, normals, areas = [], [], []
    for solid in solids_of(model):
        middle = solid.corners.mean(axis=0)
        halves = CORNERS.T @ solid.corners / len(CORNERS)
        lengths = np.linalg.norm(halves, axis=1)
        for k in range(3):
            for side in (1.0, -1.0):
                centres.append(middle + side * halves[k])
                normals.append(side * halves[k] / lengths[k])
                areas.append(4.0 * lengths.prod() / lengths[k])
    away = np.array(centres) - (np.zeros(3) if centre is None else centre)
    specular, diffuse = (
        np.full(len(areas), share) for share in (model.config.specular, model.config.diffuse)
    )
    return Facets(away, np.array(normals), np.array(areas), specular, diffuse)


def greatest_from_sky(
    scenario: Scenario, body: Body, mass: float, distance: float
) -> tuple[float, float]:
    """The greatest accelerations in m/s^2 by moons, and by light and tide of the Sun.

    Args:
      scenario: of its Sun there is none unless it has `sunlight`. body: as believed.
      mass: the least of the spacecraft, in kg. distance: the greatest from the body, in m.

    Returns:
      Both; inf where a moon comes as near, and is not always inside the keep-out ellipsoid.
    """
    tide = greatest_tide(body.config.moons, distance, body.moon_depths)
    settings, craft = scenario.sunlight, scenario.spacecraft
    if settings is None:
        return tide, 0.0
    shown = _greatest_shown(craft.model) if isinstance(craft, RigidBodyConfig) else None
    return tide, greatest_sunlight(at_its_distance(settings), mass, distance, shown)


@functools.lru_cache(maxsize=8)
def _greatest_shown(name: str) -> float:
    """The greatest force over pressure in m^2 on the facets of a model, from any direction."""
    facets = facets_of(load_spacecraft(name))
    forces = [light_on_facets(facets, way)[0] for way in spread_directions(_WAYS)]
    return _GAPS * float(np.linalg.norm(forces, axis=1).max())
