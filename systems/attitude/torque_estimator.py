"""`TorqueEstimator`: the torque of each thruster, and what else turns S, from how S turns."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from pydrake.systems.framework import LeafSystem

from proxops.systems.attitude.thruster_layout import ThrusterLayout
from proxops.systems.common import (
    Matrix3,
    Values,
    Vector3,
    cross_matrix,
    inverse_matrix,
    kernel,
)

CENTRE, TORQUE, FIRST = slice(0, 3), slice(3, 6), 6
"""Where the estimate has the centre of mass (m, S), the disturbing torque (N m, S), and from where
on the error of each thruster's lever (m, S), three numbers each."""
# A thruster has failed once that is more likely by exp(25), and than for any other by exp(10): each
# step may bring a chance, and there is one hypothesis for each thruster.
_SURE, _BEFORE_OTHERS = 25.0, 10.0
# From a step whose innovation is beyond this chi square of three degrees of freedom, once in 1e6,
# nothing is learned if a failure explains it: a torque that is missing would be taken for others.
_CONTRADICTION = 30.0
# The inertia is known to this share (1 sigma), so the torque that turns S is, too.
_INERTIA = 0.05
_FAILED = -1.0
_ONE = np.eye(3)
_NO_WHEELS = np.zeros(0)


class _Errors(NamedTuple):
    """Standard deviations of what is estimated at first, and how it may change."""

    centre: float = 0.015
    """Of the centre of mass along each axis, in m."""
    scale: float = 0.03
    """Of the force of a thruster over the nominal one."""
    direction: float = math.radians(0.4)
    """Of its direction about each axis, in rad."""
    place: float = 0.004
    """Of its place along each axis, in m."""
    torque: float = 1e-3
    """Of the disturbing torque, in N m."""
    torque_walk: float = 2e-5
    """What is added to the disturbing torque in 1 s, in N m."""


_ERRORS = _Errors()


class TorqueEstimate(NamedTuple):
    """What is believed of the torque on the spacecraft."""

    mean: Values
    """(6 + 3 n,)."""
    covariance: np.ndarray
    """(6 + 3 n, 6 + 3 n)."""
    suspicion: Values
    """(n,) log-likelihood that a thruster has failed, over that it works; -1: it has failed."""

    @property
    def levers(self) -> np.ndarray:
        """The errors of the levers (3, n) in m."""
        return self.mean[FIRST:].reshape(-1, 3).T


def first_torque_estimate(layout: ThrusterLayout) -> TorqueEstimate:
    """What is believed at first: the data sheet, within errors."""
    n, errors = layout.count, _ERRORS
    covariance = np.zeros((6 + 3 * n, 6 + 3 * n))
    covariance[CENTRE, CENTRE] = errors.centre**2 * _ONE
    covariance[TORQUE, TORQUE] = errors.torque**2 * _ONE
    for k, (place, lever) in enumerate(zip(layout.places, layout.levers, strict=True)):
        own = slice(FIRST + 3 * k, FIRST + 3 * k + 3)
        other = errors.place**2 + errors.direction**2 * float(place @ place)
        covariance[own, own] = errors.scale**2 * np.outer(lever, lever) + other * _ONE
    return TorqueEstimate(np.zeros(6 + 3 * n), covariance, np.zeros(n))


def corrected_torque(
    prior: TorqueEstimate, unexplained: Vector3, pushes: np.ndarray, noise: Matrix3
) -> TorqueEstimate:
    """The estimate after a period: a Kalman filter's step, and a test for failed thrusters.

    With F_i the mean force of a thruster that works and f_i its size, e_i the error of its lever, c
    the centre of mass and d the disturbing torque, the torque that the data sheet does not explain
    is y = sum f_i e_i - c x sum F_i + d.

    Where a thruster gives nothing, its whole torque T_i + f_i e_i - c x F_i is missing in y. The
    logarithm of the likelihood of that over the other is summed over the periods, and cut at 0
    (Page's test, Biometrika 41 (1954) 100).

    Args:
      prior: before. unexplained: y (3,) in N m.
      pushes: (6, n) mean force F_i in N and torque T_i in N m of each thruster by the data sheet; 0
        of those that have failed.
      noise: (3, 3) covariance of y in (N m)^2.
    """
    mean, covariance, suspicion = _corrected(*prior, unexplained, pushes, noise)
    return TorqueEstimate(mean, covariance, suspicion)


@kernel(error_model="numpy")
def _corrected(mean, covariance, suspicion, unexplained, pushes, noise):
    """The numbers of `corrected_torque`."""
    n, size = pushes.shape[1], len(mean)
    forces, all_forces, cross = pushes[:3], np.zeros(3), cross_matrix(mean[:3])
    rows, own, innovation = np.zeros((3, size)), np.zeros((3, n)), unexplained - mean[3:6]
    for k in range(n):
        first = FIRST + 3 * k
        force = math.sqrt(forces[0, k] ** 2 + forces[1, k] ** 2 + forces[2, k] ** 2)
        for i in range(3):
            rows[i, first + i] = force
            all_forces[i] += forces[i, k]
            own[i, k] = force * mean[first + i]
            for j in range(3):
                own[i, k] -= cross[i, j] * forces[j, k]
            innovation[i] -= own[i, k]
    rows[:, :3] = cross_matrix(all_forces)
    for i in range(3):
        rows[i, 3 + i] = 1.0
    across, total = np.zeros((3, size)), noise.copy()
    for i in range(3):
        for k in range(size):
            if rows[i, k] != 0.0:
                for m in range(size):
                    across[i, m] += rows[i, k] * covariance[k, m]
        for j in range(3):
            for k in range(size):
                total[i, j] += across[i, k] * rows[j, k]
    inverse = inverse_matrix(total)

    after, highest, ratios = suspicion.copy(), -np.inf, np.zeros(n)
    for k in range(n):
        for i in range(3):
            lost = -(pushes[3 + i, k] + own[i, k])
            for j in range(3):
                other = -(pushes[3 + j, k] + own[j, k])
                ratios[k] += lost * inverse[i, j] * (innovation[j] - 0.5 * other)
        if suspicion[k] != _FAILED:
            after[k] = max(suspicion[k] + ratios[k], 0.0)
        highest = max(highest, ratios[k])
    worst = int(np.argmax(after))
    second = -np.inf
    for k in range(n):
        if k != worst:
            second = max(second, after[k])
    if after[worst] > _SURE and after[worst] - second > _BEFORE_OTHERS:
        after = np.where(suspicion == _FAILED, _FAILED, 0.0)
        after[worst] = _FAILED
        return mean, covariance, after
    weighted, square = np.zeros(3), 0.0
    for i in range(3):
        for j in range(3):
            weighted[i] += inverse[i, j] * innovation[j]
        square += weighted[i] * innovation[i]
    if square > _CONTRADICTION and highest > 0.0:
        return mean, covariance, after
    # With C the rows' covariance, G = S^-1 C: the mean grows by C^T S^-1 y, P falls by C^T G.
    gain = np.zeros((3, size))
    for i in range(3):
        for j in range(3):
            gain[i] += inverse[i, j] * across[j]
    new_mean, new_covariance = mean.copy(), np.empty((size, size))
    for k in range(size):
        for i in range(3):
            new_mean[k] += across[i, k] * weighted[i]
        for m in range(k + 1):
            value = 0.5 * (covariance[k, m] + covariance[m, k])
            for i in range(3):
                value -= across[i, k] * gain[i, m]
            new_covariance[k, m] = new_covariance[m, k] = value
    return new_mean, new_covariance, after


class _Turned(NamedTuple):
    """How the bus turned over a period."""

    before: Vector3
    """(3,) angular velocity in rad/s in S, at its start."""
    after: Vector3
    """(3,) at its end."""
    motors: Values
    """(m,) torques of the wheels' motors in N m."""
    momenta: Values
    """(m,) of the wheels at its end in N m s."""
    period: float
    """s."""


@kernel(error_model="numpy")
def _torque_on_bus(turned, inertia, wheel_axes):
    """The torque (3,) in N m from outside, by Euler's equation, and its covariance (3, 3).

    That is J w' + h' + w x (J w + h), with the motors' torques h', in the middle of the period.
    """
    turning, torque, momentum = np.zeros(3), np.zeros(3), np.zeros(3)
    middle = 0.5 * (turned.before + turned.after)
    for i in range(3):
        for j in range(3):
            turning[i] += inertia[i, j] * (turned.after[j] - turned.before[j]) / turned.period
            momentum[i] += inertia[i, j] * middle[j]
        torque[i] = turning[i]
        for k in range(len(wheel_axes)):
            motor = turned.motors[k]
            torque[i] += motor * wheel_axes[k, i]
            momentum[i] += (turned.momenta[k] - 0.5 * turned.period * motor) * wheel_axes[k, i]
    cross, noise = cross_matrix(middle), np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            torque[i] += cross[i, j] * momentum[j]
        noise[i, i] = (_INERTIA * turning[i]) ** 2
    return torque, noise


class TorqueEstimator(LeafSystem):
    """Estimates what turns the spacecraft beside what is commanded, at attitude steps.

    ```
    angular_velocity (3), rad/s, S ─►┌─────────────────┐─► centre_of_mass (3), m, S
    on_times (n), s ────────────────►│                 │─► torque (3), N m, S
    wheel_torque (m), N m ──────────►│ TorqueEstimator │─► thruster_torques (3 n), N m, S
    wheel_momentum (m), N m s ──────►│                 │─► failed (n): 1 of a failed thruster
    outside_force (1), N ───────────►└─────────────────┘
    ```

    `on_times` and `wheel_torque` are those of the period that ends now. The torque over it follows
    from the change of the angular velocity; the data sheet explains a part; `corrected_torque`
    takes the rest. `centre_of_mass` is from that of the data sheet; `torque` is what no thruster
    gives; `thruster_torques` are those of each thruster that is on, about the true centre of mass,
    the first number of all, then the second, then the third. The state at an attitude step is that
    after the step before, so outputs do not depend on inputs directly. Nothing is learned from a
    period with an `outside_force`, which may remain open: it turns S, too.
    """

    def __init__(
        self,
        layout: ThrusterLayout,
        inertia: Matrix3,
        period: float,
        rate_noise: float,
        wheel_axes: np.ndarray | None = None,
    ):
        """Takes what is believed.

        Args:
          layout: of the thrusters. inertia: (3, 3) in kg m^2 of all. period: s.
          rate_noise: standard deviation of the angular velocity in rad/s.
          wheel_axes: (m, 3) unit vectors; None: no wheels.
        """
        super().__init__()
        self.layout, self.inertia, self.period = layout, inertia, period
        self.wheel_axes = np.zeros((0, 3)) if wheel_axes is None else wheel_axes
        per_second = inertia * (math.sqrt(2.0) * rate_noise / period)
        self._noise = per_second @ per_second.T + 1e-12 * _ONE
        self._wrenches = layout.wrenches()
        first = first_torque_estimate(layout)
        self._size, self._walk = first.mean.size, np.zeros_like(first.covariance)
        self._walk[TORQUE, TORQUE] = _ERRORS.torque_walk**2 * period * _ONE
        declare = self.DeclareVectorInputPort
        self._rate_port = declare("angular_velocity", 3)
        self._on_port = declare("on_times", layout.count)
        if len(self.wheel_axes):
            self._wheel_port = declare("wheel_torque", len(self.wheel_axes))
            self._momentum_port = declare("wheel_momentum", len(self.wheel_axes))
        self._outside_port = declare("outside_force", 1)
        # The last angular velocity (NaN: none yet), and the estimate.
        self._memory = self.DeclareDiscreteState(self._packed(np.full(3, np.nan), first))
        for name, size, of in (
            ("centre_of_mass", 3, lambda now: now.mean[CENTRE]),
            ("torque", 3, lambda now: now.mean[TORQUE]),
            ("thruster_torques", 3 * layout.count, self._thruster_torques),
            ("failed", layout.count, lambda now: now.suspicion == _FAILED),
        ):
            self.DeclareVectorOutputPort(
                name,
                size,
                lambda context, output, of=of: output.SetFromVector(of(self.estimate(context))),
                {self.xd_ticket()},
            )
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)

    def estimate(self, context) -> TorqueEstimate:
        """The estimate in a Context of this system."""
        self.ValidateContext(context)
        return self._unpacked(context.get_discrete_state(self._memory).value())[1]

    def _thruster_torques(self, now: TorqueEstimate) -> Values:
        torques = self._wrenches[3:] + self.layout.forces * now.levers
        return (torques - cross_matrix(now.mean[CENTRE]) @ self._wrenches[:3]).ravel()

    def _update(self, context, discrete_state):
        last, before = self._unpacked(context.get_discrete_state(self._memory).value())
        rate, on = self._rate_port.Eval(context), self._on_port.Eval(context)
        now, outside = before, self._outside_port
        pushed = outside.HasValue(context) and outside.Eval(context)[0] > 0.0
        if np.isfinite(last[0]) and not pushed:
            motors, momenta = _NO_WHEELS, _NO_WHEELS
            if len(self.wheel_axes):
                motors, momenta = self._wheel_port.Eval(context), self._momentum_port.Eval(context)
            turned = _Turned(last, rate, motors, momenta, self.period)
            share = np.where(before.suspicion == _FAILED, 0.0, on / self.period)
            pushes = self._wrenches * share
            torque, noise = _torque_on_bus(turned, self.inertia, self.wheel_axes)
            prior = before._replace(covariance=before.covariance + self._walk)
            unexplained = torque - pushes[3:].sum(axis=1)
            now = corrected_torque(prior, unexplained, pushes, self._noise + noise)
        discrete_state.set_value(self._memory, self._packed(rate, now))

    def _packed(self, rate: Vector3, estimate: TorqueEstimate) -> Values:
        parts = (rate, estimate.mean, estimate.suspicion, estimate.covariance.ravel())
        return np.concatenate(parts)

    def _unpacked(self, vector: Values) -> tuple[Vector3, TorqueEstimate]:
        n, thrusters = self._size, self.layout.count
        mean, rest = vector[3 : 3 + n], vector[3 + n :]
        covariance = rest[thrusters:].reshape(n, n)
        return vector[:3], TorqueEstimate(mean, covariance, rest[:thrusters])
