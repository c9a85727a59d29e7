"""The paper's own recipe: a CNN and an LSTM on lidar frames imitate the expert's force.

Start with `train_paper_policy` in `recipe`, which `proxops train --recipe paper` calls. `policy`
has the network. Sizes that the paper does not give are fields of `PaperSettings`.
"""

from proxops.training.paper.recipe import PaperSettings, train_paper_policy

__all__ = [
    "PaperSettings",
    "train_paper_policy",
]
