"""Spin states: how the body's frame K turns in the inertial frame N, as functions of time.

At time 0 the axes of K and N are the same. Each model gives the angular velocity w of K in N and
its derivative, both along the axes of K, and the attitude R_NK.
"""

from __future__ import annotations

import dataclasses as dc
import functools
import math
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy  # Its parts are imported when they are used.

from proxops.systems.common import (
    InputError,
    Matrix3,
    Quaternion,
    Values,
    Vector3,
    check_inertia,
    config,
    cross_matrix,
    quaternion_inverse,
    quaternion_of,
    quaternion_product,
    rotation_matrix,
    vector,
)
from proxops.systems.rotation._torque_free_kernel import Motion, attitudes_at, rates_at, turned_at

# A body whose w x L is below this share of |w| |L| turns about a principal axis.
_STEADY = 1e-12
# Beyond this parameter scipy's elliptic functions no longer come back. A body that spins about its
# middle axis to within 1e-5 rad is given one that is off by 1e-5 rad.
_GREATEST_PARAMETER = 1.0 - 2e-10
# Relative error of what a spin's errors do: far below the errors of a linear model.
_TOLERANCE = 1e-8
# Of the path of errors in each turn of K. A spline through them is off by less than the tolerance.
_KNOTS = 64
# So many times are remembered, with what belongs to them.
_RECENT = 64


@config
class SteadySpinConfig:
    """A body that turns about an axis that stays where it is, in the body and among the stars."""

    # Direction of the axis in the body's frame K.
    axis: list[float] = vector([0.0, 0.0, 1.0], at_least=-1.0, at_most=1.0)


@config
class TorqueFreeSpinConfig:
    """A body that turns as a rigid body without torque: it tumbles, unless the axis is principal.

    At the start of a flight it turns about `axis`, at the rate of one turn in `rotation_period_h`.
    """

    # Direction of the axis in the body's frame K at the start.
    axis: list[float] = vector([0.0, 0.0, 1.0], at_least=-1.0, at_most=1.0)
    # xx, yy, zz, xy, xz, yz of the inertia in K, up to a common factor; []: of the mesh with
    # uniform density.
    inertia: list[float] = dc.field(default_factory=list)


class SpinErrors(NamedTuple):
    """What a small error of w at time 0 does later, to first order. All vectors are in K."""

    rate: Matrix3
    """The error of w at a time, by that of w at time 0."""
    acceleration: Matrix3
    """The error of the derivative of w, in 1/s, likewise."""
    turn: Matrix3
    """The rotation vector by which K turns more in a second, the mean of a step, likewise."""


class SteadySpin:
    """A rotation about a fixed axis at a fixed rate.

    Attributes:
      rate: w (3,) in rad/s, the same in K and in N.
    """

    def __init__(self, rate: Sequence[float] | Vector3):
        """Takes the angular velocity (3,) in rad/s."""
        self.rate = _read_only(np.array(rate, dtype=np.float64))

    @cached_property
    def about_z(self) -> bool:
        """Whether the axis is z."""
        return not self.rate[:2].any()

    def angular_velocity(self, times: float | np.ndarray) -> np.ndarray:
        """w (..., 3) in rad/s, in K, at times (...) in s."""
        if not isinstance(times, np.ndarray):
            return self.rate
        return np.broadcast_to(self.rate, (*np.shape(times), 3))

    def angular_acceleration(self, times: float | np.ndarray) -> np.ndarray:
        """The derivative of w (..., 3) in rad/s^2, in K, at times (...) in s."""
        return np.zeros((*np.shape(times), 3))

    def attitude(self, time: float) -> Quaternion:
        """R_NK at a time in s."""
        x, y, z = self.rate.tolist()
        return quaternion_of((time * x, time * y, time * z))

    def errors(self, time: float, step: float) -> SpinErrors:
        """What an error of w does over a step of s about a time.

        The true axis is fixed in K, and so is w. The axis as believed is fixed in N: in K it goes
        round.
        """
        if self.about_z:
            angle = float(self.rate[2]) * time
            cos, sin = math.cos(angle), math.sin(angle)
            back = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
        else:
            back = rotation_matrix(self.attitude(time)).T
        return SpinErrors(np.eye(3), np.zeros((3, 3)), back)


class TorqueFreeSpin:
    """The rotation of a rigid body without torque, in closed form.

    In the principal axes w is (A1 cn u, A2 sn u, A3 dn u) with u = u0 + f t (Landau and Lifshitz,
    Mechanics, section 37). The first axis goes round the angular momentum L, fixed in N, at

        phi' = L (I2 w2^2 + I3 w3^2) / (L^2 - (I1 w1)^2)

    whose integral is one of the third kind, taken in Carlson's form. So energy and angular momentum
    are those of the start to rounding, at any time.

    Attributes:
      inertia: (3, 3) in K about the centre of mass; a common factor does not matter.
      rate: w (3,) in rad/s at time 0.
    """

    about_z = False

    def __init__(self, inertia: Matrix3, rate: Vector3):
        """Takes the inertia (3, 3) in K and the angular velocity (3,) in rad/s at time 0.

        Raises:
          InputError: no body has this inertia.
        """
        self.inertia = check_inertia("TorqueFreeSpin", inertia)
        self.rate = np.array(rate, dtype=np.float64)
        self._inverse = np.linalg.inv(self.inertia)

    @cached_property
    def _motion(self) -> Motion | None:
        """The motion in principal axes; None: it turns about one of them."""
        moments, axes = np.linalg.eigh(self.inertia)
        axes[:, 0] *= np.linalg.det(axes)
        rate = axes.T @ self.rate
        momentum = moments * rate
        size = float(np.linalg.norm(momentum))
        if np.linalg.norm(np.cross(rate, momentum)) <= _STEADY * size * np.linalg.norm(rate):
            return None
        # L^2 - 2 T I2, as a sum: below 0, L stays about the axis of the least moment.
        if float((moments - moments[1]) @ (moments * rate**2)) < 0.0:
            axes, moments, rate = -axes[:, ::-1], moments[::-1], -rate[::-1]
        a, b, c = moments.tolist()
        x, y, z = rate.tolist()
        # 2 T I3 - L^2 and L^2 - 2 T I1, over I1 and I3 and as sums that nothing cancels in.
        across, along = (
            (c - a) * x**2 + b * (c - b) / a * y**2,
            (c - a) * z**2 + b * (b - a) / c * y**2,
        )
        first, second, third = (
            math.sqrt(across / (c - a)),
            math.sqrt(across * a / (b * (c - b))),
            math.copysign(math.sqrt(along / (c - a)), z),
        )
        m = across * a * (b - a) / (along * c * (c - b)) if along else 1.0
        m = min(m, _GREATEST_PARAMETER)
        start = (
            float(scipy.special.ellipkinc(math.atan2(y / second, x / first), m))
            if first > 0.0
            else 0.0
        )
        frequency = math.copysign(math.sqrt((c - b) * along / (a * b)), (c - b) * z)
        turned = np.roll(scipy.spatial.transform.Rotation.from_matrix(axes).as_quat(), 1)
        amplitudes = np.array([first, second, third])
        return Motion(turned, np.array(moments), amplitudes, size, frequency, start, m)

    def angular_velocity(self, times: float | np.ndarray) -> np.ndarray:
        """w (..., 3) in rad/s, in K, at times (...) in s."""
        if not isinstance(times, np.ndarray):
            return self._at(times)[1]
        motion = self._motion
        if motion is None:
            return np.broadcast_to(self.rate, (*times.shape, 3))
        rates = rates_at(motion, np.ravel(times).astype(np.float64))
        return rates.reshape(*times.shape, 3) @ rotation_matrix(motion.axes).T

    def angular_acceleration(self, times: float | np.ndarray) -> np.ndarray:
        """The derivative of w (..., 3) in rad/s^2, in K, at times (...) in s: -I^-1 (w x I w)."""
        if not isinstance(times, np.ndarray):
            return self._at(times)[2]
        rates = self.angular_velocity(times)
        return -np.cross(rates, rates @ self.inertia) @ self._inverse

    # Many systems ask for the same times.
    @functools.lru_cache(maxsize=_RECENT)  # noqa: B019 (a flight has one or two models)
    def _at(self, time: float) -> tuple[Quaternion, Vector3, Vector3]:
        """R_NK, w and its derivative at a time in s."""
        motion = self._motion
        if motion is None:
            return SteadySpin(self.rate).attitude(time), _read_only(self.rate), np.zeros(3)
        turned, rate, change = turned_at(motion, float(time))
        attitude = quaternion_product(self._start, turned)
        return attitude, _read_only(np.array(rate)), _read_only(np.array(change))

    @cached_property
    def _turn(self) -> float:
        """The time in s of one turn at the rate of the start."""
        return 2.0 * math.pi / float(np.linalg.norm(self.rate))

    @cached_property
    def period(self) -> float:
        """The time in s after which w in K is the same again; inf if it stays."""
        motion = self._motion
        if motion is None:
            return math.inf
        return 4.0 * float(scipy.special.ellipk(motion.parameter)) / abs(motion.frequency)

    def attitude(self, time: float) -> Quaternion:
        """R_NK at a time in s."""
        return self._at(time)[0]

    def attitudes(self, times: Values) -> np.ndarray:
        """R_NK (N, 4) at times (N,) in s."""
        if self._motion is None:
            return np.array([self.attitude(time) for time in times.tolist()]).reshape(-1, 4)
        return attitudes_at(self._motion, self._start, times)

    @cached_property
    def _start(self) -> Quaternion:
        """R_NJ, of the axes J of which z lies along L."""
        assert self._motion is not None
        return quaternion_inverse(turned_at(self._motion, 0.0)[0])

    def errors(self, time: float, step: float) -> SpinErrors:
        """What an error of w at time 0 does over a step of s about a time."""
        rounds = abs(time + step) / self._turn
        path = self._error_path(max(0, math.ceil(math.log2(max(rounds, 1.0)))))
        before, now, after = path(time + step * np.array([-0.5, 0.0, 0.5]))
        rate, turn = now[:9].reshape(3, 3), ((after - before)[9:] / step).reshape(3, 3)
        return SpinErrors(rate, self._error_rate(self.angular_velocity(time), rate), turn)

    def _error_rate(self, w: Vector3, rate: Matrix3) -> Matrix3:
        """The derivative of the error of w, by Euler's equation."""
        momentum = cross_matrix(self.inertia @ w)
        return self._inverse @ ((momentum - cross_matrix(w) @ self.inertia) @ rate)

    @functools.lru_cache(maxsize=8)  # noqa: B019 (a flight has one or two models)
    def _error_path(self, doublings: int) -> Callable[[Values], np.ndarray]:
        """The errors of w and of the turn since time 0 (N, 18), row by row, by times (N,) in s.

        It spans two turns of K, doubled so many times.
        """
        from scipy.integrate import solve_ivp  # It takes half a second, for this alone.
        from scipy.interpolate import make_interp_spline

        def derivative(time: float, state: np.ndarray) -> np.ndarray:
            w = self.angular_velocity(time)
            rate, turn = state[:9].reshape(3, 3), state[9:].reshape(3, 3)
            change = self._error_rate(w, rate)
            return np.concatenate([change.ravel(), (rate - cross_matrix(w) @ turn).ravel()])

        turns = 2 ** (doublings + 1)
        end = turns * self._turn
        knots = np.linspace(0.0, end, _KNOTS * turns + 1)
        start = np.concatenate([np.eye(3).ravel(), np.zeros(9)])
        found = solve_ivp(
            derivative, (0.0, end), start, "DOP853", t_eval=knots,
            rtol=_TOLERANCE, atol=_TOLERANCE * end,
        )  # fmt: skip
        return make_interp_spline(knots, found.y.T, k=5)  # Each step of a flight asks for it.


SpinModel = SteadySpin | TorqueFreeSpin
Spin = float | Sequence[float] | Vector3 | SpinModel
"""What `spin_model` takes: a number in rad/s is a steady spin about z, three numbers are w."""


def spin_model(spin: Spin) -> SpinModel:
    """The model of a spin; a rate in rad/s about z, or an angular velocity (3,), is steady.

    Raises:
      InputError: it is not finite.
    """
    if isinstance(spin, SpinModel):
        return spin
    rate = np.array(spin, dtype=np.float64)
    if rate.ndim == 0:
        rate = np.array([0.0, 0.0, float(rate)])
    if rate.shape != (3,) or not np.isfinite(rate).all():
        raise InputError(f"the spin must be one or three finite numbers in rad/s, got {spin}")
    return SteadySpin(rate)


def _read_only(values: np.ndarray) -> np.ndarray:
    values.flags.writeable = False
    return values
