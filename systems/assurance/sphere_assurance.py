"""`SphereAssurance`: keeps out of a sphere about a body, by braking away from its middle."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from pydrake.systems.framework import LeafSystem

from proxops.systems.common import InputError, Vector3, check_positive


class SphereLimits(NamedTuple):
    """What the promise is about: a sphere, and how much may act at most."""

    radius: float
    """Of the sphere, in m."""
    pull: float
    """The greatest acceleration in m/s^2 towards the middle, of all but thrust, at the sphere or
    outside of it."""
    thrust: float
    """The limit of the thrust's acceleration along each axis, in m/s^2."""
    error: float
    """By which share a thrust may be off, in size and direction together."""
    period: float
    """Control period in s."""

    @property
    def braking(self) -> float:
        """The least acceleration in m/s^2 outwards of full thrust in that direction."""
        return (1.0 - self.error) * self.thrust - self.pull


def is_safe(distance: float, closing: float, outward: float, limits: SphereLimits) -> bool:
    """Whether full thrust outwards keeps out of the sphere after one period of another thrust.

    The distance r from the middle obeys r'' = (speed across)^2 / r + what acts outwards. The first
    is never negative, so a fall along the line is the worst. It ends within v^2 / (2 a).

    Args:
      distance: the least that it may be, in m. closing: the greatest speed towards the middle that
        there may be, in m/s; negative: it rises.
      outward: the least acceleration outwards that the thrust may give in the period, in m/s^2.
      limits: sphere and limits.
    """
    after = closing + limits.period * (limits.pull - outward)
    gone = limits.period * max(closing, after, 0.0)
    return distance - gone - limits.radius >= max(after, 0.0) ** 2 / (2.0 * limits.braking)


def assured(
    command: Vector3, state: np.ndarray, errors: tuple[float, float], limits: SphereLimits
) -> Vector3:
    """The command (3,), or full thrust outwards if it is not safe; both as accelerations in m/s^2.

    Args:
      command: as is the state, along any axes. state: (6,) position from the middle and velocity
        in m and m/s.
      errors: by how much distance and closing speed may be off, in m and m/s.
      limits: sphere and limits.
    """
    place, velocity = state[:3], state[3:]
    far = float(np.linalg.norm(place))
    up = place / far
    off = limits.error * float(np.linalg.norm(command))
    outward, closing = float(command @ up) - off, errors[1] - float(velocity @ up)
    if is_safe(far - errors[0], closing, outward, limits):
        return command
    return up * (limits.thrust / float(np.abs(up).max()))


class SphereAssurance(LeafSystem):
    """Lets a commanded force pass, unless the spacecraft might no longer stay out of a sphere.

    ```
    state (6), m, m/s ──────────►┌─────────────────┐
    force (3), N ───────────────►│ SphereAssurance ├─► force (3), N
    deviations (2), m and m/s ──►└─────────────────┘
    ```

    It needs no map: the sphere is about the middle of the body and holds any body that there may
    be. `deviations` are those of distance and closing speed, so many of which count. A safe command
    passes bit for bit; otherwise there is full thrust outwards, along the line from the middle. So
    the flight stays out whatever is commanded, as long as all errors are within the limits. All
    vectors are along the same axes, which may turn: of a distance's rate they change nothing. If
    the state is not finite, because the body was not seen yet, every command passes.
    """

    def __init__(self, limits: SphereLimits, mass: float, deviations: float = 4.0):
        """Takes the limits, the spacecraft's mass in kg, and how many deviations count.

        Raises:
          InputError: full thrust does not hold the spacecraft at the sphere.
        """
        super().__init__()
        check_positive("SphereAssurance", mass=mass, deviations=deviations)
        if not limits.braking > 0.0:
            raise InputError(
                f"runtime assurance of a survey: at {limits.radius:.4g} m from the middle up to "
                f"{limits.pull:.3g} m/s^2 may act, and the thrust gives as little as "
                f"{(1.0 - limits.error) * limits.thrust:.3g}: leave out assurance, or fly with "
                "more thrust"
            )
        self.limits, self._mass, self._deviations = limits, mass, deviations
        self._state_port = self.DeclareVectorInputPort("state", 6)
        self._command_port = self.DeclareVectorInputPort("force", 3)
        self._errors_port = self.DeclareVectorInputPort("deviations", 2)
        self.DeclareVectorOutputPort("force", 3, self._calc, {self.all_input_ports_ticket()})

    def _calc(self, context, output):
        force, state = self._command_port.Eval(context), self._state_port.Eval(context)
        if not math.isfinite(float(state.sum())):
            output.SetFromVector(force)
            return
        distance, closing = (self._deviations * self._errors_port.Eval(context)).tolist()
        command = force / self._mass
        given = assured(command, state, (distance, closing), self.limits)
        output.SetFromVector(force if given is command else self._mass * given)
