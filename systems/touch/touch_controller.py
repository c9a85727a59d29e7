"""`TouchController`: the mission of a touch-and-go as a system; its memory is in the Context."""

from __future__ import annotations

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import LeafSystem, ValueProducer

from proxops.systems.common import LoggedPort
from proxops.systems.touch.descent import TouchPhase
from proxops.systems.touch.mission import AbortReason, Memory, Mission, Seen


class TouchController(LeafSystem):
    """Flies a touch-and-go from home to the ground and back, if need be after a transit to home.

    ```
    state (6), m and m/s, K; NaN ─►┌─────────────────┐─► force (3), N, K
    covariance (81) ──────────────►│                 │─► target (6), m and m/s, K
    ranges, m; +inf ──────────────►│ TouchController │─► record (5)
    head_force (1), N ────────────►│                 │
    failed (n) ───────────────────►│                 │
    transit_force (3), N, K ──────►└─────────────────┘─► in_transit (1)
    ```

    `target` is where the phase leads; `record` has `TouchPhase`, the `AbortReason` of the last
    abort, the descents begun, the height in m at which an abort comes to rest, and 1 if a learned
    policy gave the force. `covariance` and `failed` (1: this thruster was found to have failed) may
    remain open. Outputs are those of a step at whole multiples of the period. What it remembers is
    discrete state.

    With a transit there are `transit_force`, of the controller that flies it, and `in_transit`: 1
    up to the step at which home is reached. It depends on the memory alone, so that it may enable
    that controller.
    """

    def __init__(self, mission: Mission, rays: int, thrusters: int = 0, transit: bool = False):
        """Takes the mission and the sizes of its ports.

        Args:
          mission: decides. rays: of the lidar. thrusters: 0: none can be known to have failed.
          transit: whether a transit to home comes first.
        """
        super().__init__()
        self.mission = mission
        phase = TouchPhase.TRANSIT if transit else TouchPhase.HOME
        declare = self.DeclareVectorInputPort
        self._state_port, self._ranges_port = declare("state", 6), declare("ranges", rays)
        self._covariance_port = declare("covariance", 81)
        self._head_port = declare("head_force", 1)
        self._failed_port = declare("failed", thrusters) if thrusters else None
        known = {
            self.get_input_port(i).ticket() for i in range(self.num_input_ports())
        }  # All but the transit's force, which asks for what the step says.
        self._transit_port = declare("transit_force", 3) if transit else None
        self._memory = self.DeclareDiscreteState(_packed(Memory(phase)))
        self._step = self.DeclareCacheEntry(
            "step",
            ValueProducer(allocate=lambda: AbstractValue.Make(object()), calc=self._calc_step),
            known | {self.xd_ticket(), self.time_ticket()},
        )
        depends = {self._step.ticket()}
        output = self.DeclareVectorOutputPort
        if self._transit_port is None:
            output("force", 3, self._calc_force, depends)
        else:
            output("force", 3, self._calc_force, depends | {self._transit_port.ticket()})
            output("in_transit", 1, self._calc_in_transit, {self.xd_ticket()})
        self._target = output(
            "target", 6, lambda c, out: out.SetFromVector(self._step.Eval(c).target), depends
        )
        self._record = output("record", 5, self._calc_record, depends)
        self.DeclarePeriodicDiscreteUpdateEvent(mission.period, 0.0, self._remember)

    def logged_ports(self) -> dict[str, LoggedPort]:
        """The ports whose values a log keeps, by the names of their columns or records."""
        return {"touch_record": LoggedPort(self._record)}

    def _calc_step(self, context, value):
        memory = _unpacked(context.get_discrete_state(self._memory).value())
        covariance = None
        if self._covariance_port.HasValue(context):
            covariance = self._covariance_port.Eval(context).reshape(9, 9)[:6, :6]
            covariance = covariance if np.isfinite(covariance).all() else None
        port, failed = self._failed_port, False
        if port is not None and port.HasValue(context):
            failed = bool(port.Eval(context).any())
        seen = Seen(
            context.get_time(),
            self._state_port.Eval(context),
            covariance,
            bool(np.isfinite(self._ranges_port.Eval(context)).any()),
            float(self._head_port.Eval(context)[0]),
            failed,
        )
        value.set_value(self.mission.step(memory, seen))

    def _calc_force(self, context, output):
        step = self._step.Eval(context)
        force, port = step.force, self._transit_port
        if port is not None and step.memory.phase is TouchPhase.TRANSIT:
            force = port.Eval(context)
        output.SetFromVector(force)

    def _calc_in_transit(self, context, output):
        memory = _unpacked(context.get_discrete_state(self._memory).value())
        output.SetFromVector([memory.phase is TouchPhase.TRANSIT])

    def _calc_record(self, context, output):
        step = self._step.Eval(context)
        memory = step.memory
        output.SetFromVector(
            [memory.phase, memory.reason, memory.tries, step.stopping, step.by_policy]
        )

    def _remember(self, context, discrete_state):
        discrete_state.set_value(self._memory, _packed(self._step.Eval(context).memory))


def _packed(memory: Memory) -> np.ndarray:
    """A memory as a vector (15,), so that Drake's discrete state can hold it."""
    values = memory._asdict()
    state = values.pop("state")
    return np.array([*map(float, values.values()), *state])


def _unpacked(vector: np.ndarray) -> Memory:
    """The memory in a vector (15,)."""
    phase, reason, tries, touched, begun, frame, known, since, agreed = vector[:9].tolist()
    return Memory(
        TouchPhase(int(phase)), AbortReason(int(reason)), int(tries), bool(touched), begun, frame,
        bool(known), vector[9:].copy(), since, bool(agreed),
    )  # fmt: skip
