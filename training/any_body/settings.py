"""The settings of a training for any body."""

from __future__ import annotations

import dataclasses as dc

from proxops.training.loop import Schedule


@dc.dataclass(frozen=True)
class AnyBodySettings:
    """Settings of a training: sizes of the family and of the network, and the schedule."""

    members: int = 180
    """Bodies, each with a spacecraft of its own proportions."""
    held: int = 10
    """Of them, from the last: only their loss is looked at."""
    transits: int = 160
    """Transits at each body whose plans are learned from."""
    width: int = 320
    """Width of the network's layers."""
    schedule: Schedule = Schedule(epochs=30, batch=1024, learning_rate=2e-3, patience=30)
    seed: int = 0
    device: str = "cpu"
    precision: str = "32-true"

    def quick(self) -> AnyBodySettings:
        """Settings for a first try of a few minutes; what it gives flies less well."""
        return dc.replace(
            self,
            members=6,
            held=1,
            transits=20,
            width=64,
            schedule=dc.replace(self.schedule, epochs=8, batch=256),
        )
