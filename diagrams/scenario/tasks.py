"""What a scenario's flight is to do."""

from __future__ import annotations

from proxops.systems.common import FAR, config, number


@config
class Transit:
    """Fly the scenario's transit."""


@config
class SurveyConfig:
    """Make a map of a body of which an ellipsoid, a mass and a rotation are known.

    `proxops survey` flies it. `transit.seed` and `transit.index` say which survey of a set.
    """

    # Time in the orbit of the survey.
    hours: float = number(24.0, at_least=0.1, at_most=1e4, unit="h")
    # Time that the approach may take.
    approach_hours: float = number(60.0, at_least=0.1, at_most=1e4, unit="h")
    # Semi-axes of the ellipsoid that is known; null: the body's own, off by a tenth (3 sigma).
    semi_axes_m: list[float] | None = None
    # Radius of the orbit; null: from ellipsoid, mass and spin.
    radius_m: float | None = number(None, at_least=1e-3, at_most=FAR, unit="m")
    # Greatest range of the lidar while it surveys; null: sixteen times the longest semi-axis.
    reach_m: float | None = number(None, at_least=1e-3, at_most=FAR, unit="m")
    # Time from one frame to the next, and from one command to the next.
    period_s: float = number(20.0, at_least=1e-2, at_most=3600.0, unit="s")
