"""`Wiring`: a transit diagram while it is built, and what all of its parts depend on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

from pydrake.systems.framework import DiagramBuilder, System

from proxops.diagrams.scenario import Body, Scenario, Transit
from proxops.systems.common import derived_seed

AnySystem = TypeVar("AnySystem", bound=System)
# Streams of derived seeds.
LIDAR_STREAM, DISTURBANCE_STREAM, NOISE_STREAM, KICKS_STREAM = range(4)


@dataclass(frozen=True)
class Wiring:
    """A diagram that is being built, and the flight that it is for."""

    builder: DiagramBuilder
    scenario: Scenario
    body: Body
    transit: Transit

    def add(self, name: str, system: AnySystem) -> AnySystem:
        """Adds a system under a name."""
        self.builder.AddNamedSystem(name, system)
        return system

    def seed(self, stream: int) -> int:
        """The seed of a random system: each has a stream of its own."""
        transit = self.transit
        return derived_seed(self.scenario.noise_seed, transit.seed, transit.index, stream)
