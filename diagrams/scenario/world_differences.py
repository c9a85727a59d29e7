"""In what the true world of a flight differs from the believed one, for pictures and pages."""

from __future__ import annotations

import typing

import numpy as np

from proxops.diagrams.scenario.body import Body
from proxops.diagrams.scenario.dotted_keys import default_at, dotted_keys, value_at
from proxops.diagrams.scenario.quantities import QUANTITY
from proxops.diagrams.scenario.scenario_config import Scenario
from proxops.diagrams.scenario.true_body import TrueBody

# A drawn spin axis is this many times as long as the body's greatest extent, so that it sticks out.
_AXIS_LENGTH = 1.2


def spin_axes(body: Body, true_body: TrueBody) -> tuple[np.ndarray, np.ndarray] | None:
    """Gives the ends of the believed and of the true spin axis, for a drawing.

    Returns:
      Two arrays (2, 3) in m in K: the ends of the believed axis, which is K's z, and those of the
      true one. None if both are one line, or if the true body does not spin.
    """
    rate = float(np.linalg.norm(true_body.spin))
    same = not (true_body.spin[:2].any() or true_body.axis_point[:2].any())
    if same or rate == 0.0:
        return None
    half = 0.5 * _AXIS_LENGTH * float(body.shape.extents.max())
    along = np.array([[-half], [half]])
    true = true_body.axis_point + along * true_body.spin / rate
    return along * [0.0, 0.0, 1.0], true


def differing_values(scenario: Scenario) -> dict[str, typing.Any]:
    """Gives the values by which the world of a flight differs, by their keys as in the scenario.

    They are what was drawn from dispersions, and every value of `truth` that is not the default,
    but for values that mean nothing as the scenario is, such as the correlation of a surface
    without roughness.
    """

    def differs(key: str) -> bool:
        return value_at(scenario, key) != default_at(key)

    drawn = {*scenario.dispersed}
    return {
        key: value_at(scenario, key)
        for key in dotted_keys()
        if key in drawn
        or (key.startswith("truth.") and differs(key) and differs(QUANTITY[key].needs or key))
    }
