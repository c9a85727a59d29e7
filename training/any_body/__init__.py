"""One pilot for any body: a family of bodies and spacecraft, and the expert's plans at all of them.

Start with `write_family`, which generates the members: each is a body and a scenario. The module
`family` has the ranges from which their spacecraft are drawn; `spacecraft_numbers` gives the same
dimensionless numbers of any scenario. `family_plans` computes what the expert commands there.
"""

from proxops.training.any_body.family import (
    RANGES,
    SpacecraftNumbers,
    family_scenarios,
    spacecraft_numbers,
    write_family,
)
from proxops.training.any_body.member_plans import family_plans

__all__ = [
    "RANGES",
    "SpacecraftNumbers",
    "family_plans",
    "family_scenarios",
    "spacecraft_numbers",
    "write_family",
]
