"""What a scenario's flight is to do."""

from __future__ import annotations

import dataclasses as dc

from proxops.systems.common import FAR, config, number


@config
class Transit:
    """Fly the scenario's transit."""


@config
class EnoughConfig:
    """When a survey's map is good enough, by what the survey itself says of it."""

    # Share of the surface that was seen.
    covered: float = number(0.995, at_least=0.0, at_most=1.0)
    # One standard deviation of the map, over its size.
    deviation_of_size: float = number(6e-4, above=0.0, at_most=1.0)
    # One standard deviation of GM, over GM.
    gravity: float = number(2e-3, above=0.0, at_most=1.0)


@config
class SurveyConfig:
    """Make a map of a body of which an ellipsoid, a mass and a rotation are known.

    `proxops survey` flies it. `transit.seed` and `transit.index` say which survey of a set.
    """

    # Most time in the orbit of the survey.
    hours: float = number(24.0, at_least=0.1, at_most=1e4, unit="h")
    # It ends earlier when its map is good enough; null: it does not.
    enough: EnoughConfig | None = dc.field(default_factory=EnoughConfig)
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
