"""`NeuralPolicy`: a learned controller, from lidar frames, goal and last force to force."""

from __future__ import annotations

import time
from enum import IntEnum
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import LeafSystem, ValueProducer

from proxops.systems.common import (
    InputError,
    LegendEntry,
    LoggedPort,
    State,
    Vector3,
    check_positive,
)
from proxops.systems.lidar import DEFAULT_GEOMETRY, LidarGeometry
from proxops.systems.policy.policy_bundle import PolicyBundle, run_network


class PolicyStatus(IntEnum):
    """Whether the policy gave a command."""

    ANSWERED = 0
    NOT_FINITE = 1
    """The force or the memory was not finite: the command is zero and the memory is reset."""


class PolicyAnswer(NamedTuple):
    """The result of one step of a policy."""

    force: Vector3
    """(3,) in N in K, within the thrust limit."""
    estimate: State
    """(6,) position and velocity in K in m and m/s; NaN if there is none."""
    memory: np.ndarray
    """Input of the next step."""
    status: PolicyStatus
    wall_time: float
    """Time in s that the network took."""


class NeuralPolicy(LeafSystem):
    """Runs the network of a policy's bundle once a control step, on one thread.

    ```
    ranges (planes * rays) ──►┌──────────────┐
    target (6) ──────────────►│ NeuralPolicy ├─► force (3), N
    commanded_force (3) ─────►│              ├─► estimate (6): position and velocity, NaN if none
                              └──────────────┴─► record (2): wall time in s, PolicyStatus
    ```

    Ranges are in m, +inf where nothing returned. Target, force and estimate are in K, in m, m/s and
    N. `commanded_force` is the command along the spacecraft's axes S that was held over the last
    period, after runtime assurance and the thrust limit. What truly acted may differ, and the
    policy is not told.

    The network's memory is discrete state in the Context. It is zero at first and is replaced every
    `period`. The command is clipped to the thrust limit. A policy must not end a flight: if its
    force or memory is not finite, it commands no force, and its memory at the next step is zero.
    """

    legend_entry = LegendEntry("policy", (0.96, 0.55, 0.13))

    def __init__(
        self,
        bundle: PolicyBundle | str | Path,
        thrust_limit: float | None = None,
        period: float = 10.0,
        geometry: LidarGeometry = DEFAULT_GEOMETRY,
        *,
        shape_sha256: str | None = None,
    ):
        """Takes a bundle that `proxops train` made, and the conditions of the flight.

        Args:
          bundle: the bundle or its folder.
          thrust_limit: greatest force per axis in N; None: the limit of the policy's training data.
          period: control period in s.
          geometry: planes and rays of the lidar.
          shape_sha256: hash of the shape of the body flown at; None: the body of the bundle.

        Raises:
          InputError: the limit is not positive; there is no bundle, it is damaged, or it was
            trained for another period, other planes and rays or another body.
        """
        super().__init__()
        self.bundle = bundle if isinstance(bundle, PolicyBundle) else PolicyBundle.load(bundle)
        self.thrust_limit = self.bundle.thrust_limit if thrust_limit is None else thrust_limit
        self.period = period
        check_positive("NeuralPolicy", thrust_limit=self.thrust_limit)
        _check_fit(self.bundle, period, geometry, shape_sha256)
        self._ranges_port = self.DeclareVectorInputPort("ranges", geometry.size)
        self._target_port = self.DeclareVectorInputPort("target", 6)
        self._commanded_port = self.DeclareVectorInputPort("commanded_force", 3)
        self._memory = self.DeclareDiscreteState(self.bundle.memory)
        nothing = PolicyAnswer(
            np.zeros(3), np.full(6, np.nan), np.zeros(self.bundle.memory),
            PolicyStatus.NOT_FINITE, 0.0,
        )  # fmt: skip
        # One cache entry holds the network's whole result, so that the outputs and the update share
        # one run.
        self._answer = self.DeclareCacheEntry(
            "answer",
            ValueProducer(allocate=lambda: AbstractValue.Make(nothing), calc=self._calc_answer),
            {self.all_input_ports_ticket(), self.xd_ticket()},
        )
        depends = {self._answer.ticket()}
        self._force_port = self.DeclareVectorOutputPort("force", 3, self._calc_force, depends)
        self._estimate_port = self.DeclareVectorOutputPort(
            "estimate", 6, self._calc_estimate, depends
        )
        self._record_port = self.DeclareVectorOutputPort("record", 2, self._calc_record, depends)
        # The update is discrete, not unrestricted: all discrete updates at one time see the state
        # before it, so that the hold downstream reads the cached result.
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._remember)

    def logged_ports(self) -> dict[str, LoggedPort]:
        """The ports whose values a log keeps, by the names of their columns."""
        ports = {"policy_force": self._force_port, "policy_record": self._record_port}
        if self.bundle.estimates:
            ports["estimate"] = self._estimate_port
        return {name: LoggedPort(port) for name, port in ports.items()}

    def _calc_answer(self, context, value):
        ranges = self._ranges_port.Eval(context)
        target = self._target_port.Eval(context)
        commanded_force = self._commanded_port.Eval(context)
        memory = context.get_discrete_state(self._memory).value()
        value.set_value(
            policy_answer(self.bundle, ranges, target, commanded_force, memory, self.thrust_limit)
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
    target: State,
    commanded_force: Vector3,
    memory: np.ndarray,
    thrust_limit: float,
) -> PolicyAnswer:
    """Runs a policy's network for one step and limits its force.

    Args:
      ranges: (planes * rays) in m, +inf where nothing returned. target: (6,) in m and m/s.
      commanded_force: (3,) in N, held over the last period.
      memory: of the last answer, at first zeros.
      thrust_limit: greatest force per axis in N.

    Raises:
      RuntimeError: ONNX Runtime fails for another reason than an index out of range.
    """
    started = time.perf_counter()
    try:
        answer = run_network(bundle.session, ranges, target, commanded_force, memory)
    except Exception as error:  # ONNX Runtime's exceptions have no common type.
        if not _is_index_out_of_range(error):
            raise RuntimeError(f"the network of {bundle.path} failed: {error}") from error
        answer = np.full(3, np.nan), np.full(6, np.nan), memory
    wall_time = time.perf_counter() - started
    force, estimate, memory = answer
    status = PolicyStatus.ANSWERED
    if not (np.isfinite(force).all() and np.isfinite(memory).all()):
        force, estimate = np.zeros(3), np.full(6, np.nan)
        memory, status = np.zeros(bundle.memory), PolicyStatus.NOT_FINITE
    force = np.clip(force.astype(float), -thrust_limit, thrust_limit)
    return PolicyAnswer(force, estimate, memory, status, wall_time)


def _is_index_out_of_range(error: Exception) -> bool:
    """Whether ONNX Runtime refused an index that the network computed.

    The bundle's inputs and outputs were checked when it was loaded, so such an index comes from a
    value that is not finite: NaN becomes an arbitrary integer. The error is `InvalidArgument`, as
    for inputs of a wrong shape, but a node raises it while the network runs.
    """
    from onnxruntime.capi.onnxruntime_pybind11_state import InvalidArgument  # Slow to import.

    return isinstance(error, InvalidArgument) and "while running" in str(error)


def _check_fit(
    bundle: PolicyBundle, period: float, geometry: LidarGeometry, shape_sha256: str | None
) -> None:
    """Raises `InputError`, with the reason, if a policy was trained for other conditions."""
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
