"""Compares the expert's control step with CasADi and IPOPT on the same problem, in one run.

The MPC flies a transit. At every state on its way all sides then plan to the target, in turn, each
from its own last plan of one period ago, on one thread. All do the whole step: gravity along the
last plan, the update of the problem, its solution, and reading the plan from it.

CasADi solves the problem that the expert's sequence of convex programs converges to. It has the
same knots, limits, priced slacks and tangent half-spaces, and the same affine gravity about its
last plan, because the field is no symbolic expression. The time is one more variable, through one
step of RK4 an interval, which for this motion is the exponential's series to order 4. The states
are variables, and a force is the difference of two positive ones. IPOPT starts from the last plan,
moved on by a period, and from its multipliers: with its own options for a warm start, with a
barrier so low that it hardly leaves that guess, and with a loose tolerance. `--disturbed` flies
with the paper's disturbance, so that the state differs from what the last plan predicted. CasADi
comes with the extra `bench`. `--gravity table` gives all sides the field from its table.

    python benchmarks/mpc_step.py [--transit 0] [--seed 10001] [--disturbed] [--gravity table]
"""

import argparse
import dataclasses
import os
import time
from collections import defaultdict
from collections.abc import Callable

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[name] = "1"

import numpy as np
from _kept import keep
from _tables import Shown

from proxops.diagrams.flight import fly, make_mpc
from proxops.diagrams.scenario import load_body, load_scenario
from proxops.systems.expert import KEEP_OUT_PRICE, SLACK_PRICE, Plan, TransitProgram
from proxops.systems.shapes import tangent_half_spaces

PAPER_MPC_S = 0.473
# Of this process, so that on a machine that does other things too the comparison stands.
CLOCK = time.process_time
_PUSHES = [f"warm_start_{name}_push" for name in ("bound", "slack_bound", "mult_bound")]
LOW_BARRIER = dict.fromkeys(_PUSHES, 1e-8)
# Clarabel's tolerance is 1e-8 too.
SETTINGS = {
    "IPOPT, its own options": {"tol": 1e-8},
    "IPOPT, low barrier": {"tol": 1e-8, "mu_init": 1e-8, **LOW_BARRIER},
    "IPOPT, to 1e-4 only": {"tol": 1e-4, "mu_init": 1e-6, **LOW_BARRIER},
}


class Parts:
    """Stands in for the solver and the field of a `TransitProgram` and notes their times.

    `iterations` are of all solves since it was last set to 0.
    """

    def __init__(self, program: TransitProgram):
        transit = program.transit
        self.solver, self.field = transit.solver, transit.field
        self.times, self.iterations = defaultdict(list), 0
        linearise = self.timed("linearise", transit.linearise)
        transit.solver, transit.field, transit.linearise = self, self, linearise
        self.evaluate = self.timed("gravity", self.field.evaluate)

    def timed(self, name: str, call: Callable) -> Callable:
        def run(*arguments):
            started = CLOCK()
            result = call(*arguments)
            self.times[name].append(CLOCK() - started)
            return result

        return run

    def Solve(self, *arguments):  # noqa: N802
        result = self.timed("solve", self.solver.Solve)(*arguments)
        self.iterations += result.get_solver_details().iterations
        return result


class CasadiProgram:
    """The expert's program with the time free, as one nonlinear program."""

    def __init__(self, program: TransitProgram, settings: dict[str, float]):
        # With the extra `bench`; `--help` works without it.
        import casadi

        self.program, self.field = program, program.field
        n = program.horizon.intervals
        self.units = program.transit.units
        sx, limits = casadi.SX, program.limits
        x, u, total = sx.sym("x", 6, n + 1), sx.sym("u", 6, n), sx.sym("T")
        out, fast, miss = sx.sym("out", n), sx.sym("fast", n), sx.sym("miss", 6)
        state, target = sx.sym("state", 6), sx.sym("target", 6)
        fuel, last_total = sx.sym("fuel"), sx.sym("last_total")
        gradient, constant = sx.sym("gradient", 9, n), sx.sym("constant", 3, n)
        normals, offsets = sx.sym("normals", 3, n), sx.sym("offsets", n)
        self.scale = program.horizon.minimum
        shares = np.diff(program.horizon.fractions())
        w, speed = program.spin, self.units[3]
        push = limits.thrust / limits.mass / speed

        def rates(y, k):
            matrix = casadi.reshape(gradient[:, k], 3, 3)
            turn = casadi.vertcat(2.0 * w * y[4], -2.0 * w * y[3], 0.0)
            pull = matrix @ y[:3] + constant[:, k] + turn + push * (u[:3, k] - u[3:, k])
            return casadi.vertcat(y[3:] * (speed / self.units[0]), pull)

        equal, above, effort = [x[:, 0] - state], [], 0.0
        for k in range(n):
            h, y = total * self.scale * shares[k], x[:, k]
            k1 = rates(y, k)
            k2 = rates(y + h / 2.0 * k1, k)
            k3 = rates(y + h / 2.0 * k2, k)
            mean = (k1 + 2.0 * k2 + 2.0 * k3 + rates(y + h * k3, k)) / 6.0
            equal.append(y + h * mean - x[:, k + 1])
            effort += shares[k] * (casadi.sumsqr(u[:, k]) + fuel * casadi.sum1(u[:, k]))
            room = limits.speed / speed + fast[k]
            above += [room - x[3:, k + 1], room + x[3:, k + 1]]
            above.append(casadi.dot(normals[:, k], x[:3, k + 1]) + out[k] - offsets[k])
        above += [x[:, n] - target + miss, target - x[:, n] + miss]
        # The expert's cost is over its last plan's T, a constant.
        cost = total / last_total * (program.time_price + effort)
        cost += KEEP_OUT_PRICE * casadi.sum1(out)
        cost += SLACK_PRICE * (casadi.sum1(fast) + casadi.sum1(miss))
        variables = casadi.veccat(x, u, total, out, fast, miss)
        known = [state, target, fuel, last_total, gradient, constant, normals, offsets]
        equal, above = casadi.vertcat(*equal), casadi.vertcat(*above)
        least, most = np.zeros(variables.numel()), np.full(variables.numel(), np.inf)
        least[: x.numel()], most[x.numel() :][: u.numel()] = -np.inf, 1.0
        least[x.numel() + u.numel()] = 1.0  # T over its minimum.
        self.bounds = {"lbx": least, "ubx": most, "lbg": np.zeros(equal.numel() + above.numel())}
        self.bounds["ubg"] = np.repeat([0.0, np.inf], [equal.numel(), above.numel()])
        options = {"print_level": 0, "sb": "yes", "warm_start_init_point": "yes", **settings}
        options = {f"ipopt.{name}": value for name, value in options.items()}
        options["print_time"] = False
        problem = {"x": variables, "f": cost, "g": casadi.vertcat(equal, above)}
        problem["p"] = casadi.veccat(*known)
        self.solver = casadi.nlpsol("solver", "ipopt", problem, options)
        self.multipliers: dict[str, np.ndarray] = {}

    def solve(self, state: np.ndarray, target: np.ndarray, last: Plan, age: float) -> Plan:
        """The plan from `state` (6,) to `target` (6,), from a plan made `age` s ago."""
        program, units = self.program, self.units
        n = program.horizon.intervals
        duration = max(last.times[-1] - age, self.scale)
        fractions = program.horizon.fractions()
        times = age + duration * fractions
        states = last.states_at(times)
        controls = last.forces_at(0.5 * (times[1:] + times[:-1])) / program.limits.thrust
        middle = 0.5 * (states[1:, :3] + states[:-1, :3])
        gravity = self.field.evaluate(middle)
        constant = gravity.acceleration - np.einsum("nij,nj->ni", gravity.gradient, middle)
        gradient = gravity.gradient.copy()
        gradient[:, [0, 1], [0, 1]] += program.spin**2
        normals, offsets = tangent_half_spaces(program.limits.keep_out_semi_axes, states[1:, :3])
        weights = [program.fuel_weight(duration), duration / self.scale]
        pull = (gradient * (units[0] / units[3])).ravel(), (constant / units[3]).ravel()
        parameters = state / units, target / units, weights, *pull, normals.ravel()
        parameters = np.concatenate([*parameters, offsets / units[0]])
        u = np.hstack([np.maximum(controls, 0.0), np.maximum(-controls, 0.0)])
        knots, slack = (states / units).ravel(), np.zeros(2 * n + 6)
        guess = np.concatenate([knots, u.ravel(), [duration / self.scale], slack])
        found = self.solver(x0=guess, p=parameters, **self.bounds, **self.multipliers)
        self.multipliers = {"lam_x0": found["lam_x"], "lam_g0": found["lam_g"]}
        values = np.asarray(found["x"])[:, 0]
        u = values[6 * (n + 1) : 6 * (2 * n + 1)].reshape(n, 6)
        stats = self.solver.stats()
        return dataclasses.replace(
            last,
            times=values[6 * (2 * n + 1)] * self.scale * fractions,
            states=values[: 6 * (n + 1)].reshape(n + 1, 6) * units,
            forces=(u[:, :3] - u[:, 3:]) * program.limits.thrust,
            status=0 if stats["success"] else 1,
            iterations=stats["iter_count"],
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--transit", type=int, default=0)
    parser.add_argument("--seed", type=int, default=10001)
    parser.add_argument("--disturbed", action="store_true")
    parser.add_argument("--gravity", choices=("exact", "table"), default="exact")
    asked = parser.parse_args()
    overrides: dict = {"transit.seed": asked.seed, "transit.index": asked.transit}
    if asked.disturbed:
        overrides["disturbance.max_relative_magnitude"] = 2.0
    overrides["gravity"] = asked.gravity
    scenario = load_scenario(None, overrides, on_true_state=True)
    body = load_body(scenario.body).with_gravity(scenario.gravity)
    flight = fly(scenario, body=body).dataset
    controller = make_mpc(scenario, body)
    program, period = controller.program, controller.period
    target = flight["target"].values[0]
    states = flight["state"].values[:-1]  # The last is the flight's end, off the steps.
    first = program.solve(states[0], target, None, 0.0, controller.cold_iterations)
    peers = [CasadiProgram(program, settings) for settings in SETTINGS.values()]
    plans = [first, *(peer.solve(states[0], target, first, 0.0) for peer in peers)]
    parts = Parts(program)
    solvers = [program.solve, *(peer.solve for peer in peers)]
    times, iterations, apart = np.full((3, len(states) - 1, len(plans)), np.nan)
    for step, state in enumerate(states[1:]):
        for i, solve in enumerate(solvers):
            started = CLOCK()
            plan = solve(state, target, plans[i], period)
            times[step, i] = CLOCK() - started
            plans[i] = plan
            iterations[step, i] = parts.iterations if i == 0 else plan.iterations
            parts.iterations = 0
            if plan.status:  # Failed: anew, from our plan.
                plans[i], peers[i - 1].multipliers = plans[0], {}
            else:
                apart[step, i] = np.abs(plan.forces[0] - plans[0].forces[0]).max()
    report(times, iterations, apart, "" if asked.gravity == "exact" else ", gravity: table")
    report_parts(parts, float(np.median(times[:, 0])))


def report(times: np.ndarray, iterations: np.ndarray, apart: np.ndarray, where: str) -> None:
    medians, p99 = 1e3 * np.median(times, axis=0), 1e3 * np.percentile(times, 99, axis=0)
    lines = {
        name: [
            f"{medians[i]:.2f}", f"{p99[i]:.2f}", f"{medians[i] / medians[0]:.1f} x",
            f"{np.median(iterations[:, i]):.0f}", str(np.isnan(apart[:, i]).sum()),
            f"{np.nanmedian(apart[:, i]):.3f}, max {np.nanmax(apart[:, i]):.2f}",
        ]
        for i, name in enumerate(["ours", *SETTINGS])
    }  # fmt: skip
    ratio = f"{1e3 * PAPER_MPC_S / medians[0]:.0f} x"
    lines["the paper's"] = [f"{1e3 * PAPER_MPC_S:.0f}", "", ratio]
    keep(
        {
            f"an MPC step{where}, median (ms)": medians[0],
            f"an MPC step{where}, 99th percentile (ms)": p99[0],
            f"an MPC step{where}: CasADi with IPOPT, its own options, over ours": medians[1]
            / medians[0],
            f"an MPC step{where}: the same, tuned by hand, over ours": medians[2] / medians[0],
        }
    )
    headings = "median (ms)", "p99 (ms)", "over ours", "iterations", "failed", "apart (N)"
    Shown(f"{len(times)} control steps, one thread{where}", headings, lines).show()
    print("apart: first force of the plan, the axis that differs most")


def report_parts(parts: Parts, ours: float) -> None:
    medians = {name: float(np.median(times)) for name, times in parts.times.items()}
    gravity, linearise, solve = (medians[name] for name in ("gravity", "linearise", "solve"))
    parts_of_step = {
        "gravity and its gradient": gravity,
        "linearisation and update of the program": linearise - gravity,
        "Clarabel, with Drake's translation": solve,
        "shift, bounds, extraction": ours - linearise - solve,
    }
    lines = {
        name: [f"{1e3 * seconds:.2f}", f"{100.0 * seconds / ours:.0f} %"]
        for name, seconds in parts_of_step.items()
    }
    Shown("where our time goes (medians)", ("ms", "share"), lines).show()


if __name__ == "__main__":
    main()
