"""What is flown: variants of controllers on the same transits, and the table of campaigns.

Start with `fly_variants`, which flies any number of controllers and settings on one set of
transits, and `fly_tasks`, which flies many surveys or missions; then read `all_campaigns`, the
table of what goes beyond the paper. A new campaign is one entry there. `Stages` is the one way in
which a long study goes on after an interruption.
"""

from proxops.studies.campaigns.describing import describe_flight, describe_steps
from proxops.studies.campaigns.flying import (
    FlownCampaign,
    flown_campaign,
    fly_campaign,
)
from proxops.studies.campaigns.stages import Stage, Stages
from proxops.studies.campaigns.table import (
    BODIES,
    FLAGSHIP,
    MAPS,
    PAPER_POLICY,
    PAPER_RECIPE,
    PARTS,
    PILOT,
    Campaign,
    all_campaigns,
    campaign_name,
)
from proxops.studies.campaigns.tasks import TaskRun, fly_runs, fly_tasks, makes_a_map, task_name
from proxops.studies.campaigns.variants import (
    Logs,
    Variant,
    evaluate,
    fly_logs,
    fly_variants,
    load_logs,
    variant_flights,
)

__all__ = [
    "BODIES",
    "FLAGSHIP",
    "MAPS",
    "PAPER_POLICY",
    "PAPER_RECIPE",
    "PARTS",
    "PILOT",
    "Campaign",
    "FlownCampaign",
    "Logs",
    "Stage",
    "Stages",
    "TaskRun",
    "Variant",
    "all_campaigns",
    "campaign_name",
    "describe_flight",
    "describe_steps",
    "evaluate",
    "flown_campaign",
    "fly_campaign",
    "fly_logs",
    "fly_runs",
    "fly_tasks",
    "fly_variants",
    "load_logs",
    "makes_a_map",
    "task_name",
    "variant_flights",
]
