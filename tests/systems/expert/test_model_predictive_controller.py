"""The expert as a system: what its command depends on, failures, the Context, solves counted."""

from functools import cache

import numpy as np
import pytest
from counting_program import CountingProgram, counting_expert
from one_system import context_of
from pydrake.solvers import SolutionResult
from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, LogVectorOutput, ZeroOrderHold

from proxops.diagrams.flight.scenario_systems import make_mpc
from proxops.diagrams.scenario import Scenario, load_body
from proxops.systems import (
    DelayedHold,
    InputError,
    ModelPredictiveController,
    Plan,
    PlanReason,
    PlanStatus,
    PolyhedralGravity,
    Spacecraft,
)
from proxops.systems.common.errors import SolverFailure
from proxops.systems.shapes.ellipsoid import blocks_segment, clearances, closest_point

SOLVED, CONTINUED, BRAKING = PlanStatus
PERIOD = 10.0
COLD = 10  # Linearisations without a recent plan.
MASS, THRUST = 100.0, 7.0
PLANNED_KEEP_OUT = np.array([143e3, 73e3, 68e3])
START = np.array([60e3, 110e3, -20e3, 0.0, 0.0, 0.0])
TARGET = np.array([120e3, 90e3, 40e3, 0.0, 0.0, 0.0])


@cache
def expert() -> ModelPredictiveController:
    return make_mpc(Scenario(), load_body("kleopatra"))


def alone(state, target=TARGET, time: float = 0.0, controller=None):
    """A Context of the controller with its inputs fixed, and nothing remembered."""
    return context_of(controller or expert(), time, state=state, target=target)


def force_of(context, controller=None) -> np.ndarray:
    return (controller or expert()).GetOutputPort("force").Eval(context)


def plan_of(context, controller) -> Plan:
    return controller.GetOutputPort("plan").Eval(context)


def remember(controller, context) -> None:
    """Does what the periodic event does."""
    updated = controller.EvalUniquePeriodicDiscreteUpdate(context)
    context.get_mutable_discrete_state().SetFrom(updated)


def random_states(count: int, seed: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Moving states and targets with a clear straight line, outside the ellipsoid."""
    random = np.random.default_rng(seed)
    found: list[tuple[np.ndarray, np.ndarray]] = []
    while len(found) < count:
        ends = random.uniform(-170e3, 170e3, (2, 3))
        distance = np.linalg.norm(ends[1] - ends[0])
        if not 5e3 < distance < 160e3 or blocks_segment(PLANNED_KEEP_OUT, *ends):
            continue
        if clearances(PLANNED_KEEP_OUT, ends).min() > 8e3:
            velocity = random.uniform(-10.0, 10.0, 3)
            found.append((np.append(ends[0], velocity), np.append(ends[1], np.zeros(3))))
    return found


# A function of state and target


@pytest.mark.parametrize(("state", "target"), random_states(6, seed=3))
def test_command_is_the_same_whatever_went_before(state, target):
    """Off the converged command by 5e-5 N cold, 2.4e-3 to 1e-2 N warm from three histories."""
    converged = expert().program.solve(state, target, iterations=40)
    assert converged.slack < 1e-9
    cold = force_of(alone(state, target))
    assert cold == pytest.approx(converged.forces[0], abs=0.03)

    random = np.random.default_rng(0)
    before = np.concatenate([state[:3] - PERIOD * state[3:], state[3:]])
    off = random.normal(size=6) * np.repeat([300.0, 0.5], 3)
    elsewhere = target + np.append(random.normal(size=3) * 3e3, np.zeros(3))
    for was, aim, tolerance in (
        (before, target, 0.03),
        (before + off, target, 0.05),
        (before, elsewhere, 0.05),
    ):
        context = alone(was, aim, time=500.0)
        remember(expert(), context)
        context.SetTime(500.0 + PERIOD)
        expert().GetInputPort("state").FixValue(context, state)
        expert().GetInputPort("target").FixValue(context, target)
        warm = expert().GetOutputPort("plan").Eval(context)
        assert warm.iterations in ((COLD,) if aim is elsewhere else (1, COLD))
        assert warm.forces[0] == pytest.approx(converged.forces[0], abs=tolerance)
        # One more step from there and hardly a trace is left.
        remember(expert(), context)
        context.SetTime(500.0 + PERIOD + 1e-3)
        assert force_of(context) == pytest.approx(converged.forces[0], abs=0.02)


def test_old_plan_is_relinearised_until_it_settles():
    """States at the plan's point, near it, and where a minute's coasting would have taken it."""
    controller, program = counting_expert()
    plan = plan_of(alone(START, controller=controller), controller)
    for age in (2 * PERIOD, 10 * PERIOD, 60 * PERIOD):
        for off in (np.zeros(6), [200.0, -300.0, 0.0, 0.2, 0.0, -0.3], [2e3, 0, 1e3, 3.0, 2.0, 0]):
            context = alone(START, controller=controller)
            remember(controller, context)
            context.SetTime(age)
            state = plan.states_at(np.array([age]))[0] + off
            controller.GetInputPort("state").FixValue(context, state)
            program.calls.clear()
            force = force_of(context, controller)
            assert set(program.calls) == {1}
            assert 1 <= len(program.calls) <= 5
            assert plan_of(context, controller).iterations == len(program.calls)
            record = controller.GetOutputPort("record").Eval(context)
            assert record[2] == PlanReason.SOLVED_ANEW_PLAN_TOO_OLD
            cold = force_of(alone(state, controller=controller), controller)
            # Settled is a hundredth of the thrust limit, 0.07 N.
            assert force == pytest.approx(cold, abs=0.03)


def test_old_plan_that_does_not_settle_is_none():
    controller, program = counting_expert()
    context = alone(START, controller=controller)
    remember(controller, context)
    context.SetTime(30 * PERIOD)
    state = np.array([0.0, -90e3, -40e3, 0.0, 0.0, 0.0])
    controller.GetInputPort("state").FixValue(context, state)
    program.calls.clear()
    force = force_of(context, controller)
    assert program.calls == 5 * [1] + [COLD]
    assert np.array_equal(force, force_of(alone(state, controller=controller), controller))


# Any state is answered


def hard_states() -> dict[str, tuple[np.ndarray, np.ndarray]]:
    rest = np.zeros(3)
    at = {
        "origin": ([0.0, 0.0, 0.0], rest, TARGET),
        "inside the body": ([30e3, 5e3, 0.0], rest, TARGET),
        "on a vertex": (load_body("kleopatra").shape.vertices[100], rest, TARGET),
        "inside the keep-out": ([40e3, 50e3, 10e3], [1.0, -20.0, 3.0], TARGET),
        "at the goal": (TARGET[:3], rest, TARGET),
        "at the goal, moving": (TARGET[:3], [5.0, 0.0, -40.0], TARGET),
        "fast towards": (START[:3], 0.004 * (TARGET - START)[:3], TARGET),
        "very fast away": (START[:3], -0.02 * (TARGET - START)[:3], TARGET),
        "opposite over x": ([160e3, 0.0, 0.0], rest, np.array([-160e3, 0, 0, 0, 0, 0])),
        "opposite over y": ([0.0, 90e3, 0.0], rest, np.array([0, -90e3, 0, 0, 0, 0])),
        "opposite over z": ([0.0, 0.0, 90e3], rest, np.array([0, 0, -90e3, 0, 0, 0])),
        "target inside": (START[:3], rest, np.array([20e3, 0, 0, 0, 0, 0])),
        "target at the origin": (START[:3], rest, np.zeros(6)),
        "both at the origin": ([0.0, 0.0, 0.0], rest, np.zeros(6)),
        "far out": ([3e6, -2e6, 1e6], [100.0, 0.0, 0.0], TARGET),
        "a breath from the goal": (TARGET[:3] + 1e-9, rest, TARGET),
        "moving target": (START[:3], rest, TARGET + [0, 0, 0, 5.0, -5.0, 3.0]),
    }
    states = {
        name: (np.concatenate([position, velocity]), target)
        for name, (position, velocity, target) in at.items()
    }
    random = np.random.default_rng(8)
    for k in range(45):
        speed = (1.0, 20.0, 200.0)[k % 3]
        position, target = random.uniform(-170e3, 170e3, (2, 3))
        velocity = speed * random.normal(size=3)
        states[f"random {k}"] = np.append(position, velocity), np.append(target, np.zeros(3))
    return states


@pytest.mark.slow
def test_any_state_is_answered():
    for name, (state, target) in hard_states().items():
        context = alone(state, target)
        plan = expert().GetOutputPort("plan").Eval(context)
        force = force_of(context)
        assert plan.status == SOLVED, name
        assert np.isfinite(force).all(), name
        assert np.abs(force).max() <= THRUST, name
        # And again from the plan that came of it, though that may lead nowhere.
        remember(expert(), context)
        context.SetTime(PERIOD)
        assert expert().GetOutputPort("plan").Eval(context).status == SOLVED, name
        assert np.abs(force_of(context)).max() <= THRUST, name


def test_above_the_speed_limit_it_brakes():
    state = START.copy()
    state[4] = 60.0
    assert force_of(alone(state))[1] == pytest.approx(-THRUST)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_state_that_is_no_number_does_not_stop_the_flight(bad):
    state = START.copy()
    state[1] = bad
    context = alone(state)
    assert expert().GetOutputPort("record").Eval(context)[1] == BRAKING
    assert force_of(context).tolist() == [0.0, 0.0, 0.0]
    context = alone(START)
    remember(expert(), context)
    context.SetTime(PERIOD)
    expert().GetInputPort("state").FixValue(context, state)
    assert expert().GetOutputPort("record").Eval(context)[1] == CONTINUED
    assert force_of(context) == pytest.approx(force_of(alone(START)))


# In a simulation


def flight(
    controller, enable: float | None = None, pulled: bool = True, start=START, aim=TARGET
) -> Diagram:
    """Controller, hold and plant; `force` and `record` are logged."""
    body = load_body("kleopatra")
    builder = DiagramBuilder()
    builder.AddNamedSystem("controller", controller)
    craft = builder.AddNamedSystem("craft", Spacecraft(MASS, body.spin_rate, start))
    gravity = builder.AddSystem(PolyhedralGravity(body.gravity_field))
    target = builder.AddSystem(ConstantVectorSource(aim))
    delay = controller.delay
    hold = DelayedHold(PERIOD, delay, 3) if delay > 0.0 else ZeroOrderHold(PERIOD, 3)
    builder.AddSystem(hold)
    builder.Connect(craft.GetOutputPort("position"), gravity.GetInputPort("position"))
    builder.Connect(gravity.GetOutputPort("acceleration"), craft.GetInputPort("gravity"))
    builder.Connect(craft.GetOutputPort("state"), controller.GetInputPort("state"))
    builder.Connect(target.get_output_port(), controller.GetInputPort("target"))
    builder.Connect(hold.GetOutputPort("y"), craft.GetInputPort("force"))
    command = controller.GetOutputPort("force")
    if pulled:
        for name in ("force", "record"):
            port = controller.GetOutputPort(name)
            LogVectorOutput(port, builder, publish_period=PERIOD).set_name(f"log_{name}")
    else:
        command = builder.AddSystem(ConstantVectorSource(np.zeros(3))).get_output_port()
    builder.Connect(command, hold.get_input_port())
    state = LogVectorOutput(craft.GetOutputPort("state"), builder, publish_period=PERIOD)
    state.set_name("log_state")
    if enable is not None:
        switch = builder.AddNamedSystem("enable", ConstantVectorSource(np.array([enable])))
        builder.Connect(switch.get_output_port(), controller.GetInputPort("enable"))
    return builder.Build()


def simulator_of(diagram: Diagram) -> Simulator:
    simulator = Simulator(diagram)
    # Steps of fixed length: an integrator's choice of the next step is no part of the Context.
    integrator = ResetIntegratorFromFlags(simulator, "runge_kutta5", PERIOD)
    integrator.set_fixed_step_mode(True)
    simulator.Initialize()
    return simulator


def logged(simulator: Simulator, name: str) -> np.ndarray:
    sink = simulator.get_system().GetSubsystemByName(f"log_{name}")  # type: ignore[attr-defined]
    return sink.FindLog(simulator.get_context()).data().T.copy()


def memory_of(simulator: Simulator) -> np.ndarray:
    controller = simulator.get_system().GetSubsystemByName("controller")  # type: ignore[attr-defined]
    context = controller.GetMyContextFromRoot(simulator.get_context())
    return context.get_discrete_state_vector().CopyToVector()


def test_one_solve_a_step():
    controller, program = counting_expert()
    simulator = simulator_of(flight(controller))
    simulator.AdvanceTo(40 * PERIOD)
    # Steps 0 to 39 are over; the log has asked for step 40 already.
    assert program.calls == [COLD] + 40 * [1]
    assert logged(simulator, "record")[:, 1].tolist() == 41 * [SOLVED]


def test_disabled_it_neither_solves_nor_remembers():
    controller, program = counting_expert()
    diagram = flight(controller, enable=0.0, pulled=False)
    simulator = simulator_of(diagram)
    simulator.AdvanceTo(10.5 * PERIOD)
    assert program.calls == []
    assert not memory_of(simulator).any()
    # Switched on for one step, then off: a solve, and a memory that stays.
    switch = diagram.GetSubsystemByName("enable")
    assert isinstance(switch, ConstantVectorSource)

    def set_enable(value: float) -> None:
        context = switch.GetMyMutableContextFromRoot(simulator.get_mutable_context())
        switch.get_mutable_source_value(context).SetAtIndex(0, value)

    set_enable(1.0)
    simulator.AdvanceTo(11.5 * PERIOD)
    set_enable(0.0)
    remembered = memory_of(simulator)
    assert remembered[:2].tolist() == [1.0, 11 * PERIOD]
    simulator.AdvanceTo(20.5 * PERIOD)
    assert program.calls == [COLD]
    assert np.array_equal(remembered, memory_of(simulator))
    # After a pause until it settles, then as after none.
    set_enable(1.0)
    simulator.AdvanceTo(21.5 * PERIOD)
    assert program.calls[0] == COLD
    assert program.calls[1:] == (len(program.calls) - 1) * [1]
    assert 1 <= len(program.calls) - 1 <= 5
    program.calls.clear()
    simulator.AdvanceTo(22.5 * PERIOD)
    assert program.calls == [1]


@pytest.mark.slow
@pytest.mark.parametrize("place", [[10e3, 50e3, 20e3], [125e3, 10e3, 0.0]])
def test_out_of_the_keep_out_by_the_shortest_way(place):
    """At rest inside, with the target across the body: out first, along the nearest normal."""
    axes = load_body("kleopatra").keep_out_semi_axes
    start = np.append(place, np.zeros(3))
    target = np.append(-1.6 * np.array(place), np.zeros(3))
    simulator = simulator_of(flight(counting_expert()[0], start=start, aim=target))
    simulator.AdvanceTo(1000.0)
    path = logged(simulator, "state")[:, :3]
    depth = -clearances(axes, path)
    assert depth[0] > 1e3
    out = np.flatnonzero(depth < 0.0)
    assert out.size
    assert (depth[out[0] :] < 1.0).all()
    straight = np.linalg.norm(closest_point(axes, path[0]) - path[0])
    assert np.linalg.norm(path[out[0]] - path[0]) < 1.3 * straight


# Failures


def test_last_plan_is_continued_by_the_clock():
    """For 300 s: longer than the plan's first interval."""
    controller, program = counting_expert()
    simulator = simulator_of(flight(controller))
    simulator.AdvanceTo(20.5 * PERIOD)
    context = controller.GetMyContextFromRoot(simulator.get_context())
    memory = context.get_discrete_state_vector().CopyToVector()
    made, length = memory[1], memory[2]
    intervals = program.horizon.intervals
    planned = memory[9 + 6 * (intervals + 1) : -3].reshape(intervals, 3)
    ends = length * program.horizon.fractions()[1:]
    assert made == 20 * PERIOD
    assert ends[0] < 300.0  # So it is passed.

    program.broken = True
    simulator.AdvanceTo(50.5 * PERIOD)
    records, forces = logged(simulator, "record"), logged(simulator, "force")
    assert records[:, 1].tolist() == 21 * [SOLVED] + 30 * [CONTINUED]
    for step in range(21, 51):
        due = planned[np.searchsorted(ends, PERIOD * step - made, side="right")]
        assert forces[step] == pytest.approx(due, abs=1e-12), step
    assert np.abs(forces[50] - forces[21]).max() > 0.1

    program.broken = False
    simulator.AdvanceTo(60.5 * PERIOD)
    assert logged(simulator, "record")[51:, 1].tolist() == 10 * [SOLVED]
    states, forces = logged(simulator, "state"), logged(simulator, "force")
    for step in (51, 52, 60):
        assert forces[step] == pytest.approx(force_of(alone(states[step])), abs=0.01)


def test_failed_plan_of_one_step_is_tried_once_more_from_nothing():
    """A bad previous plan is not allowed to make a good state fail."""

    class Fussy(CountingProgram):
        def solve(self, state, target, previous=None, *given, **named) -> Plan:
            if previous is None:
                return super().solve(state, target, previous, *given, **named)
            self.calls.append(-given[1])
            raise SolverFailure(SolutionResult.kSolverSpecificError)

    controller, program = counting_expert(Fussy)
    simulator = simulator_of(flight(controller))
    simulator.AdvanceTo(2.5 * PERIOD)
    assert program.calls == [COLD, -1, COLD, -1, COLD]
    records = logged(simulator, "record")
    assert records[:, 1].tolist() == 3 * [SOLVED]
    assert records[1:, 2].tolist() == 2 * [PlanReason.SOLVED_ANEW_AFTER_FAILURE]


def test_braking_takes_the_speed_off_within_the_limits():
    controller, program = counting_expert()
    program.broken = True
    moving = START + [0.0, 0.0, 0.0, 30.0, -0.01, 0.0]
    force = force_of(alone(moving, controller=controller), controller)
    assert force[0] == -THRUST
    gravity = program.field.evaluate(START[None, :3]).acceleration[0]
    # By hand for z, on which nothing but gravity works: m g is lifted.
    assert force[2] == pytest.approx(-MASS * gravity[2])
    assert np.abs(force).max() <= THRUST


# Reasons


def reason_of(context, controller) -> tuple[float, float]:
    """Status and reason, and that force and plan keep their limits."""
    _, status, reason = controller.GetOutputPort("record").Eval(context)
    force = force_of(context, controller)
    assert np.isfinite(force).all()
    assert np.abs(force).max() <= THRUST
    return status, reason


@pytest.mark.parametrize(
    ("failure", "reason"),
    [
        (SolutionResult.kInfeasibleConstraints, PlanReason.SOLVER_INFEASIBLE),
        (SolutionResult.kIterationLimit, PlanReason.SOLVER_ITERATION_LIMIT),
        (SolutionResult.kSolverSpecificError, PlanReason.SOLVER_ERROR),
    ],
)
def test_reasons_of_failures(failure, reason):
    controller, program = counting_expert()
    program.failure = failure
    context = alone(START, controller=controller)
    remember(controller, context)
    program.broken = True
    for step in (1, 2, 40):
        context.SetTime(step * PERIOD)
        assert reason_of(context, controller) == (CONTINUED, reason)
        remember(controller, context)
    assert reason_of(alone(START, controller=controller), controller) == (BRAKING, reason)


def test_the_time_that_is_left_bounds_plans_until_it_is_too_late():
    like = expert().program
    length = like.solve(START, TARGET, iterations=COLD).times[-1]
    latest = 0.9 * length
    system = ModelPredictiveController(like, PERIOD, COLD, latest=latest)
    context = alone(START, controller=system)

    def planned(now: float) -> float:
        context.SetTime(now)
        return system.GetOutputPort("plan").Eval(context).times[-1]

    assert planned(0.0) == pytest.approx(latest, rel=1e-6)
    assert planned(0.05 * length) == pytest.approx(latest - 0.05 * length, rel=1e-6)
    assert planned(latest - 100.0) == pytest.approx(length)
    with pytest.raises(InputError, match="latest end of a plan must be positive"):
        ModelPredictiveController(like, latest=0.0)
