"""The paper's weighted error cost: its optimum, its limits, and what it does in flight."""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import minimize

from proxops.diagrams.flight.simulation import fly
from proxops.diagrams.scenario import Scenario, load_body, load_scenario
from proxops.systems import (
    ErrorWeights,
    FlightLimits,
    Horizon,
    Plan,
    PointMassField,
    WeightedProgram,
)
from proxops.systems.common.errors import SolverFailure

MASS, SPIN, LENGTH = 100.0, 3.0e-4, 1200.0
HORIZON = Horizon(intervals=12, minimum=LENGTH)
WEIGHTS = ErrorWeights(position=8e3, speed=15.0)
START = np.array([210e3, -40e3, 30e3, 2.0, -3.0, 1.0])
TARGET = np.array([200e3, -20e3, 25e3, 0.0, 0.0, 0.0])


# Pulls as Kleopatra does.
FIELD = PointMassField(2.97e18)


def unlimited(weights: ErrorWeights = WEIGHTS, thrust: float = 200.0) -> WeightedProgram:
    """Limits so wide that none binds."""
    limits = FlightLimits(MASS, thrust, 1e3, np.array([70e3, 70e3, 70e3]))
    return WeightedProgram(FIELD, SPIN, limits, HORIZON, weights)


def straight(start: np.ndarray, end: np.ndarray) -> Plan:
    """A path to linearise about, without force."""
    times = LENGTH * HORIZON.fractions()
    states = start + (times / LENGTH)[:, None] * (end - start)
    forces = np.zeros((HORIZON.intervals, 3))
    return Plan(times, states, forces, end, 0.0, 0.0, 0, 0)


def least_squares(about: Plan, start, target, weights: ErrorWeights, thrust: float, push):
    """Forces (N, 3) and states (N, 6) by one dense least squares, in SI units, of the same problem.

    The states are an affine function of all forces, built up interval by interval.
    """
    n = HORIZON.intervals
    scale = 1.0 / np.repeat([weights.position, weights.speed], 3)
    constant, effect = start.copy(), np.zeros((6, 3 * n))
    rows, wanted, states = [], [], []
    for k, length in enumerate(np.diff(about.times)):
        middle = 0.5 * (about.states[k, :3] + about.states[k + 1, :3])
        gravity = FIELD.evaluate(middle[None])
        matrix = np.zeros((10, 10))
        matrix[:3, 3:6] = np.eye(3)
        matrix[3:6, :3] = gravity.gradient[0] + np.diag([SPIN**2, SPIN**2, 0.0])
        matrix[3:6, 3:6] = -2.0 * SPIN * np.array([[0, -1, 0], [1, 0, 0], [0, 0, 0]])
        matrix[3:6, 6:9] = np.eye(3) / MASS
        matrix[3:6, 9] = gravity.acceleration[0] - gravity.gradient[0] @ middle + push
        step = expm(length * matrix)
        constant = step[:6, :6] @ constant + step[:6, 9]
        effect = step[:6, :6] @ effect
        effect[:, 3 * k : 3 * k + 3] += step[:6, 6:9]
        share = np.sqrt(length / LENGTH)
        states.append((effect.copy(), constant.copy()))
        rows.append(share * scale[:, None] * effect)
        wanted.append(share * scale * (target - constant))
        rows.append(share / thrust * np.eye(3 * n)[3 * k : 3 * k + 3])
        wanted.append(np.zeros(3))
    forces = np.linalg.lstsq(np.vstack(rows), np.concatenate(wanted), rcond=None)[0]
    return forces.reshape(n, 3), np.stack([e @ forces + c for e, c in states])


@pytest.mark.parametrize("push", [np.zeros(3), np.array([2e-3, -1e-3, 3e-3])])
@pytest.mark.parametrize("weights", [WEIGHTS, ErrorWeights(position=40e3, speed=4.0)])
def test_without_limits_it_is_the_least_squares_solution(weights, push):
    about, thrust = straight(START, TARGET), 200.0
    plan = unlimited(weights, thrust).solve(START, TARGET, about, disturbance=push)
    forces, states = least_squares(about, START, TARGET, weights, thrust, push)
    assert np.abs(forces).max() < 0.9 * thrust
    assert plan.times == pytest.approx(about.times)
    assert plan.forces == pytest.approx(forces, abs=2e-5 * thrust)
    assert plan.states[1:, :3] == pytest.approx(states[:, :3], abs=0.5)
    assert plan.states[1:, 3:] == pytest.approx(states[:, 3:], abs=2e-3)
    error = (states - TARGET) / np.repeat([weights.position, weights.speed], 3)
    terms = np.sum(error**2, axis=1) + np.sum((forces / thrust) ** 2, axis=1)
    assert plan.cost == pytest.approx(np.diff(plan.times) @ terms, rel=1e-5)
    assert plan.slack < 1e-8


def weighted(*overrides: str) -> Scenario:
    return load_scenario(None, ["mpc.cost=weighted", *overrides], on_true_state=True)


def test_no_plan_from_no_state():
    program = unlimited()
    with pytest.raises(SolverFailure):
        program.solve(np.full(6, np.nan), TARGET)


@pytest.mark.parametrize("place", [[20e3, 95e3, 40e3], [10e3, 0.0, 80e3]])
def test_held_it_stands_where_error_and_hover_thrust_cost_least(place):
    """Beside its goal, by what one minimum over three coordinates says, not where it began."""
    body, goal, error = load_body("kleopatra"), np.array(place), 3e3

    def cost(hundreds: np.ndarray) -> float:
        at = goal + 100.0 * hundreds
        pull = body.gravity_field.evaluate(at[None]).acceleration[0]
        pull = pull + body.spin_rate**2 * at * [1.0, 1.0, 0.0]
        away = 100.0 * hundreds / error
        return float(away @ away + np.sum((MASS * pull / 7.0) ** 2))

    expected = 100.0 * minimize(cost, np.zeros(3), options={"gtol": 1e-10}).x
    log = fly(
        weighted(
            f"transit.start_m={place}",
            f"transit.goal_m={place}",
            f"mpc.weighted.position_error_m={error}",
            "mpc.weighted.speed_error_m_s=10",
            "arrival.dwell_s=1500",
            "arrival.deadline_s=10",
        )
    )
    away = log.dataset["state"].values[-1, :3] - goal
    assert log.summary["terminal_speed_m_s"] < 1e-3
    assert np.linalg.norm(expected) > 1.0
    # A horizon has an end; the minimum knows none.
    assert np.linalg.norm(away - expected) < 0.12 * np.linalg.norm(expected)
