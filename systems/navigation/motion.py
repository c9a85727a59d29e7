"""`Motion`: predicts the navigation's estimate by the believed gravity and the own command."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from proxops.systems.common import Vector3, Vectors3
from proxops.systems.gravity import Field
from proxops.systems.navigation._motion_kernel import LocalGravity, ProcessNoise, Turning, predict
from proxops.systems.navigation.estimate import CENTRE_OF_MASS, POSITION, SIZE, VELOCITY, Estimate
from proxops.systems.navigation.expected_errors import ExpectedErrors
from proxops.systems.rotation import Spin, spin_model

# In one step of the prediction, the body turns by at most this angle (rad), and the spacecraft
# moves by at most this share of the body's radius.
_TURN, _SHARE = 0.02, 0.02
_MOST_STEPS = 200
# Gravity over a step is the mean of two points, in times of half a step from the middle (Gauss):
# near an edge of the body it is not linear.
_POINTS = np.array([[-1.0], [1.0]]) / math.sqrt(3.0)


PUSH_SIZE = 10
"""Numbers in a packed `Push`."""


class Push(NamedTuple):
    """What the thrusters gave over a period, as far as is known; vectors (3,) along S's axes."""

    force: Vector3
    """Its mean in N."""
    thrust: float
    """Sum of the forces of all thrusters in N, which use up propellant."""
    apart: Vector3 = np.zeros(3)
    """Root of the sum of squares of the forces of all thrusters in N: see `GivenForce`."""
    lead: Vector3 = np.zeros(3)
    """How early the force acted, in N s^2: see `GivenForce`."""

    @classmethod
    def along_axes(cls, force: Vector3, least: float = 0.0) -> Push:
        """Of thrusters along S's axes, which give no force of less than `least` N."""
        given = np.where(np.abs(force) < least, 0.0, force)
        return cls(given, sum(map(abs, given.tolist())))

    def packed(self) -> np.ndarray:
        """As a row (PUSH_SIZE,)."""
        return np.concatenate([self.force, [self.thrust], self.apart, self.lead])

    @classmethod
    def unpacked(cls, row: np.ndarray) -> Push:
        """From a row (PUSH_SIZE,)."""
        return cls(row[:3], float(row[3]), row[4:7], row[7:])


class Motion:
    """The believed equations of motion, and how uncertain they make an estimate."""

    def __init__(
        self,
        field: Field,
        extents: np.ndarray,
        spin: Spin,
        mass: float,
        expected: ExpectedErrors,
    ):
        """Takes what is believed.

        Args:
          field: gravity in K. extents: (3,) of the body along its axes, in m.
          spin: of the body; a number is in rad/s about z. mass: of the spacecraft in kg.
          expected: one standard deviation of everything.
        """
        self.spin = spin_model(spin)
        self._field, self.mass = field, mass
        # Over this length gravity changes.
        self._radius, self._half_length = 0.5 * float(extents.min()), 0.5 * float(extents.max())
        self._expected = expected

    def predicted(self, estimate: Estimate, push: Push, time: float, duration: float) -> Estimate:
        """The estimate `duration` s after `time`, under what the thrusters gave meanwhile."""
        speed = math.hypot(*estimate.mean[VELOCITY].tolist())
        turn = float(np.linalg.norm(self.spin.rate)) * duration
        steps = math.ceil(max(1.0, turn / _TURN, speed * duration / (_SHARE * self._radius)))
        steps = min(steps, _MOST_STEPS)
        step = duration / steps
        spent = push.thrust * step / self.mass
        pushed = self._varying_push(push)
        for k in range(steps):
            mean = estimate.mean
            half = 0.5 * step * mean[VELOCITY]
            middle = mean[POSITION] + half - mean[CENTRE_OF_MASS]
            local = self._gravity(middle + _POINTS * half, 1.0 + mean[SIZE])
            moved: tuple[np.ndarray, np.ndarray, np.ndarray] = predict(
                estimate,
                local,
                push.force,
                step,
                self._noise(step, self._uneven(middle, local.acceleration) + pushed),
                self._turning(time + (k + 0.5) * step, step),
                self.mass,
            )
            estimate = Estimate(*moved, estimate.spent + spent)
        if push.lead.any():
            estimate = self._with_lead(estimate, push.lead, time + duration)
        return estimate

    def _varying_push(self, push: Push) -> np.ndarray:
        """Variance (3,) in (m/s^2)^2 along each axis of what varies as other thrusters push.

        Errors of the thrusters' own, which are independent, add as squares: of their sizes along
        each force, of their directions across it.
        """
        expected = self._expected
        along = push.apart**2
        across = along.sum() - along
        own = expected.thruster**2 * along
        own = own + math.radians(expected.thruster_direction_deg) ** 2 * across
        common = expected.thrust_varying**2 * float(push.force @ push.force)
        return (own + common) / self.mass**2

    def _with_lead(self, estimate: Estimate, lead: Vector3, time: float) -> Estimate:
        """The estimate at a time in s, after a period in which the force acted early.

        What it moved the spacecraft by more has turned the velocity, too, as Coriolis' acceleration
        does.
        """
        mean, farther = estimate.mean.copy(), estimate.rotation @ lead / self.mass
        mean[POSITION] += farther
        mean[VELOCITY] -= 2.0 * np.cross(self.spin.angular_velocity(time), farther)
        return estimate._replace(mean=mean)

    def _turning(self, middle: float, step: float) -> Turning:
        """How the body turns in a step of a length about a time in s."""
        spin = self.spin
        rate, acceleration = spin.angular_velocity(middle), spin.angular_acceleration(middle)
        return Turning(np.array(rate), np.array(acceleration), spin.errors(middle, step))

    def _gravity(self, points: Vectors3, scale: float) -> LocalGravity:
        """The mean at two points of a body of the believed mass, all lengths times `scale`."""
        gravity = self._field.evaluate(points / scale)
        return LocalGravity(
            0.5 * (gravity.acceleration[0] + gravity.acceleration[1]) / scale**2,
            0.5 * (gravity.gradient[0] + gravity.gradient[1]) / scale**3,
        )

    def _uneven(self, position: np.ndarray, gravity: np.ndarray) -> float:
        """Variance, along each axis, of the gravity (m/s^2) of an uneven density.

        The estimate has its first term, the centre of mass. The next term of the field's expansion
        is smaller by half of the body's length over the distance. With the factor of 1/3, it is
        what halves of different density do at Kleopatra, or up to twice as much.
        """
        shift = self._expected.centre_of_mass_m
        if not shift:
            return 0.0
        ratio = shift * self._half_length / float(position @ position)
        return float(gravity @ gravity) * ratio**2 / 3.0

    def _noise(self, step: float, unmodelled: np.ndarray) -> ProcessNoise:
        """The process noise of a step of a length in s.

        `unmodelled` (3,) is the variance in (m/s^2)^2 of what is added to the acceleration that
        varies.
        """
        expected = self._expected
        decay = math.exp(-step / expected.acceleration_correlation_s)
        attitude = math.radians(expected.attitude_varying_deg)
        varying = expected.acceleration_varying_m_s2**2 + unmodelled
        kept = math.exp(-step / expected.attitude_noise_correlation_s)
        return ProcessNoise(
            2.0 * attitude**2 * step / expected.attitude_correlation_s,
            decay,
            varying * (1.0 - decay**2),
            kept,
            math.radians(expected.attitude_noise_deg) ** 2 * (1.0 - kept**2),
        )
