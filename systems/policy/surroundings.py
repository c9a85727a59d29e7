"""`Surroundings`: dimensionless parameters of body and spacecraft, inputs of a guidance network."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from proxops.systems.common import States, Vector3, Vectors3, check_positive, kernel
from proxops.systems.gravity import GRAVITATIONAL_CONSTANT, Field
from proxops.systems.rotation import Spin, SpinModel, spin_model

# The unit of length is this share of the longest semi-axis, so that positions are about 1.
_LENGTH_SHARE = 0.7
INPUTS = 23
"""Number of inputs of a guidance network: see `Surroundings.inputs`."""
NUMBERS = (
    "semi_axis_x", "semi_axis_y", "semi_axis_z", "gravity", "spin", "speed_limit", "period", "pace",
)  # fmt: skip
"""Names of the proportions of body and spacecraft: see `Surroundings.numbers`."""


class _Units(NamedTuple):
    """Of length in m, speed in m/s and acceleration in m/s^2."""

    length: float
    speed: float
    acceleration: float


@dataclass(frozen=True)
class Surroundings:
    """What is believed of the body and the spacecraft, as far as the guidance depends on it.

    Everything that the network sees is made without dimensions by a length L (0.7 of the longest
    semi-axis), the greatest thrust acceleration per axis a, and sqrt(L a) for speeds. So two bodies
    and spacecraft in the same proportions are one to it.
    """

    field: Field
    """Gravity in K."""
    mass: float
    """Of the body, in kg."""
    spin: Spin
    """Of the body; a number is in rad/s about z."""
    semi_axes: Vector3
    """(3,) in m, of the ellipsoid to stay out of, with all margins."""
    acceleration: float
    """Thrust limit per axis over the spacecraft's mass, in m/s^2."""
    speed_limit: float
    """Greatest speed per axis in K, in m/s."""
    period: float
    """Control period in s."""
    nominal_acceleration: float
    """In m/s^2: that which sets the expert's price of time, and so its pace."""
    ranges: Mapping[str, tuple[float, float]] | None = None
    """Least and greatest value of each of `numbers` that a network is told; None: as they are."""
    order: tuple[int, int, int] = (0, 1, 2)
    """The axes of K along which x, y and z of the network lie, y backwards if the order is odd: so
    the network's axes are K's, turned."""

    def __post_init__(self):
        """Checks the numbers."""
        check_positive(
            "Surroundings",
            acceleration=self.acceleration,
            speed_limit=self.speed_limit,
            period=self.period,
            nominal_acceleration=self.nominal_acceleration,
            shortest_semi_axis=float(np.min(self.semi_axes)),
            longest_semi_axis=float(np.max(self.semi_axes)),
        )

    @cached_property
    def _spin(self) -> SpinModel:
        return spin_model(self.spin)

    @cached_property
    def length(self) -> float:
        """The unit of length L in m."""
        return _LENGTH_SHARE * float(np.max(self.semi_axes))

    @cached_property
    def speed(self) -> float:
        """The unit of speed sqrt(L a) in m/s."""
        return math.sqrt(self.length * self.acceleration)

    @cached_property
    def time(self) -> float:
        """The unit of time sqrt(L / a) in s."""
        return self.length / self.speed

    def numbers(self) -> dict[str, float]:
        """All that is constant in a flight, by name: proportions of body and spacecraft.

        `semi_axis_x`, `semi_axis_y`, `semi_axis_z` over L; `gravity`, G M / (L^2 a); `spin`, the
        rate at time 0 times sqrt(L / a); `speed_limit` over sqrt(L a); `period` over sqrt(L / a);
        `pace`, the nominal acceleration over a.
        """
        length, time = self.length, self.time
        x, y, z = (float(self.semi_axes[axis]) / length for axis in self.order)
        gravity = GRAVITATIONAL_CONSTANT * self.mass / (length**2 * self.acceleration)
        turn = float(np.linalg.norm(self._spin.rate)) * time
        speed = self.speed_limit / self.speed
        pace = self.nominal_acceleration / self.acceleration
        values = (x, y, z, gravity, turn, speed, self.period / time, pace)
        return dict(zip(NUMBERS, values, strict=True))

    @cached_property
    def told(self) -> list[float]:
        """Gives `numbers` as a network is told them: the nearest within `ranges`."""
        numbers = self.numbers()
        if self.ranges is None:
            return list(numbers.values())
        return [float(np.clip(value, *self.ranges[name])) for name, value in numbers.items()]

    def inputs(self, states: States, goals: Vectors3) -> np.ndarray:
        """What the network is given.

        Args:
          states: (N, 6) position and velocity in K, in m and m/s.
          goals: (N, 3) positions in K in m, where the spacecraft is to rest.

        Returns:
          (N, 23) float32: position, velocity and goal, three numbers each; the acceleration without
          thrust at the state, and at rest at the goal, over a; and `told`.
        """
        given = self.at_rest(goals)
        self.fill_way(states, goals, given)
        return given

    def at_rest(
        self, goals: Vectors3, time: float = 0.0, gravity: Vectors3 | None = None
    ) -> np.ndarray:
        """Gives `inputs` (N, 23) at rest at goals (N, 3), at a time in s: see `fill_way`."""
        given = np.empty((len(goals), INPUTS), dtype=np.float32)
        states = np.concatenate([goals, np.zeros_like(goals)], axis=1)
        self.fill_way(states, goals, given, time, gravity)
        given[:, 12:15] = given[:, 9:12]
        given[:, 15:] = self.told
        return given

    def fill_way(
        self,
        states: np.ndarray,
        goals: np.ndarray,
        given: np.ndarray,
        time: float = 0.0,
        gravity: Vectors3 | None = None,
    ) -> None:
        """Fills the twelve columns of `inputs` that change along the way, at a time in s.

        `gravity` (N, 3) is that at the states in m/s^2, if it is known.
        """
        if gravity is None:
            gravity = self.field.evaluate(states[:, :3]).acceleration
        units = _Units(self.length, self.speed, self.acceleration)
        rate, change = self._spin.angular_velocity(time), self._spin.angular_acceleration(time)
        turning = (*rate.tolist(), *change.tolist())
        _fill_way(states, goals, gravity, turning, units, self.order, given)

    def in_body_frame(self, x: float, y: float, z: float) -> Vector3:
        """Gives a vector of the network as (3,) in K."""
        vector = np.empty(3)
        vector[list(self.order)] = x, _backwards(*self.order) * y, z
        return vector


@kernel(error_model="numpy", forceinline=True)
def _backwards(i, j, k):
    """1 for an even order of three axes, -1 for an odd one."""
    return 1.0 if (j - i) % 3 == 1 else -1.0


@kernel(error_model="numpy")
def _fill_way(states, goals, gravity, turning, units, order, given):
    """Fills twelve columns: state and goal, and acceleration without thrust, in their units.

    `turning` are w and its derivative, six numbers in rad/s and rad/s^2.
    """
    length, speed, acceleration = units
    a, b, c, d, e, f = turning
    sign = _backwards(order[0], order[1], order[2])
    for k in range(len(states)):
        x, y, z, v_x, v_y, v_z = states[k]
        for axis in range(3):
            given[k, axis] = states[k, axis] / length
            given[k, 3 + axis] = states[k, 3 + axis] / speed
            given[k, 6 + axis] = goals[k, axis] / length
        # Less w x (w x r), 2 w x v and w' x r.
        turn = a * x + b * y + c * z
        square = a**2 + b**2 + c**2
        along_x = (square * x - a * turn) + 2.0 * (c * v_y - b * v_z) - (e * z - f * y)
        along_y = (square * y - b * turn) + 2.0 * (a * v_z - c * v_x) - (f * x - d * z)
        along_z = (square * z - c * turn) + 2.0 * (b * v_x - a * v_y) - (d * y - e * x)
        given[k, 9] = (gravity[k, 0] + along_x) / acceleration
        given[k, 10] = (gravity[k, 1] + along_y) / acceleration
        given[k, 11] = (gravity[k, 2] + along_z) / acceleration
        for first in range(0, 12, 3):
            along = (given[k, first], given[k, first + 1], given[k, first + 2])
            given[k, first] = along[order[0]]
            given[k, first + 1] = sign * along[order[1]]
            given[k, first + 2] = along[order[2]]
