"""Touching a body: places that can be touched, the way down, and contact.

Start with `map_sites`, which measures the places of a map, and `use_of_limits`, which says which of
them can be touched. `make_contact_plant` is the spacecraft with its arm on the ground, in Drake's
MultibodyPlant. `DescentGuidance` leads down to a place, or a learned `DescentPolicy` in its place;
`Mission` says when, and what is checked, and `TouchController` is all of it as a system.
"""

from proxops.systems.touch.contact_plant import (
    Arm,
    Ground,
    TouchCraft,
    contact_energy,
    inertia_without_head,
    make_contact_plant,
    patch_of,
    place_craft,
)
from proxops.systems.touch.descent import DescentConfig, DescentGuidance, Site, TouchPhase
from proxops.systems.touch.descent_policy import DescentPolicy, descent_inputs
from proxops.systems.touch.mission import (
    AbortReason,
    AwayConfig,
    DescentPilot,
    Mission,
    TouchChecks,
)
from proxops.systems.touch.sites import (
    LIMITS,
    SiteLimits,
    Sites,
    SiteWorld,
    best_sites,
    map_sites,
    measured_sites,
    nearest_points,
    nearest_site,
    place_below,
    place_near,
    tangents,
    use_of_limits,
    why_not,
)
from proxops.systems.touch.touch_controller import TouchController

__all__ = [
    "LIMITS",
    "AbortReason",
    "Arm",
    "AwayConfig",
    "DescentConfig",
    "DescentGuidance",
    "DescentPilot",
    "DescentPolicy",
    "Ground",
    "Mission",
    "Site",
    "SiteLimits",
    "SiteWorld",
    "Sites",
    "TouchChecks",
    "TouchController",
    "TouchCraft",
    "TouchPhase",
    "best_sites",
    "contact_energy",
    "descent_inputs",
    "inertia_without_head",
    "make_contact_plant",
    "map_sites",
    "measured_sites",
    "nearest_points",
    "nearest_site",
    "patch_of",
    "place_below",
    "place_craft",
    "place_near",
    "tangents",
    "use_of_limits",
    "why_not",
]
