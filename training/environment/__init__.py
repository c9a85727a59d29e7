"""Transits as environments of Gymnasium: for reinforcement learning and other learners.

Importing this room registers `proxops/Transit-v0`. Start with `TransitEnvironment`, which flies the
same diagram as `fly`; `TransitBatch` flies many at once without it. `reward` says what they pay
for, and `observations` what a pilot sees. `write_minari` turns flights that were flown into a data
set for offline learners; only this needs Minari. Gymnasium and Minari come with the extra `gym`.
"""

import gymnasium

from proxops.training.environment.minari_set import check_minari_name, write_minari
from proxops.training.environment.reward import ARRIVAL, FUEL, VIOLATION, step_reward
from proxops.training.environment.transit_batch import TransitBatch
from proxops.training.environment.transit_environment import TransitEnvironment

__all__ = [
    "ARRIVAL",
    "FUEL",
    "VIOLATION",
    "TransitBatch",
    "TransitEnvironment",
    "check_minari_name",
    "step_reward",
    "write_minari",
]

gymnasium.register(
    id="proxops/Transit-v0",
    entry_point="proxops.training.environment:TransitEnvironment",
    vector_entry_point="proxops.training.environment:TransitBatch",
)
