"""The paper's experiments, run again from data to report.

Start with `reproduce`, a list of stages that resumes. PyTorch is needed for the training stages
alone, so `TrainingSettings` is imported when it is first asked for.
"""

import typing

from proxops.studies.reproduction.reproduction import ReproductionSettings, reproduce
from proxops.studies.reproduction.stages import Stage, Stages

if typing.TYPE_CHECKING:
    from proxops.studies.reproduction.training import TrainingSettings

__all__ = [
    "ReproductionSettings",
    "Stage",
    "Stages",
    "TrainingSettings",
    "reproduce",
]


def __getattr__(name: str) -> typing.Any:
    if name == "TrainingSettings":
        from proxops.studies.reproduction.training import TrainingSettings

        return TrainingSettings
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
