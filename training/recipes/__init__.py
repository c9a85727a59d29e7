"""The recipes: how each kind of policy is trained, and DAgger, which goes on with any of ours.

Each reads from top to bottom. Start with `train_paper_policy` in `paper`, the shortest.
`train_pilot` in `pilot` trains our end-to-end network part by part (`pilot_losses` has the losses),
and `train_any_body` in `any_body` a guidance on the expert's plans at a `family` of generated
bodies. `train_descent` in `descent` learns the way down to a place from the plans of a descent.
`run_dagger` lets a policy fly, labels the states it came to with the expert's forces, and trains
its guidance again. `recipe` has what they share. A new recipe needs a module and a line in
`RECIPES`.
"""

from proxops.training.recipes.any_body import AnyBodySettings, train_any_body
from proxops.training.recipes.dagger import DaggerSettings, run_dagger
from proxops.training.recipes.descent import DescentSettings, train_descent
from proxops.training.recipes.family import family_plans, write_family
from proxops.training.recipes.paper import PaperSettings, train_paper_policy
from proxops.training.recipes.pilot import PilotSettings, dimensions_of, part_task, train_pilot
from proxops.training.recipes.pilot_examples import Hits, hits_of
from proxops.training.recipes.pilot_losses import geometry_loss
from proxops.training.recipes.recipe import Recipe, trained_settings

RECIPES: dict[str, Recipe] = {
    "proxops": Recipe(PilotSettings, train_pilot),
    "paper": Recipe(PaperSettings, train_paper_policy),
    "any-body": Recipe(AnyBodySettings, lambda _, *given: train_any_body(*given)),
    "descent": Recipe(DescentSettings, lambda _, *given: train_descent(*given)),
}
"""By the names that `proxops train --recipe` takes."""

__all__ = [
    "RECIPES",
    "AnyBodySettings",
    "DaggerSettings",
    "DescentSettings",
    "Hits",
    "PaperSettings",
    "PilotSettings",
    "Recipe",
    "dimensions_of",
    "family_plans",
    "geometry_loss",
    "hits_of",
    "part_task",
    "run_dagger",
    "train_any_body",
    "train_descent",
    "train_paper_policy",
    "train_pilot",
    "trained_settings",
    "write_family",
]
