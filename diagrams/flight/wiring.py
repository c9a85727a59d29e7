"""`Wiring`: a transit diagram while it is built, and the values that all its parts need."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

from pydrake.systems.framework import DiagramBuilder, System

from proxops.diagrams.scenario import Scenario, World
from proxops.systems.common import derived_seed

AnySystem = TypeVar("AnySystem", bound=System)
# Streams of the derived seeds, one for each random system.
LIDAR_STREAM, DISTURBANCE_STREAM, NOISE_STREAM, KICKS_STREAM = range(4)
ATTITUDE_STREAM, ACCELERATION_STREAM = 4, 5
# Far from the others, which may become more without a change of any random number.
STATE_NOISE_STREAM = 100


@dataclass(frozen=True)
class Wiring:
    """A diagram that is being built, and the world of its flight."""

    builder: DiagramBuilder
    world: World

    @property
    def scenario(self) -> Scenario:
        """The scenario with the values of this flight."""
        return self.world.scenario

    def add(self, name: str, system: AnySystem) -> AnySystem:
        """Adds a system under a name."""
        self.builder.AddNamedSystem(name, system)
        return system

    def seed(self, stream: int) -> int:
        """Gives the seed of a random system from the number of its stream."""
        transit = self.world.transit
        return derived_seed(self.scenario.noise_seed, transit.seed, transit.index, stream)
