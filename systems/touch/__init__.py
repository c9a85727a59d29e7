"""Touching a body: places that can be touched, the way down, and contact.

Start with `map_sites`, which measures the places of a map, and `use_of_limits`, which says which of
them can be touched. `make_contact_plant` is the spacecraft with its arm on the ground, in Drake's
MultibodyPlant. `DescentGuidance` leads down to a place, and
`fly_contact` flies the last metre, the touch and the way off.
"""

from proxops.systems.touch.contact_phase import AwayConfig, Touch, fly_contact
from proxops.systems.touch.contact_plant import (
    Arm,
    Ground,
    TouchCraft,
    make_contact_plant,
    patch_of,
    place_craft,
)
from proxops.systems.touch.descent import DescentConfig, DescentGuidance, DescentPhase, Site
from proxops.systems.touch.sites import (
    LIMITS,
    SiteLimits,
    Sites,
    SiteWorld,
    best_sites,
    map_sites,
    measured_sites,
    nearest_site,
    place_below,
    place_near,
    use_of_limits,
    why_not,
)

__all__ = [
    "LIMITS",
    "Arm",
    "AwayConfig",
    "DescentConfig",
    "DescentGuidance",
    "DescentPhase",
    "Ground",
    "Site",
    "SiteLimits",
    "SiteWorld",
    "Sites",
    "Touch",
    "TouchCraft",
    "best_sites",
    "fly_contact",
    "make_contact_plant",
    "map_sites",
    "measured_sites",
    "nearest_site",
    "patch_of",
    "place_below",
    "place_craft",
    "place_near",
    "use_of_limits",
    "why_not",
]
