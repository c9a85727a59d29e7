"""`Wiring`: a transit diagram while it is built, and the values that all its parts need."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TypeVar

from pydrake.systems.framework import DiagramBuilder, OutputPort, System
from pydrake.systems.primitives import ZeroOrderHold

from proxops.diagrams.scenario import Scenario, World
from proxops.systems.common import InputError, derived_seed
from proxops.systems.vehicle import SpinKnowledge

AnySystem = TypeVar("AnySystem", bound=System)
Signals = dict[str, OutputPort]
"""Output ports by their names."""
# Streams of the derived seeds, one for each random system.
LIDAR_STREAM, DISTURBANCE_STREAM, NOISE_STREAM, KICKS_STREAM = range(4)
ATTITUDE_STREAM, ACCELERATION_STREAM, GYRO_STREAM, THRUSTERS_STREAM = range(4, 8)
# Far from the others, which may become more without a change of any random number.
STATE_NOISE_STREAM = 100


@dataclass(frozen=True)
class Wiring:
    """A diagram that is being built, and the world of its flight."""

    builder: DiagramBuilder
    world: World
    logged: Signals = field(default_factory=dict)
    """What the log records once a control step, by the names of its columns or records."""

    @property
    def scenario(self) -> Scenario:
        """The scenario with the values of this flight."""
        return self.world.scenario

    @property
    def spins(self) -> SpinKnowledge:
        """How the body turns, and what is believed of that."""
        phase = math.radians(self.scenario.truth.phase_deg)
        return SpinKnowledge(self.world.true_body.spin, self.world.body.spin, phase)

    def add(self, name: str, system: AnySystem, **inputs: OutputPort | None) -> AnySystem:
        """Adds a system under a name, and connects its input ports by their names.

        An input port of None, or that is not named, remains open.

        Raises:
          InputError: the controller has this name.
        """
        if self.builder.HasSubsystemNamed(name):
            raise InputError(
                f"controller {name!r}: a part of the diagram is called so; give the controller "
                "another name"
            )
        self.builder.AddNamedSystem(name, system)
        for port, source in inputs.items():
            if source is not None:
                self.builder.Connect(source, system.GetInputPort(port))
        return system

    def held(self, name: str, port: OutputPort, period: float) -> OutputPort:
        """Holds a signal over each period in s, so that an integrator's steps do not ask."""
        hold = ZeroOrderHold(period, port.size())
        return self.add(name, hold, u=port).get_output_port()

    def seed(self, stream: int) -> int:
        """Gives the seed of a random system from the number of its stream."""
        transit = self.world.transit
        return derived_seed(self.scenario.noise_seed, transit.seed, transit.index, stream)
