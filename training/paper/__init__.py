"""The paper's own recipe: a CNN and an LSTM on frames, imitating the expert's force.

Start with `train_paper_policy`, which `proxops train --recipe paper` calls.
"""

from proxops.training.paper.policy import PaperPolicy
from proxops.training.paper.recipe import PaperSettings, train_paper_policy

__all__ = [
    "PaperPolicy",
    "PaperSettings",
    "train_paper_policy",
]
