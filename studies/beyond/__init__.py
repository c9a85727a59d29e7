"""What goes beyond the paper: campaigns on navigation, in worlds that differ, at other bodies.

Start with `all_campaigns`, the list of what is flown, then read `fly_and_tell`. A new campaign goes
into `campaigns`, and a new section of the report into `report`.
"""

from proxops.studies.beyond.campaigns import (
    BODIES,
    PAPER_RECIPE,
    PARTS,
    Campaign,
    all_campaigns,
    campaign_name,
)
from proxops.studies.beyond.story import (
    PAPER,
    chosen_campaigns,
    fly_and_tell,
    own_bodies,
    success_lines,
)

__all__ = [
    "BODIES",
    "PAPER",
    "PAPER_RECIPE",
    "PARTS",
    "Campaign",
    "all_campaigns",
    "campaign_name",
    "chosen_campaigns",
    "fly_and_tell",
    "own_bodies",
    "success_lines",
]
