"""`Navigator`: the filter's pure step function; `LidarNavigation` keeps its state in the Context.

The phases, and what a frame does (docs/method/navigation.md has the whole of it)::

            a pose explains the frame                 3 contradictions, nothing acquired
    ACQUIRING ─────────────────────────► FOLLOWING ─────────────────────────────────────► LOST
        └─ none does: search on            └─ it fits: corrected; it contradicts: left out │
                                         ▲                                                 │
                                         └──── it fits the prediction, or is acquired ─────┘
"""

from __future__ import annotations

import copy
import dataclasses as dc
import math
from typing import NamedTuple

import numpy as np
import scipy  # Its parts are imported when they are used.

from proxops.systems.common import Matrix3, one_thread
from proxops.systems.navigation.acquisition import FEWEST, Acquired, acquire, outlier_share
from proxops.systems.navigation.correction import Correction, corrected
from proxops.systems.navigation.estimate import (
    ATTITUDE,
    BASE,
    POSITION,
    VELOCITY,
    Estimate,
    first_estimate,
    first_sigmas,
    sigmas,
)
from proxops.systems.navigation.expected_errors import ExpectedErrors
from proxops.systems.navigation.frame_model import FrameModel
from proxops.systems.navigation.motion import PUSH_SIZE, Motion, Push
from proxops.systems.navigation.relief import forgotten
from proxops.systems.navigation.step_records import NavigationPhase

# Tuned constants. NIS is the normalised innovation squared over the returns used; about 1.

# Least share (1) of the returns on the body that must pass the gate, else the frame is refused.
# Below a half, a wrong place can agree with the frame.
_AGREEING = 0.5
# Least number of returns for the first acquisition: fewer fit several places, and a wrong one was
# found from eight.
_FEWEST_AT_FIRST = 20
# With fewer returns than this (number) a fix may be a false match, which later frames must
# confirm.
_FEW = 60
# Such a frame is refused if its NIS is this many standard deviations above 1: beyond any chance.
_TOO_FAR_OFF = 10.0
# NIS (1) from which a frame is also tried from a fresh acquisition: as if each return were off by
# 2 sigma.
_NIS_DOUBTFUL = 4.0
# NIS (1) from which a frame is refused: each return has passed a gate of 5 sigma, so it is at most
# 25 for a right prediction.
_NIS_GATE = 25.0
# A first fix whose NIS is this many standard deviations above 1 may be a false match: search on.
_UNLIKELY = 5.0
# Frames in a row (number) without a likely fix, after which the best one is taken: then map or
# noise are worse than declared, and no place will ever be likely.
_UNEXPLAINED = 10
# What each outlier counts in the NIS of a first fix, in variances: the square of the gate, 5
# sigma.
_OUTLIER = 25.0
# Frames in a row (number) that contradict the prediction, after which it is lost: one may be bad
# luck.
_PATIENCE = 3
# Gate on the move of the pose (chi square of six degrees of freedom): by chance once in 1e10, so a
# greater one shows a kick, or a belief that is wrong.
_POSE_GATE = 60.0
# From then on, standard deviations of the beliefs about the motion, in SI units but the
# acceleration, which is over GM / size^2: generous, so that a wrong belief can be found.
_SUSPECTED = ExpectedErrors(
    attitude_deg=0.0, pole_deg=math.degrees(0.01), spin=1e-4, gravity=0.1, thrust=0.05,
    thrust_direction_deg=math.degrees(0.02), acceleration_m_s2=0.1, propellant_s_per_m=5e-4,
)  # fmt: skip
# Standard deviation of the position before a first fix, over the size of the body: far more than
# an acquisition is off by.
_REACH = 0.1
# That of the velocity, over the speed of a low orbit: likewise.
_SPEED = 3.0


class Memory(NamedTuple):
    """What the navigation keeps from step to step."""

    estimate: Estimate | None
    """At the last frame's time; None: there is none."""
    forces: np.ndarray
    """(D + 1, PUSH_SIZE) of the last periods, the oldest first: a packed `Push` each."""
    contradictions: int
    """Number of frames in a row that contradicted the prediction, or that no place explained."""
    phase: NavigationPhase
    attitude: Matrix3
    """R_KS (3, 3) with which the next acquisition starts."""


class Step(NamedTuple):
    """The result of one step."""

    now: Estimate | None
    """At the present time; None while there is none."""
    memory: Memory
    correction: Correction | None
    """What the frame did; None if it was empty or not used."""


class _Start(NamedTuple):
    """An estimate from a frame alone."""

    correction: Correction
    excess: float
    """How far the frame's disagreement is above what noise explains, in standard deviations."""


class Navigator:
    """Navigation from belief alone: the map, gravity and spin as believed, and the data sheet."""

    def __init__(
        self,
        model: FrameModel,
        motion: Motion,
        expected: ExpectedErrors,
        orbit: float,
        period: float,
        frame_delay: int,
    ):
        """Takes the models, the speed of a low orbit, and the timing.

        Args:
          model: predicts frames. motion: predicts motion.
          expected: one standard deviation of everything.
          orbit: a typical speed near the body in m/s.
          period: time in s from frame to frame. frame_delay: age of a frame in periods.
        """
        self.model, self.motion = model, motion
        self._attitude_std = math.radians(expected.attitude_deg)
        size, spin = float(model.shape.extents.max()), motion.spin.rate
        self._first_sigma = first_sigmas(
            expected, spin, model.map_error.coefficients, _REACH * size, _SPEED * orbit
        )
        gravity = orbit**2 / size
        acceleration = _SUSPECTED.acceleration_m_s2 * gravity
        suspected = dc.replace(_SUSPECTED, acceleration_m_s2=acceleration)
        self._suspected = sigmas(suspected, spin) ** 2
        self._period, self._delay = period, frame_delay

    def start(self) -> Memory:
        """The memory before the first frame."""
        forces = np.zeros((self._delay + 1, PUSH_SIZE))
        return Memory(None, forces, 0, NavigationPhase.ACQUIRING, np.eye(3))

    def with_axes(self, axes: Matrix3) -> Navigator:
        """The navigator of frames that were measured with the lidar turned by a rotation (3, 3)."""
        navigator = copy.copy(self)
        navigator.model = self.model.turned(axes)
        return navigator

    def step(
        self,
        memory: Memory,
        ranges: np.ndarray,
        push: Push,
        time: float,
        outside: float = 0.0,
    ) -> Step:
        """Uses the frame that arrives at a time.

        Args:
          memory: after the step before.
          ranges: (planes * rays,) in m, +inf for no return.
          push: what the thrusters gave over the period that ends now.
          time: now, in s.
          outside: N, a force from outside in that period: how long it acted, and whereto, is not
            known.
        """
        if memory.phase == NavigationPhase.FOLLOWING and not self.model.map_error.coefficients:
            # Matrices too small for threads.
            return self._stepped(memory, ranges, push, time, outside)
        with one_thread():
            return self._stepped(memory, ranges, push, time, outside)

    def _stepped(
        self, memory: Memory, ranges: np.ndarray, push: Push, time: float, outside: float
    ) -> Step:
        """See `step`."""
        forces = np.empty_like(memory.forces)
        forces[:-1], forces[-1] = memory.forces[1:], push.packed()
        taken = time - self._delay * self._period
        prior = None
        if memory.estimate is not None:
            begun = taken - self._period
            prior = self._predicted(memory.estimate, forces[0], begun)
            if outside > 0.0:
                prior = self._pushed(prior, outside)
        attitude = memory.attitude if prior is None else prior.rotation
        used = self._used(prior, memory, ranges, attitude)
        estimate, phase, contradictions, correction = used
        memory = Memory(estimate, forces, contradictions, phase, attitude)
        now = estimate if phase == NavigationPhase.FOLLOWING else None
        for k in range(self._delay):
            if now is not None:
                begun = taken + k * self._period
                now = self._predicted(now, forces[k + 1], begun)
        return Step(now, memory, correction)

    def _predicted(self, estimate: Estimate, row: np.ndarray, begun: float) -> Estimate:
        """The estimate after a period under a row of `Memory.forces`."""
        moved = self.motion.predicted(estimate, Push.unpacked(row), begun, self._period)
        error = self.model.map_error
        if not error.relief:
            return moved
        return forgotten(moved, estimate, BASE + error.modes, error.relief_correlation)

    def _pushed(self, prior: Estimate, force: float) -> Estimate:
        """The prior after a force in N from outside, at most a period long."""
        speed = force * self._period / self.motion.mass
        extra = np.zeros(prior.mean.size)
        extra[POSITION], extra[VELOCITY] = (speed * self._period) ** 2, speed**2
        return prior._replace(covariance=prior.covariance + np.diag(extra))

    def _used(
        self, prior: Estimate | None, memory: Memory, ranges: np.ndarray, attitude: np.ndarray
    ) -> tuple[Estimate | None, NavigationPhase, int, Correction | None]:
        """Estimate, phase, contradictions in a row, and correction after a frame."""
        contradictions = memory.contradictions
        following = memory.phase == NavigationPhase.FOLLOWING
        returned = np.count_nonzero(ranges < np.inf)
        if returned < (FEWEST if following else _FEWEST_AT_FIRST):
            return prior, memory.phase, contradictions, None
        if prior is not None:
            found = self._followed(prior, ranges)
            if found is not None:
                return found.estimate, NavigationPhase.FOLLOWING, 0, found
            contradictions += 1
            if contradictions < _PATIENCE:
                return prior, memory.phase, contradictions, None
        spent = 0.0 if prior is None else prior.spent
        found = self._acquired(ranges, attitude, spent, contradictions)
        if found is not None:
            return found.estimate, NavigationPhase.FOLLOWING, 0, found
        if prior is None:
            contradictions += 1
        lost = NavigationPhase.ACQUIRING if prior is None else NavigationPhase.LOST
        return prior, lost, contradictions, None

    def _followed(self, prior: Estimate, ranges: np.ndarray) -> Correction | None:
        """The correction of a prediction by a frame; None if the frame contradicts it."""
        found = self._compared(prior, ranges)
        if found.shift > _POSE_GATE:
            found = self._compared(self._doubted(prior, found), ranges)
        if found.used < max(FEWEST, _AGREEING * (found.used + found.rejected)):
            return None
        limit = _NIS_GATE if found.used >= _FEW else 1.0 + _TOO_FAR_OFF * _spread(found.used)
        return found if found.nis < limit else None

    def _compared(self, prior: Estimate, ranges: np.ndarray) -> Correction:
        """The correction of a prediction by a frame.

        If the place is known worse than a range, as it is in the second frame of all, false returns
        are hard to tell, and the linear update may go astray. Then returns do not fit together, and
        the frame alone says where to begin.
        """
        found = corrected(self.model, prior, ranges)
        if not found.nis > _NIS_DOUBTFUL:
            return found
        if np.trace(prior.covariance[POSITION, POSITION]) <= self.model.noise_std**2:
            return found
        pose = acquire(self.model, ranges, prior.rotation, self._attitude_std)
        if pose is None:
            return found
        again = corrected(self.model, prior, ranges, _way_to(pose, prior))
        return again if again.nis < found.nis else found

    def _doubted(self, prior: Estimate, found: Correction) -> Estimate:
        """The prior with a covariance that allows for the motion that a frame showed."""
        moved = found.estimate.mean[POSITION] - prior.mean[POSITION]
        turned = _turn(prior.rotation, found.estimate.rotation)
        least = np.zeros(prior.mean.size)
        least[:BASE] = self._suspected
        least[POSITION] = moved @ moved
        least[VELOCITY] = moved @ moved / self._period**2
        least[ATTITUDE] = turned @ turned
        extra = np.maximum(least - np.diag(prior.covariance), 0.0)
        return prior._replace(covariance=prior.covariance + np.diag(extra))

    def _acquired(
        self, ranges: np.ndarray, attitude: np.ndarray, spent: float, tried: int
    ) -> Correction | None:
        """The estimate from a frame alone; None if no place explains it.

        Args:
          ranges: the frame. attitude: R_KS (3, 3) as known.
          spent: velocity change so far in m/s. tried: frames in a row that nothing explained.
        """
        std, best = self._attitude_std, None
        for search in (0, 1 + tried):
            pose = acquire(self.model, ranges, attitude, std, search)
            found = None if pose is None else self._from(pose, ranges, attitude, spent)
            if found is not None and (best is None or found.excess < best.excess):
                best = found
            if best is not None and best.excess <= _UNLIKELY:
                return best.correction
        return best.correction if best is not None and tried >= _UNEXPLAINED else None

    def _from(
        self, pose: Acquired, ranges: np.ndarray, attitude: np.ndarray, spent: float
    ) -> _Start | None:
        """The estimate from a frame and the pose that explains it."""
        prior = first_estimate(pose.position, attitude, self._first_sigma, spent)
        found = corrected(self.model, prior, ranges, _way_to(pose, prior))
        if found.used < FEWEST:
            return None
        now = found.estimate
        outliers = outlier_share(self.model, now.mean[POSITION], now.rotation, ranges)
        above = found.nis + _OUTLIER * outliers - 1.0
        return _Start(found, above / _spread(found.used))


def _spread(returns: int) -> float:
    """The standard deviation of a chi-square variable over its degrees of freedom."""
    return math.sqrt(2.0 / returns)


def _way_to(pose: Acquired, prior: Estimate) -> np.ndarray:
    """What the prior's mean (n,) is to be moved by so that it is at the pose."""
    way = np.zeros(prior.mean.size)
    way[POSITION] = pose.position - prior.mean[POSITION]
    way[ATTITUDE] = _turn(prior.rotation, pose.rotation)
    return way


def _turn(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """The rotation vector (3,) in K from one attitude R_KS (3, 3) to another."""
    return scipy.spatial.transform.Rotation.from_matrix(after @ before.T).as_rotvec()
