"""The condensed convex program against the same one with states as variables and every limit in.

Eq. 9 and 10 of docs/method/equations.md.
"""

import dataclasses
from functools import cache

import numpy as np
import pytest
from pydrake.solvers import ClarabelSolver, MathematicalProgram, SolutionResult, SolverOptions
from scipy.linalg import expm
from transit_sets import transit_set

from proxops.diagrams.flight.scenario_systems import make_mpc
from proxops.diagrams.scenario import Scenario, load_body
from proxops.systems import Gravity, Plan, TransitProgram
from proxops.systems.common import SolverFailure, cross_matrix
from proxops.systems.expert import linearised_transit
from proxops.systems.expert.condensing import Reference, condensed_motion
from proxops.systems.rotation import SteadySpin, TorqueFreeSpin
from proxops.systems.shapes.ellipsoid import clearances

# A long-axis mode, like that of Toutatis.
TUMBLING = TorqueFreeSpin(np.diag([1.0, 3.09, 3.22]), np.array([2e-4, 1e-4, 1.5e-4]))


# Condensed motion


@pytest.mark.parametrize("spin", [SteadySpin((0.0, 0.0, 3e-4)), TUMBLING])
def test_motion_is_the_product_of_matrix_exponentials(spin):
    """By scipy's expm, in a field that is linear: there it is exact.

    The spin is that of the middle of each interval.
    """
    random = np.random.default_rng(5)
    gradient, constant = 1e-6 * random.normal(size=(3, 3)), 1e-2 * random.normal(size=3)

    class LinearField:
        def evaluate(self, points: np.ndarray) -> Gravity:
            pull, count = points @ gradient.T + constant, len(points)
            everywhere = np.tile(gradient, (count, 1, 1))
            return Gravity(np.zeros(count), pull, everywhere, np.zeros(count, bool))

    push = 1e-3 * random.normal(size=3)
    lengths, force = np.array([50.0, 120.0, 300.0]), 0.07
    start, controls = random.normal(size=6) * np.repeat([1e5, 10.0], 3), random.normal(size=(3, 3))
    begun = 2000.0
    matrices = np.zeros((3, 10, 10))
    for matrix, time in zip(matrices, begun + np.array([25.0, 110.0, 320.0]), strict=True):
        turn = cross_matrix(spin.angular_velocity(time))
        matrix[:3, 3:6] = np.eye(3)
        matrix[3:6, :3] = gradient - turn @ turn - cross_matrix(spin.angular_acceleration(time))
        matrix[3:6, 3:6] = -2.0 * turn
        matrix[3:6, 6:9], matrix[3:6, 9] = force * np.eye(3), constant + push

    def flown(stretch: float) -> np.ndarray:
        states = [start]
        longer = (1.0 + stretch) * lengths
        for matrix, length, control in zip(matrices, longer, controls, strict=True):
            end = expm(length * matrix) @ np.concatenate([states[-1], control, [1.0]])
            states.append(np.array(end[:6], dtype=float))
        return np.array(states)

    states = flown(0.0)
    rows = condensed_motion(
        LinearField(), spin, start, Reference(states, controls, lengths), force, push, begun
    )
    assert rows.shape == (3, 6, 11)
    ends = rows @ np.concatenate([controls.ravel(), [0.0, 1.0]])
    np.testing.assert_allclose(ends, states[1:], rtol=1e-9)
    slope = (flown(1e-4) - flown(-1e-4))[1:] / 2e-4
    np.testing.assert_allclose(rows[:, :, 9], slope, rtol=1e-6)
    # No state depends on a later control.
    for k in range(3):
        assert not rows[k, :, 3 * (k + 1) : 9].any()


# The same program with the states as variables, and every limit in it


def program_with_states(program: TransitProgram, state, target, last: Plan, age: float):
    """Forces (N, 3), states (N + 1, 6) and length of the optimum, of hard limits: no slack."""
    n, limits = program.horizon.intervals, program.limits
    fractions = program.horizon.fractions()
    shares, units = np.diff(fractions), np.repeat([1e4, 10.0], 3)
    duration = max(last.times[-1] - age, program.horizon.minimum)
    times = age + duration * fractions
    about = last.states_at(times)
    controls = last.forces_at(0.5 * (times[1:] + times[:-1])) / limits.thrust
    fuel = program.fuel_weight(duration)
    prog = MathematicalProgram()
    x, s = prog.NewContinuousVariables(n + 1, 6), prog.NewContinuousVariables(1)
    up, down = prog.NewContinuousVariables(n, 3), prog.NewContinuousVariables(n, 3)
    prog.AddBoundingBoxConstraint(state / units, state / units, x[0])
    prog.AddBoundingBoxConstraint(target / units, target / units, x[n])
    prog.AddBoundingBoxConstraint(0.0, 1.0, np.concatenate([up.ravel(), down.ravel()]))
    prog.AddBoundingBoxConstraint(-limits.speed / 10.0, limits.speed / 10.0, x[1:, 3:].ravel())
    least = max(-0.1, program.horizon.minimum / duration - 1.0)
    prog.AddBoundingBoxConstraint(least, 0.1, s)
    for k in range(n):
        middle = 0.5 * (about[k, :3] + about[k + 1, :3])
        gravity = program.field.evaluate(middle[None])
        rates = np.zeros((10, 10))
        rates[:3, 3:6] = np.eye(3)
        turn = cross_matrix(program.spin.rate)
        rates[3:6, :3] = gravity.gradient[0] - turn @ turn
        rates[3:6, 3:6] = -2.0 * turn
        rates[3:6, 6:9] = limits.thrust / limits.mass * np.eye(3)
        rates[3:6, 9] = gravity.acceleration[0] - gravity.gradient[0] @ middle
        rates *= duration * shares[k]
        step = expm(rates)
        longer = rates @ step @ np.concatenate([about[k], controls[k], [1.0]])
        motion = np.hstack(
            [
                step[:6, :6] * units / units[:, None],
                np.kron([1.0, -1.0], step[:6, 6:9]) / units[:, None],
                (longer[:6] / units)[:, None],
                -np.eye(6),
            ]
        )
        prog.AddLinearEqualityConstraint(
            motion, -step[:6, 9] / units, np.concatenate([x[k], up[k], down[k], s, x[k + 1]])
        )
        # Of the point of the ellipsoid below the knot; the offset is the support function.
        normal = about[k + 1, :3] / limits.keep_out_semi_axes**2
        normal /= np.linalg.norm(normal)
        height = np.linalg.norm(limits.keep_out_semi_axes * normal) / 1e4
        prog.AddLinearConstraint(normal[None], [height], [np.inf], x[k + 1, :3])
        for way in (up[k], down[k]):
            prog.AddQuadraticCost(2.0 * shares[k] * np.eye(3), fuel * shares[k] * np.ones(3), way)
    effort = shares @ np.sum(controls**2 + fuel * np.abs(controls), axis=1)
    price = np.array([program.time_price + effort])
    prog.AddQuadraticCost(price[None], price, s)
    result = ClarabelSolver().Solve(prog)
    assert result.is_success()
    forces = limits.thrust * (result.GetSolution(up) - result.GetSolution(down))
    length = duration * (1.0 + result.GetSolution(s)[0])
    return forces, result.GetSolution(x) * units, length


@cache
def expert() -> TransitProgram:
    made = make_mpc(Scenario(), load_body("kleopatra")).program
    assert isinstance(made, TransitProgram)
    return made


def ends(index: int) -> tuple[np.ndarray, np.ndarray]:
    """The ends of a transit, at rest; at 1 and 4 the body is in the way."""
    transit = transit_set(77, 5)[index]
    return np.append(transit.start, np.zeros(3)), np.append(transit.goal, np.zeros(3))


class NotingSolver:
    """Notes of each solve whether the linear solves in it are refined."""

    def __init__(self, fail: int = 0):
        """Makes so many solves fail first."""
        self.refined, self.fail = [], fail

    def Solve(self, program, guess, options):  # noqa: N802
        self.refined.append(options.options["Clarabel"]["iterative_refinement_enable"])
        if len(self.refined) <= self.fail:
            options = SolverOptions()
            options.SetOption(ClarabelSolver.id(), "max_iter", 2)
        return ClarabelSolver().Solve(program, guess, options)


def assert_same(plan: Plan, forces: np.ndarray, states: np.ndarray, length: float) -> None:
    assert plan.slack < 1e-9
    assert plan.times[-1] == pytest.approx(length, rel=2e-6)
    assert plan.forces == pytest.approx(forces, abs=3e-4)
    assert plan.states[:, :3] == pytest.approx(states[:, :3], abs=0.5)
    assert plan.states[:, 3:] == pytest.approx(states[:, 3:], abs=1e-3)


@pytest.mark.parametrize("index", [0, 1])
@pytest.mark.parametrize(("iterations", "age"), [(3, 10.0), (12, 900.0)])
def test_optimum_is_that_with_states_and_every_limit(index, iterations, age):
    start, target = ends(index)
    last = expert().solve(start, target, iterations=iterations)
    state = last.states_at(np.array([age]))[0] + [50.0, -80.0, 60.0, 0.05, -0.1, 0.08]
    expected = program_with_states(expert(), state, target, last, age)
    plan = expert().solve(state, target, last, age)
    assert_same(plan, *expected)


# Limits that the last plan is far from


def far_from_limits(last: Plan) -> Plan:
    """Higher above the body, and at rest all the way."""
    states = 1.3 * last.states
    states[:, 3:] = 0.0
    return dataclasses.replace(last, states=states)


def violations(program, last: Plan, plan: Plan) -> tuple[float, float]:
    """By which keep-out half-spaces, in m, and speed limit, in m/s, are broken at most."""
    axes = program.limits.keep_out_semi_axes
    normals = last.states[1:, :3] / axes**2
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    height = np.sum(normals * plan.states[1:, :3], axis=1) - np.linalg.norm(axes * normals, axis=1)
    return -height.min(), np.abs(plan.states[1:, 3:]).max() - program.limits.speed


OVER = (np.array([0.0, 90e3, 0.0, 0.0, 0.0, 0.0]), np.array([0.0, -90e3, 0.0, 0.0, 0.0, 0.0]))


def limited_to(speed: float) -> TransitProgram:
    limits = dataclasses.replace(expert().limits, speed=speed)
    return TransitProgram(expert().field, expert().spin, limits, expert().horizon)


@pytest.mark.parametrize(("speed", "excess"), [(36.0, 5.0), (40.0, 5.0), (100.0, -np.inf)])
def test_limits_out_of_sight_of_the_last_plan_are_kept(speed, excess, monkeypatch):
    """Though first left out, and broken if they stay out; the optimum is that with all of them."""
    last = far_from_limits(expert().solve(*OVER, iterations=12))
    program = limited_to(speed)
    axes = program.limits.keep_out_semi_axes
    assert clearances(axes, last.states[:, :3]).min() > 5e3  # A row is not far from 1 km on.
    program.transit.solver = solver = NotingSolver()
    plan = program.solve(*OVER, last)
    assert len(solver.refined) >= 2
    inside, too_fast = violations(program, last, plan)
    assert inside < 1e-3
    assert too_fast < 1e-6
    assert_same(plan, *program_with_states(program, *OVER, last, 0.0))

    monkeypatch.setattr(linearised_transit, "_TOLERANCE", np.inf)
    inside, too_fast = violations(program, last, program.solve(*OVER, last))
    assert inside > 10e3
    assert too_fast > excess


# Refinement


def test_a_solve_that_fails_is_refined_once():
    program = limited_to(40.0)
    start, target = ends(0)
    plain = program.solve(start, target)
    # The first solve is that without slack.
    for fail, refined in ((1, [0, 0]), (2, [0, 0, 1])):
        program.transit.solver = solver = NotingSolver(fail)
        again = program.solve(start, target)
        assert solver.refined == refined
        assert again.forces == pytest.approx(plain.forces, abs=1e-3)
    # The next goes without again.
    assert np.array_equal(program.solve(start, target).forces, plain.forces)
    assert solver.refined == [0, 0, 1, 0]

    program.transit.solver = solver = NotingSolver(fail=3)
    with pytest.raises(SolverFailure) as failure:
        program.solve(start, target)
    assert failure.value.result == SolutionResult.kIterationLimit
    assert solver.refined == [0, 0, 1]


# Slack


@pytest.mark.parametrize("price", ["SLACK_PRICE", "KEEP_OUT_PRICE"])
def test_slack_is_used_where_it_is_cheaper(price, monkeypatch):
    """The program without slack has a solution, which is not that of the program with slack."""
    last = expert().solve(*OVER, iterations=12)
    monkeypatch.setattr(linearised_transit, price, 1e-3)
    program = limited_to(36.0)
    program.transit.solver = solver = NotingSolver()
    plan = program.solve(*OVER, last)
    assert plan.slack > 1e-3
    assert len(solver.refined) >= 2
    monkeypatch.setattr(program.transit, "_without_slack", lambda rows, included: None)
    expected = program.solve(*OVER, last)
    assert plan.forces == pytest.approx(expected.forces, abs=1e-3)
    assert plan.slack == pytest.approx(expected.slack, rel=1e-4)
