"""Touching a body: places that can be touched, the way down, and contact.

Start with `map_sites`, which measures the places of a map, and `use_of_limits`, which says which of
them can be touched.
"""

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
    "SiteLimits",
    "SiteWorld",
    "Sites",
    "best_sites",
    "map_sites",
    "measured_sites",
    "nearest_site",
    "place_below",
    "place_near",
    "use_of_limits",
    "why_not",
]
