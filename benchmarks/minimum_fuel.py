"""How far the expert is from the least fuel: flown Δv over that of an independent optimum.

Each transit of the standard set is flown by the MPC. A full-horizon nonlinear program then goes
from the same start to the state the flight had at its arrival, in the same time, at the least
integral of |F|_1 / m: force constant over each of many equal intervals, Hermite-Simpson defects
through the polyhedron's field with analytic Jacobians, the spacecraft's limits of thrust and speed,
and the keep-out ellipsoid itself, without the expert's margin. It shares nothing with the expert's
program but the field.

It is solved from two first guesses, the flight and a bent polynomial that knows nothing of it; the
lower of the two counts, so that the gap is not flattered. Each is checked without the program: its
forces are integrated again by DOP853 through the true field, which gives the error of the end, the
greatest speed and the least clearance of the path between the knots.

    python benchmarks/minimum_fuel.py [--transits 50] [--seed 10001] [--plot gap.png]
"""

import argparse
import os
import time
from dataclasses import dataclass

for name in ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[name] = "1"

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from pydrake.autodiffutils import ExtractGradient, ExtractValue, InitializeAutoDiff
from pydrake.solvers import MathematicalProgram, SnoptSolver, SolverOptions
from rich.console import Console
from rich.table import Table
from scipy.integrate import solve_ivp

from proxops.diagrams.body import Body, load_body
from proxops.diagrams.scenario import Scenario, load_scenario
from proxops.diagrams.simulation import fly
from proxops.systems.ellipsoid import clearances

UNITS = np.repeat([1e4, 10.0], 3)
# Largest error of the end (m, m/s) that the independent integration may find.
END_TOLERANCE = np.repeat([20.0, 0.02], 3)


@dataclass
class Optimum:
    delta_v: float
    """m/s."""
    states: np.ndarray
    """(N + 1, 6) in m and m/s."""
    forces: np.ndarray
    """(N, 3) in N."""
    end_error: np.ndarray
    """(2,) in m and m/s, by DOP853."""
    clearance: float
    """m, least along the path that DOP853 finds."""
    speed: float
    """m/s, greatest along any axis of that path."""
    converged: bool
    seconds: float


class MinimumFuel:
    """The nonlinear program between two states in a given time."""

    def __init__(self, scenario: Scenario, body: Body, intervals: int):
        self.craft, self.body, self.intervals = scenario.spacecraft, body, intervals
        w = body.spin_rate
        self.coriolis = np.array([[0.0, 2.0 * w, 0.0], [-2.0 * w, 0.0, 0.0], [0.0, 0.0, 0.0]])
        self.centrifugal = np.diag([w**2, w**2, 0.0])
        self.push = self.craft.thrust_limit_n / self.craft.mass_kg

    def rates(self, states: np.ndarray, control: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """d/dt of states (M, 6) under a control (3,) of 0 to 1, and its Jacobians (M, 6, 6)."""
        gravity = self.body.gravity_field.evaluate(states[:, :3])
        spin = states[:, :3] @ self.centrifugal + states[:, 3:] @ self.coriolis.T
        acceleration = gravity.acceleration + spin + self.push * control
        jacobians = np.zeros((len(states), 6, 6))
        jacobians[:, [0, 1, 2], [3, 4, 5]] = 1.0
        jacobians[:, 3:, :3] = gravity.gradient + self.centrifugal
        jacobians[:, 3:, 3:] = self.coriolis
        return np.hstack([states[:, 3:], acceleration]), jacobians

    def interval(self, variables: np.ndarray, h: float) -> np.ndarray:
        """Defect (6) and the ellipsoid's level in the middle (1), of two states and a force."""
        values = ExtractValue(variables)[:, 0] if variables.dtype == object else variables
        ends, control = values[:12].reshape(2, 6) * UNITS, values[12:15] - values[15:]
        (f0, f1), (a0, a1) = self.rates(ends, control)
        middle = 0.5 * (ends[0] + ends[1]) + h / 8.0 * (f0 - f1)
        (f2,), (a2,) = self.rates(middle[None], control)
        defect = ends[0] + h / 6.0 * (f0 + 4.0 * f2 + f1) - ends[1]
        axes = self.body.keep_out_semi_axes
        result = np.append(defect / UNITS, np.sum((middle[:3] / axes) ** 2))
        if variables.dtype != object:
            return result
        eye = np.eye(6)
        middle_by = np.hstack([0.5 * eye + h / 8.0 * a0, 0.5 * eye - h / 8.0 * a1])
        jacobian = np.zeros((7, 18))
        jacobian[:6, :12] = np.hstack([eye + h / 6.0 * a0, -eye + h / 6.0 * a1])
        jacobian[:6, :12] += 4.0 * h / 6.0 * a2 @ middle_by
        jacobian[6, :12] = 2.0 * middle[:3] / axes**2 @ middle_by[:3]
        jacobian[:, :12] *= np.tile(UNITS, 2)
        jacobian[:6, :12] /= UNITS[:, None]
        jacobian[[3, 4, 5], [12, 13, 14]] = h * self.push / UNITS[3]
        jacobian[[3, 4, 5], [15, 16, 17]] = -h * self.push / UNITS[3]
        return InitializeAutoDiff(result, jacobian @ ExtractGradient(variables))

    def solve(self, start, end, duration: float, states, controls) -> Optimum:
        """The optimum near a guess: states (N + 1, 6), controls (N, 3) from -1 to 1."""
        started = time.perf_counter()
        n, h = self.intervals, duration / self.intervals
        program = MathematicalProgram()
        x = program.NewContinuousVariables(n + 1, 6, "x")
        up, down = (program.NewContinuousVariables(n, 3, way) for way in ("up", "down"))
        program.AddBoundingBoxConstraint(start / UNITS, start / UNITS, x[0])
        program.AddBoundingBoxConstraint(end / UNITS, end / UNITS, x[n])
        fastest = self.craft.speed_limit_m_s / UNITS[3]
        program.AddBoundingBoxConstraint(-fastest, fastest, x[1:n, 3:])
        program.AddBoundingBoxConstraint(0.0, 1.0, up)
        program.AddBoundingBoxConstraint(0.0, 1.0, down)
        level = np.diag(2.0 * (UNITS[:3] / self.body.keep_out_semi_axes) ** 2)
        bounds = np.append(np.zeros(6), 1.0), np.append(np.zeros(6), np.inf)
        for k in range(n):
            both = np.concatenate([x[k], x[k + 1], up[k], down[k]])
            program.AddConstraint(lambda v: self.interval(v, h), *bounds, both)
            if k:
                program.AddQuadraticConstraint(level, np.zeros(3), 1.0, np.inf, x[k, :3])
        forces = np.concatenate([up.ravel(), down.ravel()])
        program.AddLinearCost(np.full(6 * n, h * self.push / UNITS[3]), 0.0, forces)
        program.SetInitialGuess(x, states / UNITS)
        program.SetInitialGuess(up, np.clip(controls, 0.0, 1.0))
        program.SetInitialGuess(down, np.clip(-controls, 0.0, 1.0))
        options = SolverOptions()
        for key, value in (
            ("Major feasibility tolerance", 1e-7),
            ("Major optimality tolerance", 1e-4),
            ("Major iterations limit", 500),
            ("Iterations limit", 200_000),
            ("Superbasics limit", 2_000),
        ):
            options.SetOption(SnoptSolver.id(), key, value)
        result = SnoptSolver().Solve(program, None, options)
        controls = result.GetSolution(up) - result.GetSolution(down)
        self.info = result.get_solver_details().info
        return self.check(
            result.GetSolution(x) * UNITS, controls, duration, result.is_success(), started
        )

    def check(self, states, controls, duration: float, success: bool, started: float) -> Optimum:
        """Flies the controls again, from the first state, by another integrator."""
        seconds = time.perf_counter() - started
        h = duration / self.intervals
        state, path = states[0], [states[:1]]
        for control in controls:
            flown = solve_ivp(
                lambda _, y, u=control: self.rates(y[None], u)[0][0],
                (0.0, h), state, "DOP853", np.linspace(0.0, h, 5), rtol=1e-9, atol=1e-6,
            )  # fmt: skip
            state = flown.y[:, -1]
            path.append(flown.y.T[1:])
        path = np.concatenate(path)
        error = np.abs(state - states[-1])
        return Optimum(
            delta_v=float(np.sum(np.abs(controls)) * h * self.push),
            states=states,
            forces=controls * self.craft.thrust_limit_n,
            end_error=np.array([np.linalg.norm(error[:3]), np.linalg.norm(error[3:])]),
            clearance=float(clearances(self.body.keep_out_semi_axes, path[:, :3]).min()),
            speed=float(np.abs(path[:, 3:]).max()),
            converged=success and bool((error <= END_TOLERANCE).all()),
            seconds=seconds,
        )
