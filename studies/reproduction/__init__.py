"""Runs the paper's experiments again, from data to report.

Start with `reproduce`, a sequence of stages that resumes after an interruption. A new variant goes
into `flights`, and a new number of the paper into `numbers` and `tables`. Only the training stages
need PyTorch, so `TrainingSettings` is imported when it is first used.
"""

import typing

from proxops.studies.reproduction.reproduction import (
    ReproductionSettings,
    paper_policy,
    reproduce,
)
from proxops.studies.reproduction.stages import Stage, Stages

if typing.TYPE_CHECKING:
    from proxops.studies.reproduction.training import TrainingSettings

__all__ = [
    "ReproductionSettings",
    "Stage",
    "Stages",
    "TrainingSettings",
    "paper_policy",
    "reproduce",
]


def __getattr__(name: str) -> typing.Any:
    if name == "TrainingSettings":
        from proxops.studies.reproduction.training import TrainingSettings

        return TrainingSettings
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
