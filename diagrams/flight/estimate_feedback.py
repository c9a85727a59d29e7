"""`EstimateFeedback`: the PD controller on the state that a policy estimates, as a baseline."""

from __future__ import annotations

from pydrake.systems.framework import Diagram, DiagramBuilder

from proxops.systems.common import InputError
from proxops.systems.policy import NeuralPolicy, ProportionalDerivative


class EstimateFeedback(Diagram):
    """PD control of the state that a policy estimates from its lidar; the policy's force is unused.

    ```
    ranges ────────►┌──────────────┐ estimate ┌────────────────────────┐
    applied_force ─►│ NeuralPolicy ├────┬────►│ ProportionalDerivative ├─► force (3), N
    target ──┬─────►│              ├─┐  │ ┌──►│                        │
             │      └──────────────┘ │  │ │   └────────────────────────┘
             └───────────────────────│──│─┘
                                     │  └──► estimate (6)
                                     └─────► record (2), of the policy
    ```

    Ports are those of the two systems. What it shows is how much of a policy's success is in
    knowing where it is, and how much in what it does there.
    """

    def __init__(self, policy: NeuralPolicy, controller: ProportionalDerivative):
        """Takes the two systems.

        Raises:
          InputError: the policy makes no estimate.
        """
        super().__init__()
        if not policy.bundle.estimates:
            raise InputError(
                f"{policy.bundle.path} makes no estimate of its state, which the PD controller "
                "would need: fly it as a policy"
            )
        self.bundle = policy.bundle
        builder = DiagramBuilder()
        builder.AddNamedSystem("policy", policy)
        builder.AddNamedSystem("proportional_derivative", controller)
        builder.Connect(policy.GetOutputPort("estimate"), controller.GetInputPort("state"))
        for name in ("ranges", "target", "applied_force"):
            builder.ExportInput(policy.GetInputPort(name), name)
        builder.ConnectInput("target", controller.GetInputPort("target"))
        builder.ExportOutput(controller.GetOutputPort("force"), "force")
        for name in ("estimate", "record"):
            builder.ExportOutput(policy.GetOutputPort(name), name)
        builder.BuildInto(self)
