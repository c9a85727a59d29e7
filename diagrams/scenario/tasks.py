"""What a scenario's flight is to do."""

from __future__ import annotations

import dataclasses as dc

from proxops.systems.common import FAR, config, number
from proxops.systems.touch import AwayConfig, DescentConfig, SiteLimits, TouchChecks


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
    hours: float = number(48.0, at_least=0.1, at_most=1e4, unit="h")
    # It ends earlier when its map is good enough; null: it does not.
    enough: EnoughConfig | None = dc.field(default_factory=EnoughConfig)
    # Time that the approach may take.
    approach_hours: float = number(60.0, at_least=0.1, at_most=1e4, unit="h")
    # Semi-axes of the ellipsoid that is known; null: the body's own, off by a tenth (3 sigma).
    semi_axes_m: list[float] | None = None
    # Radius of the orbit; null: from ellipsoid, mass and spin.
    radius_m: float | None = number(None, at_least=1e-3, at_most=FAR, unit="m")
    # Greatest range of the lidar while it surveys; null: sixteen times the longest semi-axis, or
    # four times the radius of the orbit where that is more.
    reach_m: float | None = number(None, at_least=1e-3, at_most=FAR, unit="m")
    # Time from one frame to the next, and from one command to the next.
    period_s: float = number(20.0, at_least=1e-2, at_most=3600.0, unit="s")


@config
class TouchAndGoConfig:
    """Touch a place of the body, and come back.

    The spacecraft is a rigid body, with an arm along -z of S. The flight begins near home, above
    the place, or where `transit.start_m` says, and ends when it is at rest at home again.
    """

    # Whether a transit to home comes first, from `transit.start_m` or from a start that is drawn.
    # The flight's controller flies it, with runtime assurance if there is any.
    transit: bool = False

    # The place: latitude and longitude in degrees, or a position in m in K; null: the best place
    # that `proxops site` finds. proxops writes the position of the place that is flown to.
    site: list[float] | None = None
    # What a place must be like.
    limits: SiteLimits = dc.field(default_factory=SiteLimits)
    descent: DescentConfig = dc.field(default_factory=DescentConfig)
    checks: TouchChecks = dc.field(default_factory=TouchChecks)
    away: AwayConfig = dc.field(default_factory=AwayConfig)
    # Descents that are begun, if the ones before were aborted.
    tries: int = number(2, at_least=1, at_most=100)
    # How far aside of home it begins, to a side that is drawn from seed and number of the transit.
    aside_m: float = number(15.0, at_least=0.0, at_most=1e5, unit="m")
    # From the centre of mass to the far end of the arm's head.
    arm_m: float = number(3.0, above=0.2, at_most=100.0, unit="m")


MISSIONS = (
    ["survey", "transit"],
    ["survey", "transit", "touch_and_go"],
    ["survey", "transit", "touch_and_go", "park"],
)
"""The phases that a mission may have."""


@config
class MissionConfig:
    """Come to a body that is known as an ellipsoid, and fly on a map of one's own.

    A survey makes the map. A transit begins where the survey ends, and leads to the goal of the
    scenario's transit, or to a place that a touch-and-go chooses and touches. `run_mission` and
    `proxops fly` fly it. `transit.seed` and `transit.index` say which mission of a set.
    """

    # [survey, transit], [survey, transit, touch_and_go], or this and park: in an orbit as high as
    # the survey's.
    phases: list[str] = dc.field(default_factory=lambda: list(MISSIONS[-1]))
    survey: SurveyConfig = dc.field(default_factory=SurveyConfig)
    # Its site is chosen on the survey's map, unless it is given.
    touch: TouchAndGoConfig = dc.field(default_factory=lambda: TouchAndGoConfig(transit=True))
