"""Mapping: an ellipsoid becomes a map, by lidar frames from an orbit.

Start with `estimated`, the batch estimator: it takes `Returns` and gives a `Survey`, which holds
the path, the rotation, gravity and the surface. `survey_fit` has one step of its least squares,
`first_orbit` its start, `free_surface` makes a mesh of any form from placed returns, and
`uncertainty` says what is uncertain where. `SurveyController` is what flies the survey, without
a map. Numerics are functions on arrays; `Expected` has all that is uncertain before.
"""

from proxops.systems.mapping.batch import Estimated, estimated
from proxops.systems.mapping.first_orbit import FEWEST
from proxops.systems.mapping.path import Path
from proxops.systems.mapping.returns import Returns
from proxops.systems.mapping.survey_controller import HIGHEST, SurveyController, orbit_normal
from proxops.systems.mapping.survey_filter import Around
from proxops.systems.mapping.survey_fit import Expected, Solution, Survey, matched
from proxops.systems.mapping.uncertainty import MapUncertainty, map_uncertainty

__all__ = [
    "FEWEST",
    "HIGHEST",
    "Around",
    "Estimated",
    "Expected",
    "MapUncertainty",
    "Path",
    "Returns",
    "Solution",
    "Survey",
    "SurveyController",
    "estimated",
    "map_uncertainty",
    "matched",
    "orbit_normal",
]
