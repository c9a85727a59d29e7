"""`AttitudeFilter`: attitude and angular velocity from star tracker and gyro."""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import LeafSystem, ValueProducer

from proxops.systems.attitude.attitude_control import attitude_error
from proxops.systems.attitude.gyro import DRIFT_TIME, GyroConfig
from proxops.systems.attitude.star_tracker import StarTrackerConfig
from proxops.systems.common import (
    Quaternion,
    Values,
    Vector3,
    cross_matrix,
    inverse_matrix,
    kernel,
    quaternion_inverse,
    quaternion_of,
    quaternion_product,
)
from proxops.systems.rotation import Spin, spin_model

# Deviations below these would make the covariance singular: rad, and rad/s.
_LEAST_NOISE, _LEAST_BIAS = 1e-7, 1e-9
# Periods after which the covariance changes no more.
_SETTLING = 500


class AttitudeEstimate(NamedTuple):
    """What the filter believes."""

    attitude: Values
    """R_NS (4,): a unit quaternion (w, x, y, z)."""
    bias: Vector3
    """(3,) of the gyro in rad/s."""
    covariance: np.ndarray
    """(6, 6) of the attitude's rotation vector in S in rad, and of the bias."""


class AttitudeNoise(NamedTuple):
    """The noise of the sensors, as on their data sheets."""

    tracker: float
    """rad about each axis."""
    gyro: float
    """rad/s."""
    bias: float
    """rad/s."""

    @classmethod
    def of(cls, tracker: StarTrackerConfig, gyro: GyroConfig) -> AttitudeNoise:
        """Takes it from data sheets."""
        return cls(
            max(math.radians(tracker.noise_deg), _LEAST_NOISE),
            max(gyro.noise_rad_s, _LEAST_BIAS),
            max(gyro.bias_rad_s, _LEAST_BIAS),
        )


def first_attitude(measured: Values, noise: AttitudeNoise) -> AttitudeEstimate:
    """The estimate from a first measurement R_NS (4,) of the star tracker."""
    variances = np.repeat([noise.tracker**2, noise.bias**2], 3)
    return AttitudeEstimate(measured, np.zeros(3), np.diag(variances))


def propagated(
    before: AttitudeEstimate, rate: Vector3, period: float, noise: AttitudeNoise
) -> AttitudeEstimate:
    """The estimate after a period, by the gyro.

    Multiplicative extended Kalman filter: Lefferts, Markley and Shuster, J. Guidance 5 (1982) 417.
    The gyro's noise is that of single measurements, the bias a Gauss-Markov process.

    Args:
      before: the period before. rate: (3,) measured in rad/s, the mean over the period.
      period: s. noise: of the sensors.
    """
    turn = period * (rate - before.bias)
    x, y, z = turn.tolist()
    a, b, c, d = before.attitude.tolist()
    attitude = np.array(quaternion_product((a, b, c, d), quaternion_of((x, y, z))))
    kept = math.exp(-period / DRIFT_TIME)
    added = (period * noise.gyro) ** 2, noise.bias**2 * (1.0 - kept**2)
    covariance = _grown(before.covariance, turn, period, kept, added)
    return AttitudeEstimate(attitude / math.hypot(*attitude), kept * before.bias, covariance)


@kernel(error_model="numpy")
def _grown(covariance, turn, period, kept, added):
    """The covariance (6, 6) after a period: C P C^T and the variances that are added."""
    cross = cross_matrix(turn)
    change, half, out = np.zeros((6, 6)), np.zeros((6, 6)), np.zeros((6, 6))
    for i in range(3):
        for j in range(3):
            change[i, j] -= cross[i, j]
            for k in range(3):
                change[i, j] += 0.5 * cross[i, k] * cross[k, j]
        change[i, i] += 1.0
        change[i, i + 3], change[i + 3, i + 3] = -period, kept
        out[i, i], out[i + 3, i + 3] = added
    for i in range(6):
        for j in range(6):
            for k in range(6):
                half[i, j] += change[i, k] * covariance[k, j]
    for i in range(6):
        for j in range(6):
            for k in range(6):
                out[i, j] += half[i, k] * change[j, k]
    return out


def corrected_attitude(
    prior: AttitudeEstimate, measured: Values, noise: AttitudeNoise
) -> AttitudeEstimate:
    """The estimate after a measurement R_NS (4,) of the star tracker."""
    error = attitude_error(measured, prior.attitude)
    change, covariance = _corrected(prior.covariance, error, noise.tracker**2)
    x, y, z = change[:3].tolist()
    a, b, c, d = prior.attitude.tolist()
    attitude = np.array(quaternion_product((a, b, c, d), quaternion_of((x, y, z))))
    return AttitudeEstimate(attitude, prior.bias + change[3:], covariance)


@kernel(error_model="numpy")
def _corrected(covariance, error, variance):
    """What is added to the mean (6,), and the covariance (6, 6), by an error (3,) measured."""
    total = covariance[:3, :3].copy()
    for i in range(3):
        total[i, i] += variance
    inverse = inverse_matrix(total)
    gain, change, after = np.zeros((6, 3)), np.zeros(6), covariance.copy()
    for i in range(6):
        for j in range(3):
            for k in range(3):
                gain[i, j] += covariance[i, k] * inverse[k, j]
            change[i] += gain[i, j] * error[j]
    for i in range(6):
        for j in range(6):
            for k in range(3):
                after[i, j] -= gain[i, k] * covariance[k, j]
    return change, 0.5 * (after + after.T)


@functools.lru_cache(maxsize=8)
def settled_noise(noise: AttitudeNoise, period: float, steps: int) -> tuple[float, float]:
    """What a settled filter's attitude is like to those who take it once in some periods.

    A filter averages, so its errors are alike from one time to the next. With A = (1 - K H) F, what
    becomes of an error within a period, the errors n periods apart have the covariance A^n P.

    Args: noise of the sensors; time in s from measurement to measurement; and the periods.

    Returns:
      The standard deviation in rad about each axis, and the time in s over which the correlation of
      a Gauss-Markov process falls to 1/e whose mean over a long time is as uncertain.
    """
    now = prior = first_attitude(np.array([1.0, 0.0, 0.0, 0.0]), noise)
    for _ in range(_SETTLING):
        prior = propagated(now, np.zeros(3), period, noise)
        now = corrected_attitude(prior, prior.attitude, noise)
    # About one axis; they are alike.
    axis = np.ix_([0, 3], [0, 3])
    after, before = now.covariance[axis], prior.covariance[axis]
    gain = before[:, :1] / (before[0, 0] + noise.tracker**2)
    change = np.array([[1.0, -period], [0.0, math.exp(-period / DRIFT_TIME)]])
    alike = np.linalg.matrix_power((np.eye(2) - gain @ np.eye(1, 2)) @ change, steps)
    variance = after[0, 0]
    # With such a process, the sum of the correlations on both sides is (1 + d) / (1 - d).
    total = variance + 2.0 * np.linalg.solve(np.eye(2) - alike, alike @ after)[0, 0]
    decay = max((total - variance) / (total + variance), 0.0)
    return math.sqrt(variance), -period * steps / math.log(decay) if decay else 0.0


class AttitudeFilter(LeafSystem):
    """A Kalman filter of attitude and gyro bias, at attitude steps.

    ```
    star_tracker (4), R_NS; NaN: none ─►┌────────────────┐─► attitude (4), R_NS
    gyro (3), rad/s, S ────────────────►│ AttitudeFilter │─► body_attitude (4), R_KS as believed
                                        │                │─► middle_attitude (4), R_KS, ahead
                                        │                │─► angular_velocity (3), rad/s, S
                                        └────────────────┘─► covariance (36), rad^2 and (rad/s)^2
    ```

    Without a measurement of the star tracker it goes on by the gyro alone. `body_attitude` is
    R_NK^T R_NS, with the spin as believed; `middle_attitude` is what it will be half a
    period later, for what acts over the period. What it remembers is discrete state. Before
    the first measurement of all the attitude is that of K.
    """

    def __init__(self, noise: AttitudeNoise, spin: Spin, period: float):
        """Takes the noise of the sensors, the spin as believed, and the period in s.

        A spin that is a number is in rad/s about z.
        """
        super().__init__()
        self.noise, self.spin, self.period = noise, spin_model(spin), period
        self._tracker_port = self.DeclareVectorInputPort("star_tracker", 4)
        self._gyro_port = self.DeclareVectorInputPort("gyro", 3)
        # Whether there is an estimate, the last rate, and the estimate.
        self._memory = self.DeclareDiscreteState(1 + 3 + 4 + 3 + 36)
        self._step = self.DeclareCacheEntry(
            "step",
            ValueProducer(allocate=lambda: AbstractValue.Make(object()), calc=self._calc_step),
            {self.all_input_ports_ticket(), self.xd_ticket()},
        )
        step, time = self._step.ticket(), self.time_ticket()
        declare = self.DeclareVectorOutputPort
        declare("attitude", 4, self._calc_attitude, {step})
        declare("body_attitude", 4, self._calc_body_attitude, {step, time})
        rate = self._gyro_port.ticket()
        declare("middle_attitude", 4, self._calc_middle_attitude, {step, time, rate})
        declare("angular_velocity", 3, self._calc_rate, {step, rate})
        declare("covariance", 36, self._calc_covariance, {step})
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._remember)

    def estimate(self, context) -> AttitudeEstimate:
        """The estimate in a Context of this system, at an attitude step."""
        self.ValidateContext(context)
        return self._step.Eval(context)

    def _calc_step(self, context, value):
        memory = context.get_discrete_state(self._memory).value()
        measured, rate = self._tracker_port.Eval(context), self._gyro_port.Eval(context)
        seen = bool(np.isfinite(measured[0]))
        if not memory[0]:
            start = measured if seen else np.array([1.0, 0.0, 0.0, 0.0])
            value.set_value(first_attitude(start, self.noise))
            return
        before = AttitudeEstimate(memory[4:8], memory[8:11], memory[11:].reshape(6, 6))
        now = propagated(before, 0.5 * (memory[1:4] + rate), self.period, self.noise)
        value.set_value(corrected_attitude(now, measured, self.noise) if seen else now)

    def _calc_attitude(self, context, output):
        output.SetFromVector(self.estimate(context).attitude)

    def _against_body(self, attitude: Quaternion, time: float) -> Quaternion:
        """R_KS as believed of R_NS at a time."""
        return quaternion_product(quaternion_inverse(self.spin.attitude(time)), attitude)

    def _calc_body_attitude(self, context, output):
        a, b, c, d = self.estimate(context).attitude.tolist()
        output.SetFromVector(self._against_body((a, b, c, d), context.get_time()))

    def _calc_middle_attitude(self, context, output):
        now, half = self.estimate(context), 0.5 * self.period
        x, y, z = (half * (self._gyro_port.Eval(context) - now.bias)).tolist()
        a, b, c, d = now.attitude.tolist()
        ahead = quaternion_product((a, b, c, d), quaternion_of((x, y, z)))
        output.SetFromVector(self._against_body(ahead, context.get_time() + half))

    def _calc_rate(self, context, output):
        output.SetFromVector(self._gyro_port.Eval(context) - self.estimate(context).bias)

    def _calc_covariance(self, context, output):
        output.SetFromVector(self.estimate(context).covariance.ravel())

    def _remember(self, context, discrete_state):
        now, known = self.estimate(context), context.get_discrete_state(self._memory).value()[0]
        if not known and not np.isfinite(self._tracker_port.Eval(context)[0]):
            return
        rate = self._gyro_port.Eval(context)
        packed = [[1.0], rate, now.attitude, now.bias, now.covariance.ravel()]
        discrete_state.set_value(self._memory, np.concatenate(packed))
