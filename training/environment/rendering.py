"""Pictures of transits for Gymnasium's `render`."""

from __future__ import annotations

import typing

import numpy as np

from proxops.diagrams.scenario import Body, Scenario, TrueBody
from proxops.systems.common import InputError

if typing.TYPE_CHECKING:
    from proxops.diagrams.plots import TransitPicture

RENDER_MODE = "rgb_array"
FRAMES_PER_SECOND = 30
"""Of a video with a picture for each control step."""


def check_render_mode(render_mode: str | None) -> None:
    """Raises `InputError` if a mode is neither None nor `rgb_array`."""
    if render_mode not in (None, RENDER_MODE):
        raise InputError(f"render_mode: None or {RENDER_MODE!r}, not {render_mode!r}")


def transit_picture(
    scenario: Scenario, body: Body, true_body: TrueBody | None = None
) -> TransitPicture:
    """Makes the picture of a scenario's transits; it shows the cube in which they are drawn.

    Args:
      scenario: the scenario.
      body: the body as believed. true_body: as it is; None: the same.
    """
    # Who learns without pictures need not wait for matplotlib.
    from proxops.diagrams.plots import TransitPicture

    transit = scenario.transit
    given = [np.abs(place).max() for place in (transit.start_m, transit.goal_m) if place]
    shown = max(0.5 * transit.cube_m, float(body.keep_out_semi_axes.max()), *given)
    return TransitPicture(body, true_body, 1.08 * shown)
