"""`TorqueEstimator`: the torque of each thruster, and what else turns S, from how S turns."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from pydrake.systems.framework import LeafSystem

from proxops.systems.attitude.thruster_layout import ThrusterLayout
from proxops.systems.common import Matrix3, Values, Vector3, cross_matrix

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
    mean, covariance, suspicion = prior
    forces = pushes[:3]
    sizes = np.sqrt((forces * forces).sum(axis=0))
    shift = cross_matrix(mean[CENTRE]) @ forces
    own = sizes * prior.levers - shift
    rows = np.hstack([cross_matrix(forces.sum(axis=1)), _ONE, np.kron(sizes, _ONE)])
    innovation = unexplained - own.sum(axis=1) - mean[TORQUE]
    across = rows @ covariance
    inverse = np.linalg.inv(across @ rows.T + noise)

    lost = -(pushes[3:] + own)
    weighted = inverse @ lost
    ratio = innovation @ weighted - 0.5 * (lost * weighted).sum(axis=0)
    suspicion = np.where(suspicion == _FAILED, _FAILED, np.maximum(suspicion + ratio, 0.0))
    first, second = np.sort(suspicion)[[-1, -2]]
    if first > _SURE and first - second > _BEFORE_OTHERS:
        suspicion = np.where(suspicion == _FAILED, _FAILED, 0.0)
        suspicion[np.argmax(prior.suspicion + ratio)] = _FAILED
        return TorqueEstimate(mean, covariance, suspicion)
    if innovation @ inverse @ innovation > _CONTRADICTION and ratio.max() > 0.0:
        return TorqueEstimate(mean, covariance, suspicion)
    gain = across.T @ inverse
    after = covariance - gain @ across
    return TorqueEstimate(mean + gain @ innovation, 0.5 * (after + after.T), suspicion)


class TorqueEstimator(LeafSystem):
    """Estimates what turns the spacecraft beside what is commanded, at attitude steps.

    ```
    angular_velocity (3), rad/s, S ─►┌─────────────────┐─► centre_of_mass (3), m, S
    on_times (n), s ────────────────►│                 │─► torque (3), N m, S
    wheel_torque (m), N m ──────────►│ TorqueEstimator │─► thruster_torques (3 n), N m, S
    wheel_momentum (m), N m s ──────►└─────────────────┘─► failed (n): 1 of a failed thruster
    ```

    `on_times` and `wheel_torque` are those of the period that ends now. The torque over it follows
    from the change of the angular velocity; the data sheet explains a part; `corrected_torque`
    takes the rest. `centre_of_mass` is from that of the data sheet; `torque` is what no thruster
    gives; `thruster_torques` are those of each thruster that is on, about the true centre of mass,
    the first number of all, then the second, then the third. The state at an attitude step is that
    after the step before, so outputs do not depend on inputs directly.
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
        self._size, self._walk = first.mean.size, _ERRORS.torque_walk**2 * period
        declare = self.DeclareVectorInputPort
        self._rate_port = declare("angular_velocity", 3)
        self._on_port = declare("on_times", layout.count)
        if len(self.wheel_axes):
            self._wheel_port = declare("wheel_torque", len(self.wheel_axes))
            self._momentum_port = declare("wheel_momentum", len(self.wheel_axes))
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
        return self._unpacked(context.get_discrete_state(self._memory).value())[1]

    def _thruster_torques(self, now: TorqueEstimate) -> Values:
        torques = self._wrenches[3:] + self.layout.forces * now.levers
        return (torques - cross_matrix(now.mean[CENTRE]) @ self._wrenches[:3]).ravel()

    def _update(self, context, discrete_state):
        last, before = self._unpacked(context.get_discrete_state(self._memory).value())
        rate, on = self._rate_port.Eval(context), self._on_port.Eval(context)
        now = before
        if np.isfinite(last[0]):
            mean, momentum = 0.5 * (rate + last), np.zeros(3)
            turning = self.inertia @ (rate - last) / self.period
            torque = turning
            if len(self.wheel_axes):
                motor = self._wheel_port.Eval(context)
                middle = self._momentum_port.Eval(context) - 0.5 * self.period * motor
                momentum = middle @ self.wheel_axes
                torque = torque + motor @ self.wheel_axes
            torque = torque + cross_matrix(mean) @ (self.inertia @ mean + momentum)
            share = np.where(before.suspicion == _FAILED, 0.0, on / self.period)
            pushes = self._wrenches * share
            noise = self._noise + np.diag((_INERTIA * turning) ** 2)
            covariance = before.covariance.copy()
            covariance[TORQUE, TORQUE] += self._walk * _ONE
            prior = before._replace(covariance=covariance)
            now = corrected_torque(prior, torque - pushes[3:].sum(axis=1), pushes, noise)
        discrete_state.set_value(self._memory, self._packed(rate, now))

    def _packed(self, rate: Vector3, estimate: TorqueEstimate) -> Values:
        parts = (rate, estimate.mean, estimate.suspicion, estimate.covariance.ravel())
        return np.concatenate(parts)

    def _unpacked(self, vector: Values) -> tuple[Vector3, TorqueEstimate]:
        n, thrusters, vector = self._size, self.layout.count, vector.copy()
        mean, rest = vector[3 : 3 + n], vector[3 + n :]
        covariance = rest[thrusters:].reshape(n, n)
        return vector[:3], TorqueEstimate(mean, covariance, rest[:thrusters])
