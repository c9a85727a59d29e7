"""All evidence in one sequence: the paper's experiments, then the campaigns that go beyond it.

Start with `reproduce`, which runs the paper's experiments from data to report, and with
`fly_and_tell`, which flies campaigns; both are stages that resume. A new variant goes into
`paper_flights`, and a new number of the paper into `costs` and `paper_report`. Only the stages of
training need PyTorch, so `TrainingSettings` is imported when it is first used.
"""

import typing

from proxops.studies.reproduction.evidence import (
    PAPER,
    chosen_campaigns,
    fly_and_tell,
    own_bodies,
    success_lines,
)
from proxops.studies.reproduction.paper_experiments import (
    ReproductionSettings,
    paper_policy,
    reproduce,
)

if typing.TYPE_CHECKING:
    from proxops.studies.reproduction.training import TrainingSettings

__all__ = [
    "PAPER",
    "ReproductionSettings",
    "TrainingSettings",
    "chosen_campaigns",
    "fly_and_tell",
    "own_bodies",
    "paper_policy",
    "reproduce",
    "success_lines",
]


def __getattr__(name: str) -> typing.Any:
    if name == "TrainingSettings":
        from proxops.studies.reproduction.training import TrainingSettings

        return TrainingSettings
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
