"""`ThrusterCluster`: the force and torque that thrusters truly give, and what they use up."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydrake.systems.framework import LeafSystem

from proxops.systems.attitude.thruster_layout import ThrusterLayout
from proxops.systems.common import (
    LONG,
    Values,
    Vectors3,
    config,
    generator,
    number,
    quaternion_of,
    rotated,
    vector,
    vector_of,
)
from proxops.systems.vehicle import STANDARD_GRAVITY, ThrusterErrors

_SCALE, _DIRECTION, _PLACE = range(3)


@config
class TrueRigidBodyConfig:
    """How a rigid spacecraft differs from its data sheet. A point mass has nothing of it."""

    # True inertia along each axis of S, over that of the model. The axes' products stay.
    inertia: float = number(1.0, at_least=0.1, at_most=10.0)
    # True centre of mass less that of the model.
    centre_of_mass_m: list[float] = vector([0.0] * 3, at_least=-10.0, at_most=10.0, unit="m")
    # Each thruster has its own errors: standard deviations of its force over the nominal one, of
    # its direction along each axis across it, and of its place along each axis.
    thruster_scale_std: float = number(0.0, at_least=0.0, at_most=0.5)
    thruster_direction_std_deg: float = number(0.0, at_least=0.0, at_most=45.0, unit="degrees")
    thruster_place_std_m: float = number(0.0, at_least=0.0, at_most=1.0, unit="m")
    # Number of a thruster of the model that gives nothing from a time on, counted from 0; -1: none.
    failed_thruster: int = number(-1, at_least=-1, at_most=1000)
    failure_time_s: float = number(0.0, at_least=0.0, at_most=LONG, unit="s")
    # Torque of a wheel's friction over its momentum.
    wheel_friction_per_s: float = number(0.0, at_least=0.0, at_most=1.0, unit="1/s")


@dataclass(frozen=True)
class Failure:
    """A thruster that gives nothing from a time in s on."""

    thruster: int
    time: float


def true_layout(
    layout: ThrusterLayout, truth: TrueRigidBodyConfig, common: ThrusterErrors, seed: int
) -> ThrusterLayout:
    """The thrusters as they are, each with errors of its own.

    Args:
      layout: as on the data sheet. truth: what differs, and how much.
      common: what all thrusters share: the scale along each axis of S, and the rotation of all
        directions.
      seed: of each thruster's own errors.

    Returns:
      The layout, with places from the true centre of mass.
    """
    n = layout.count
    scale = 1.0 + truth.thruster_scale_std * generator(seed, 0, _SCALE).standard_normal(n)
    # Of a thruster between axes, by its share along each.
    scale = np.maximum(scale, 0.0) * (layout.directions**2 @ np.array(common.scale))
    own = np.radians(truth.thruster_direction_std_deg) * _draws(seed, _DIRECTION, n)
    mounting = quaternion_of(vector_of(common.direction))
    directions = [
        rotated(mounting, rotated(quaternion_of(vector_of(turn)), vector_of(each)))
        for turn, each in zip(own, layout.directions, strict=True)
    ]
    places = layout.places + truth.thruster_place_std_m * _draws(seed, _PLACE, n)
    return ThrusterLayout(
        places - np.array(truth.centre_of_mass_m),
        np.array(directions),
        scale * layout.forces,
        layout.least_on_time,
    )


def _draws(seed: int, stream: int, n: int) -> Vectors3:
    return generator(seed, 0, stream).standard_normal((n, 3))


class ThrusterCluster(LeafSystem):
    """Force and torque of thrusters by their on-times.

    ```
                       ┌─────────────────┐─► force (3), N, S
    on_times (n), s ──►│ ThrusterCluster │─► torque (3), N m, S, about the centre of mass
                       └─────────────────┘─► mass_flow (1), kg/s
    ```

    The on-times are held over an attitude period, and each thruster's force is its mean over the
    period: impulse and propellant are exact, and where within the period a pulse lies is left out.
    Plumes are left out. The outputs depend on the input, and on time if a thruster fails.
    """

    def __init__(
        self,
        layout: ThrusterLayout,
        period: float,
        specific_impulse: float,
        failure: Failure | None = None,
    ):
        """Takes the thrusters as they are, the attitude period and the specific impulse in s."""
        super().__init__()
        self.layout, self.period, self.failure = layout, period, failure
        flow = layout.forces / (specific_impulse * STANDARD_GRAVITY)
        self._effects = np.vstack([layout.wrenches(), flow]) / period
        self._port = self.DeclareVectorInputPort("on_times", layout.count)
        depends = {self._port.ticket()} | ({self.time_ticket()} if failure else set())
        for name, part in (
            ("force", slice(0, 3)),
            ("torque", slice(3, 6)),
            ("mass_flow", slice(6, 7)),
        ):
            self.DeclareVectorOutputPort(
                name,
                part.stop - part.start,
                lambda context, output, part=part: output.SetFromVector(
                    self._effects[part] @ self._times(context)
                ),
                depends,
            )

    def _times(self, context) -> Values:
        times = self._port.Eval(context)
        if self.failure is not None and context.get_time() >= self.failure.time:
            times = times.copy()
            times[self.failure.thruster] = 0.0
        return times
