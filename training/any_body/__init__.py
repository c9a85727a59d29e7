"""One policy for any body: learned from the expert's plans at a family of generated bodies.

Start with `train_any_body` in `recipe`, which reads from top to bottom, then read `network`: a law
of least effort that a network corrects. `write_family` generates the members, each a body and a
scenario; `family` has the ranges from which their spacecraft are drawn. `family_plans` computes
what the expert commands there. `run_any_body_dagger` lets the guidance fly at all of them.
"""

from proxops.training.any_body.dagger import AnyBodyDagger, run_any_body_dagger
from proxops.training.any_body.examples import Examples, mirrored
from proxops.training.any_body.export import export_guidance
from proxops.training.any_body.family import spacecraft_numbers, write_family
from proxops.training.any_body.member_plans import family_plans
from proxops.training.any_body.network import AnyBodyGuidance
from proxops.training.any_body.recipe import train_any_body
from proxops.training.any_body.settings import AnyBodySettings

__all__ = [
    "AnyBodyDagger",
    "AnyBodyGuidance",
    "AnyBodySettings",
    "Examples",
    "export_guidance",
    "family_plans",
    "mirrored",
    "run_any_body_dagger",
    "spacecraft_numbers",
    "train_any_body",
    "write_family",
]
