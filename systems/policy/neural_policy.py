"""`NeuralPolicy`: a learned controller that sees lidar frames, the goal and its own force."""

from __future__ import annotations

import time
from enum import IntEnum
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import LeafSystem, ValueProducer

from proxops.systems.common import InputError
from proxops.systems.lidar import DEFAULT_GEOMETRY, LidarGeometry
from proxops.systems.policy.policy_bundle import PolicyBundle, run_network


class PolicyStatus(IntEnum):
    """What the policy's command is."""

    ANSWERED = 0
    NOT_FINITE = 1
    """The network's answer was not finite, or it gave none: no force is commanded, and its memory
    starts anew."""


class PolicyAnswer(NamedTuple):
    """All that a policy gives at one step."""

    force: np.ndarray
    """(3,) in N in K, within the thrust limit."""
    estimate: np.ndarray
    """(6,) position and velocity in K in m and m/s; NaN if there is none."""
    memory: np.ndarray
    """For the next step."""
    status: PolicyStatus
    wall_time: float
    """In s, of the network."""


class NeuralPolicy(LeafSystem):
    """Flies a policy from its bundle: one run of its network a step, on one thread.

    ```
    ranges (planes * rays) ──►┌──────────────┐
    target (6) ──────────────►│ NeuralPolicy ├─► force (3), N
    applied_force (3) ───────►│              ├─► estimate (6): position and velocity, NaN if none
                              └──────────────┴─► record (2): wall time in s, PolicyStatus
    ```

    Ranges are in m, +inf where nothing returned; the other vectors are in K, in m, m/s and N.
    `applied_force` is what acted over the last period, as the thrusters' hold gives it.

    What the policy remembers is discrete state in the Context, zeros at first, replaced every
    `period`. The command is clipped to the thrust limit. A policy must not end a flight: if its
    force or memory is not finite, it commands no force, and remembers nothing at the next step.
    """

    def __init__(
        self,
        bundle: PolicyBundle | str | Path,
        thrust_limit: float | None = None,
        period: float = 10.0,
        geometry: LidarGeometry = DEFAULT_GEOMETRY,
        *,
        shape_sha256: str | None = None,
    ):
        """Takes a bundle that `proxops train` made, and what it is to be flown with.

        Args:
          thrust_limit: greatest force per axis in N; None: that which the policy learned from.
          period: control period in s.
          geometry: planes and rays of the lidar.
          shape_sha256: of the body flown at; None: whatever body the bundle was trained at.

        Raises:
          InputError: the limit is not positive; no bundle, a damaged one, or one for another
            period, other planes and rays or another body.
        """
        super().__init__()
        self.bundle = bundle if isinstance(bundle, PolicyBundle) else PolicyBundle.load(bundle)
        self.thrust_limit = self.bundle.thrust_limit if thrust_limit is None else thrust_limit
        self.period = period
        if not self.thrust_limit > 0.0:
            raise InputError(f"a policy needs a positive thrust limit, got {thrust_limit}")
        _check_fit(self.bundle, period, geometry, shape_sha256)
        self._ranges_port = self.DeclareVectorInputPort(name="ranges", size=geometry.size)
        self._target_port = self.DeclareVectorInputPort(name="target", size=6)
        self._applied_port = self.DeclareVectorInputPort(name="applied_force", size=3)
        self._memory = self.DeclareDiscreteState(self.bundle.memory)
        nothing = PolicyAnswer(
            np.zeros(3), np.full(6, np.nan), np.zeros(self.bundle.memory),
            PolicyStatus.NOT_FINITE, 0.0,
        )  # fmt: skip
        # One entry for all that the network gives, so that outputs and update share one run.
        self._answer = self.DeclareCacheEntry(
            "answer",
            ValueProducer(allocate=lambda: AbstractValue.Make(nothing), calc=self._calc_answer),
            {
                self._ranges_port.ticket(),
                self._target_port.ticket(),
                self._applied_port.ticket(),
                self.xd_ticket(),
            },
        )
        depends = {self._answer.ticket()}
        self._force_port = self.DeclareVectorOutputPort(
            name="force", size=3, calc=self._calc_force, prerequisites_of_calc=depends
        )
        self._estimate_port = self.DeclareVectorOutputPort(
            name="estimate", size=6, calc=self._calc_estimate, prerequisites_of_calc=depends
        )
        self._record_port = self.DeclareVectorOutputPort(
            name="record", size=2, calc=self._calc_record, prerequisites_of_calc=depends
        )
        # Discrete, not unrestricted: at one time all discrete updates see the same state before
        # it, so that the hold downstream reads the answer that is cached.
        self.DeclarePeriodicDiscreteUpdateEvent(
            period_sec=period, offset_sec=0.0, update=self._remember
        )

    def _calc_answer(self, context, value):
        ranges = self._ranges_port.Eval(context)
        target = self._target_port.Eval(context)
        applied_force = self._applied_port.Eval(context)
        memory = context.get_discrete_state(self._memory).value()
        value.set_value(
            policy_answer(self.bundle, ranges, target, applied_force, memory, self.thrust_limit)
        )

    def _calc_force(self, context, output):
        output.SetFromVector(self._answer.Eval(context).force)

    def _calc_estimate(self, context, output):
        output.SetFromVector(self._answer.Eval(context).estimate)

    def _calc_record(self, context, output):
        answer = self._answer.Eval(context)
        output.SetFromVector([answer.wall_time, answer.status])

    def _remember(self, context, discrete_state):
        discrete_state.set_value(self._memory, self._answer.Eval(context).memory)


def policy_answer(
    bundle: PolicyBundle,
    ranges: np.ndarray,
    target: np.ndarray,
    applied_force: np.ndarray,
    memory: np.ndarray,
    thrust_limit: float,
) -> PolicyAnswer:
    """What a policy says at one step, within limits; nothing if what it says isn't finite.

    Args:
      ranges: (planes * rays) in m, +inf where nothing returned. target: (6,) in m and m/s.
      applied_force: (3,) in N over the last period. memory: of its last answer, at first zeros.
      thrust_limit: greatest force per axis in N.
    """
    started = time.perf_counter()
    try:
        answer = run_network(bundle.session, ranges, target, applied_force, memory)
    except Exception:  # Of no common type; for instance an index that was made of NaN.
        answer = np.full(3, np.nan), np.full(6, np.nan), memory
    wall_time = time.perf_counter() - started
    force, estimate, memory = answer
    status = PolicyStatus.ANSWERED
    if not (np.isfinite(force).all() and np.isfinite(memory).all()):
        force, estimate = np.zeros(3), np.full(6, np.nan)
        memory, status = np.zeros(bundle.memory), PolicyStatus.NOT_FINITE
    force = np.clip(force.astype(float), -thrust_limit, thrust_limit)
    return PolicyAnswer(force, estimate, memory, status, wall_time)


def _check_fit(
    bundle: PolicyBundle, period: float, geometry: LidarGeometry, shape_sha256: str | None
) -> None:
    """Raises `InputError` if a policy was trained for something else, with what it was."""
    trained = (bundle.planes, bundle.rays)
    if trained != (geometry.planes, geometry.rays):
        raise InputError(
            f"{bundle.path} is for a lidar of {trained[0]} planes of {trained[1]} rays, and this "
            f"one has {geometry.planes} of {geometry.rays}: train a policy for these"
        )
    if bundle.period != period:
        raise InputError(
            f"{bundle.path} is for a control period of {bundle.period:g} s, and this one is "
            f"{period:g} s: train a policy for it"
        )
    if shape_sha256 is not None and shape_sha256 != bundle.shape_sha256:
        raise InputError(
            f"{bundle.path} was trained at {bundle.body or 'a body'}, of another shape than this "
            "body: train a policy at this one"
        )
