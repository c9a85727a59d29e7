"""`HybridController`: the MPC, a policy and the selector between them, wired as one controller."""

from __future__ import annotations

import dataclasses as dc

from pydrake.systems.framework import Diagram, DiagramBuilder, System

from proxops.diagrams.flight.scenario_systems import make_mpc, make_zero
from proxops.diagrams.flight.wiring import STATE_NOISE_STREAM
from proxops.diagrams.scenario import Body, Scenario, uncertainty_set
from proxops.systems import (
    CheckSchedule,
    EnabledValue,
    HybridSelector,
    InputError,
    ModelPredictiveController,
    PeriodRule,
    ReachModel,
    StateNoise,
)
from proxops.systems.common import LoggedPort, check_port_size, derived_seed, force_port, offers_of

# The selector assumes that the true state is within this many standard deviations of the noisy
# state. For normal errors in three dimensions this fails 15 times in a million.
_DEVIATIONS = 5.0
# The hybrid's own output ports; a log has a column for each but the first.
_OWN_OUTPUTS = (
    "force", "decision", "decision_record", "mpc_force", "mpc_record", "policy_force",
)  # fmt: skip


def make_hybrid(scenario: Scenario, body: Body, policy: System) -> HybridController:
    """Makes the hybrid that the scenario configures, from its MPC and a policy.

    Its adaptive schedule allows for the errors that runtime assurance declares.

    Raises:
      InputError: see `HybridController` and `uncertainty_set`.
    """
    settings, craft, transit = scenario.hybrid, scenario.spacecraft, scenario.transit
    period = scenario.control_period_s
    position_std = settings.state_noise_position_m
    velocity_std = settings.state_noise_velocity_m_s
    # Without runtime assurance nothing errs.
    bounds = uncertainty_set(scenario, body)
    assurance, acceleration = scenario.assurance, craft.thrust_limit_n / craft.mass_kg
    selector = HybridSelector(
        settings.agreement_gate(),
        CheckSchedule(
            PeriodRule(settings.period_rule),
            settings.check_period,
            settings.longest_period,
        ),
        ReachModel.of(
            body.gravity_field,
            body.keep_out_semi_axes,
            spin=body.spin_about_z,
            acceleration=(bounds.strongest + bounds.across) * acceleration,
            weakest=max(bounds.weakest - bounds.across, 0.0) * acceleration,
            gravity=bounds.gravity,
            other=bounds.acceleration_m_s2,
        ),
        period=period,
        # Semi-axes that are longer by a length move the ellipsoid's surface by at most this length.
        position_error=_DEVIATIONS * position_std + bounds.position_m + bounds.surface_m,
        velocity_error=_DEVIATIONS * velocity_std + bounds.velocity_m_s,
        deviations=0.0 if assurance is None else assurance.deviations,
    )
    seed = derived_seed(scenario.noise_seed, transit.seed, transit.index, STATE_NOISE_STREAM)
    noise = StateNoise(position_std, velocity_std, period, seed)
    return HybridController(make_mpc(scenario, body), policy, selector, noise)


def zero_hybrid(scenario: Scenario, body: Body) -> HybridController:
    """Makes the hybrid with a policy that always commands zero.

    It measures the share that a policy gets without having learned anything. Its name for
    `proxops fly` is `proxops.diagrams.flight.hybrid_controller:zero_hybrid`.
    """
    return make_hybrid(scenario, body, make_zero())


class HybridController(Diagram):
    """Flies a policy, and checks its force against the MPC's from time to time.

    ```
    state ──► StateNoise ─┬─► MPC ─── mpc_force ───►┌────────────────┐
    target ───────────────│─► ▲ ▲ └ planned_force ─►│                ├─► force (3), N
                          │   │ └── mpc_wanted ─────┤ HybridSelector ├─► decision (1)
                          └───│────────────────────►│                ├─► decision_record (7)
    ranges, target, ─────► policy ── policy_force ─►└────────────────┘
    commanded_force                           ▲
    covariance ───────────────────────────────┘
    ```

    More outputs come from the parts. `mpc_force` (3) and `mpc_record` (3) are the MPC's; at a step
    at which the MPC is not asked they are NaN, and evaluating them does not make the MPC solve.
    `policy_force` (3), `policy_record` (2) and `estimate` (6) are the policy's; a policy of one's
    own may offer other ports to the log, which then are outputs too. The MPC and the selector get
    the state with noise; the policy gets what its ports name, a state without this noise.
    """

    def __init__(
        self,
        expert: ModelPredictiveController,
        policy: System,
        selector: HybridSelector,
        noise: StateNoise,
    ):
        """Wires the parts.

        Args:
          expert: the MPC that checks.
          policy: a learned policy, or any system with an output port `force` (3). If it has
            `logged_ports`, these are outputs of the hybrid, but for those whose names the hybrid
            has itself.
          selector: decides at each step which force acts.
          noise: is added to the state that the MPC and the selector get.

        Raises:
          InputError: the MPC has a delay. It predicts over the delay with its own last command,
            but in a hybrid the policy's command may act. Or the policy has a delay, which the
            MPC's command has not, or its ports do not fit.
        """
        super().__init__()
        offers, force = offers_of(policy), force_port(policy)
        _check_delays(expert, policy, offers.delay)
        self.bundle = offers.bundle
        builder = DiagramBuilder()
        builder.AddNamedSystem("mpc", expert)
        builder.AddNamedSystem("policy", policy)
        builder.AddNamedSystem("selector", selector)
        builder.AddNamedSystem("noise", noise)
        inputs: dict[str, int] = {}

        def take(port) -> None:
            name = port.get_name()
            if name in inputs:
                check_port_size(policy, port, inputs[name])
                builder.ConnectInput(name, port)
            else:
                builder.ExportInput(port, name)
                inputs[name] = port.size()

        for port in (noise.GetInputPort("state"), expert.GetInputPort("target")):
            take(port)
        for i in range(policy.num_input_ports()):
            take(policy.get_input_port(i))
        take(selector.GetInputPort("covariance"))
        known = noise.GetOutputPort("state")
        wanted = selector.GetOutputPort("mpc_wanted")
        builder.Connect(known, expert.GetInputPort("state"))
        builder.Connect(known, selector.GetInputPort("state"))
        builder.Connect(wanted, expert.GetInputPort("enable"))
        builder.Connect(expert.GetOutputPort("force"), selector.GetInputPort("mpc_force"))
        planned = expert.GetOutputPort("planned_force")
        builder.Connect(planned, selector.GetInputPort("planned_force"))
        builder.Connect(force, selector.GetInputPort("policy_force"))
        builder.ExportOutput(selector.GetOutputPort("force"), "force")
        builder.ExportOutput(selector.GetOutputPort("decision"), "decision")
        builder.ExportOutput(selector.GetOutputPort("record"), "decision_record")
        for name in ("force", "record"):
            asked = builder.AddNamedSystem(f"asked_{name}", EnabledValue(3))
            builder.Connect(wanted, asked.GetInputPort("enable"))
            builder.Connect(expert.GetOutputPort(name), asked.GetInputPort("value"))
            builder.ExportOutput(asked.GetOutputPort("value"), f"mpc_{name}")
        builder.ExportOutput(force, "policy_force")
        self._offered = {
            name: each for name, each in offers.logged_ports.items() if name not in _OWN_OUTPUTS
        }
        for name, logged in self._offered.items():
            builder.ExportOutput(logged.port, name)
        builder.BuildInto(self)

    def logged_ports(self) -> dict[str, LoggedPort]:
        """Gives the ports that a log records, by the names of their columns."""
        ports = {name: LoggedPort(self.GetOutputPort(name)) for name in _OWN_OUTPUTS[1:]}
        for name, logged in self._offered.items():
            ports[name] = dc.replace(logged, port=self.GetOutputPort(name))
        return ports


def _check_delays(expert: ModelPredictiveController, policy: System, delay: float) -> None:
    """Raises `InputError` if the MPC's command or the policy's, by its delay in s, acts late."""
    if expert.delay > 0.0:
        raise InputError(
            "the hybrid cannot fly with mpc.solve_delay_s: the MPC predicts over the delay "
            "with its own last command, but the policy's command may act"
        )
    if delay > 0.0:
        raise InputError(
            f"the hybrid cannot fly {policy.get_name()!r} with a delay of {delay:g} s: the MPC's "
            "command has none"
        )
