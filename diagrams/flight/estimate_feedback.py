"""`EstimateFeedback`: flies the MPC or the PD controller on the state that a policy estimates."""

from __future__ import annotations

from pydrake.systems.framework import Diagram, DiagramBuilder, PortDataType

from proxops.systems.common import InputError, LegendEntry, LoggedPort, offers_of
from proxops.systems.expert import ModelPredictiveController
from proxops.systems.policy import GuidancePolicy, NeuralPolicy, ProportionalDerivative


class EstimateFeedback(Diagram):
    """Flies a controller on the state that a policy estimates; the policy's force is not used.

    ```
    ranges ──────────►┌──────────────┐ estimate ┌────────────┐
    commanded_force ─►│ NeuralPolicy ├────┬────►│ controller ├─► force (3), N
    target ────┬─────►│              ├─┐  │ ┌──►│            ├─► other outputs of the controller
               │      └──────────────┘ │  │ │   └────────────┘
               └───────────────────────│──│─┘
                                       │  └──► estimate (6)
                                       └─────► policy_record (2)
    ```

    It shows how much of a policy's success comes from its navigation and how much from its
    guidance. At a step without an estimate the state is NaN, and the controller must cope with it.
    """

    def __init__(
        self,
        policy: NeuralPolicy | GuidancePolicy,
        controller: ProportionalDerivative | ModelPredictiveController,
    ):
        """Wires the policy to the controller.

        Raises:
          InputError: the policy makes no estimate.
        """
        super().__init__()
        if isinstance(policy, GuidancePolicy) or not policy.bundle.estimates:
            raise InputError(
                f"{policy.bundle.path} makes no estimate of the state, but the controller needs "
                "one: fly it as a policy"
            )
        self.bundle = policy.bundle
        offers = offers_of(controller)
        self.delay = offers.delay
        own = offers.legend_entry
        self.legend_entry = own and LegendEntry(f"{own.name} on the estimate", own.colour)
        builder = DiagramBuilder()
        builder.AddNamedSystem("policy", policy)
        builder.AddNamedSystem("controller", controller)
        builder.Connect(policy.GetOutputPort("estimate"), controller.GetInputPort("state"))
        for name in ("ranges", "target", "commanded_force"):
            builder.ExportInput(policy.GetInputPort(name), name)
        builder.ConnectInput("target", controller.GetInputPort("target"))
        builder.ExportOutput(controller.GetOutputPort("force"), "force")
        logged = policy.logged_ports()
        self._logged = ["estimate", "policy_record"]
        for name in self._logged:
            builder.ExportOutput(logged[name].port, name)
        for i in range(controller.num_output_ports()):
            port = controller.get_output_port(i)
            if port.get_data_type() == PortDataType.kAbstractValued:
                builder.ExportOutput(port, port.get_name())
        for name, each in offers.logged_ports.items():
            builder.ExportOutput(each.port, name)
            self._logged.append(name)
        builder.BuildInto(self)

    def logged_ports(self) -> dict[str, LoggedPort]:
        """Gives the ports that a log records, by the names of their columns."""
        return {name: LoggedPort(self.GetOutputPort(name)) for name in self._logged}
