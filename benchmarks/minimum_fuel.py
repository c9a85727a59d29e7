"""Shows how far the expert (MPC) is from the least fuel: its Δv over that of an optimum.

The MPC flies each transit of the set. A nonlinear program over the whole flight then goes from the
same start to the state that the flight had at its arrival, in the time that our expert takes, at
the least integral of |F|_1 / m. Its force is constant over each of many equal intervals. It uses
Hermite-Simpson defects through the polyhedron's field with analytic Jacobians, the spacecraft's
limits of thrust and speed, and the keep-out ellipsoid itself, without the expert's margin, at the
knots and halfway between. It shares only the field with the expert.

SNOPT solves it from the flight and from three polynomials that know nothing of the flight, bent
outwards and to both sides; the lowest optimum counts. Each optimum is checked without the program:
DOP853 integrates its forces again through the true field, which gives the error at the end, the
greatest speed and the least clearance between the knots.

The same transits flown with the paper's weighted cost, with the weights of `--weights` (by default
those of the default scenario), stand beside it. These flights take their own time, so their Δv over
the least "in the time that our expert takes" says what that cost spends, not how far it is from its
own optimum.

    python benchmarks/minimum_fuel.py [--transits 50] [--seed 10001] [--intervals 120]
        [--weights KEY=VALUE ...] [--workers N] [--out out/minimum-fuel] [--plot gap.png]

With `--touch` it is the descents and returns of a touch-and-go at Bennu, on navigation in drawn
worlds, against linear programs with the spacecraft's own thrusters (`_touch_fuel`):

    python benchmarks/minimum_fuel.py --touch [--transits 50] [--seed 10001]
"""

import argparse
import os
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

if __name__ == "__main__":  # A notebook imports this; there numba's threads may be running.
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ[name] = "1"

import matplotlib

matplotlib.use("Agg")

import _touch_fuel
import matplotlib.pyplot as plt
import numpy as np
from _campaign import campaign_parser, logs_with_bar
from _tables import Shown, write_markdown
from pydrake.autodiffutils import ExtractGradient, ExtractValue, InitializeAutoDiff
from pydrake.solvers import MathematicalProgram, SnoptSolver, SolverOptions
from scipy.integrate import solve_ivp

from proxops.diagrams.logs import FlightLog
from proxops.diagrams.scenario import Body, Scenario, is_blocked, load_body, load_scenario
from proxops.studies.campaigns import Variant
from proxops.systems.shapes import clearances

UNITS = np.repeat([1e4, 10.0], 3)
# What the independent integration may find: error of the end (m, m/s), depth in the keep-out
# ellipsoid (m), speed above the limit (m/s).
END_TOLERANCE, DEPTH_TOLERANCE, SPEED_TOLERANCE = np.array([20.0, 0.02]), 10.0, 0.05
TOLERANCES = {"Major feasibility tolerance": 1e-7, "Major optimality tolerance": 1e-4}
LIMITS = {"Major iterations limit": 500, "Iterations limit": 200_000, "Superbasics limit": 2_000}
# Optima from different guesses that are this close are one.
SAME = 0.01


@dataclass
class Optimum:
    """What the solver found and what flying it again found."""

    delta_v: float  # m/s
    end_error: np.ndarray  # (2,) in m and m/s, by DOP853
    clearance: float  # m, least along the path that DOP853 finds
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
        eye, jacobian = np.eye(6), np.zeros((7, 18))
        middle_by = np.hstack([0.5 * eye + h / 8.0 * a0, 0.5 * eye - h / 8.0 * a1])
        jacobian[:6, :12] = np.hstack([eye + h / 6.0 * a0, -eye + h / 6.0 * a1])
        jacobian[:6, :12] += 4.0 * h / 6.0 * a2 @ middle_by
        jacobian[6, :12] = 2.0 * middle[:3] / axes**2 @ middle_by[:3]
        jacobian[:, :12] *= np.tile(UNITS, 2)
        jacobian[:6, :12] /= UNITS[:, None]
        jacobian[3:6, 12:] = h * self.push / UNITS[3] * np.hstack([np.eye(3), -np.eye(3)])
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
        level = np.diag(2.0 * (UNITS[:3] / self.body.keep_out_semi_axes) ** 2)
        bounds = np.append(np.zeros(6), 1.0), np.append(np.zeros(6), np.inf)
        for k in range(n):
            both = np.concatenate([x[k], x[k + 1], up[k], down[k]])
            program.AddConstraint(lambda v: self.interval(v, h), *bounds, both)
            if k:
                program.AddQuadraticConstraint(level, np.zeros(3), 1.0, np.inf, x[k, :3])
        for force in (up, down):
            program.AddBoundingBoxConstraint(0.0, 1.0, force)
            program.AddLinearCost(np.full(3 * n, h * self.push / UNITS[3]), 0.0, force.ravel())
        program.SetInitialGuess(x, states / UNITS)
        program.SetInitialGuess(up, np.clip(controls, 0.0, 1.0))
        program.SetInitialGuess(down, np.clip(-controls, 0.0, 1.0))
        options = SolverOptions()
        for key, value in {**TOLERANCES, **LIMITS}.items():
            options.SetOption(SnoptSolver.id(), key, value)
        result = SnoptSolver().Solve(program, None, options)
        controls = result.GetSolution(up) - result.GetSolution(down)
        seconds = time.perf_counter() - started
        return self.check(start, end, controls, h, result.is_success(), seconds)

    def check(self, start, end, controls, h: float, success: bool, seconds: float) -> Optimum:
        """Flies the controls (N, 3) again from the start, by another integrator."""
        state, path = start, [start[None]]
        for control in controls:
            flown = solve_ivp(
                lambda _, y, u=control: self.rates(y[None], u)[0][0],
                (0.0, h), state, "DOP853", np.linspace(0.0, h, 5), rtol=1e-9, atol=1e-6,
            )  # fmt: skip
            state = flown.y[:, -1]
            path.append(flown.y.T[1:])
        path, error = np.concatenate(path), (state - end).reshape(2, 3)
        end_error = np.linalg.norm(error, axis=1)
        clearance = float(clearances(self.body.keep_out_semi_axes, path[:, :3]).min())
        too_fast = float(np.abs(path[:, 3:]).max()) - self.craft.speed_limit_m_s
        good = success and clearance >= -DEPTH_TOLERANCE and too_fast <= SPEED_TOLERANCE
        good = good and bool((end_error <= END_TOLERANCE).all())
        delta_v = float(np.sum(np.abs(controls)) * h * self.push)
        return Optimum(delta_v, end_error, clearance, good, seconds)

    def bent_guesses(self, start, end, duration: float) -> list[np.ndarray]:
        """States (N + 1, 6) from rest to rest, bent round the ellipsoid out, left and right."""
        share = np.linspace(0.0, 1.0, self.intervals + 1)[:, None]
        line = start[:3] + (3.0 * share**2 - 2.0 * share**3) * (end[:3] - start[:3])
        along = (end[:3] - start[:3]) / np.linalg.norm(end[:3] - start[:3])
        out = line[len(line) // 2] - along * (along @ line[len(line) // 2])
        left, guesses = np.cross(along, out), []
        for way in (out, left, -left):
            bend = np.sin(np.pi * share) ** 2 * way / np.linalg.norm(way)
            for amount in np.arange(0.0, 200e3, 5e3):
                path = line + amount * bend
                if (np.sum((path / self.body.keep_out_semi_axes) ** 2, axis=1) >= 1.0).all():
                    break
            guesses.append(np.hstack([path, np.gradient(path, duration / self.intervals, axis=0)]))
        return guesses


def optima(scenario: Scenario, body: Body, log: FlightLog, intervals: int) -> list[Optimum]:
    """What each guess led to, that of the flight first."""
    columns = {name: log.dataset[name].values for name in ("time", "state", "force")}

    def at(times: np.ndarray, name: str) -> np.ndarray:
        values = columns[name].T
        return np.stack([np.interp(times, columns["time"], value) for value in values], axis=1)

    duration = log.summary["arrival_time_s"]
    times = np.linspace(0.0, duration, intervals + 1)
    states = at(times, "state")
    controls = at(0.5 * (times[1:] + times[:-1]), "force") / scenario.spacecraft.thrust_limit_n
    program = MinimumFuel(scenario, body, intervals)
    ends = states[0], states[-1], duration
    bent = [(guess, np.zeros_like(controls)) for guess in program.bent_guesses(*ends)]
    return [program.solve(*ends, *guess) for guess in [(states, controls), *bent]]


def weighted_text(summary: dict) -> str:
    """Δv and time of a flight with the weighted cost, or how far off it ended."""
    if summary["arrival_time_s"] is None:
        return f"no arrival, {summary['terminal_position_error_m']:.0f} m off"
    return f"{summary['delta_v_m_s']:.1f} in {summary['arrival_time_s']:.0f} s"


def plot_gaps(gaps: dict[int, float], weighted: dict[int, float], path: Path) -> None:
    """Bars in groups, one a transit; `weighted` holds those that arrived."""
    figure, axes = plt.subplots(figsize=(9.0, 4.0), layout="constrained")
    for blocked, label in enumerate(("straight line free", "straight line blocked")):
        chosen = [index for index in gaps if is_blocked(index) == blocked]
        heights = [gaps[index] - 1.0 for index in chosen]
        axes.bar(np.array(chosen) - 0.2, heights, 0.4, bottom=1.0, label=label)
    heights = [ratio - 1.0 for ratio in weighted.values()]
    others, look = np.array(list(weighted)) + 0.2, {"color": "0.7", "label": "weighted cost"}
    axes.bar(others, heights, 0.4, bottom=1.0, **look)
    axes.axhline(float(np.mean(list(gaps.values()))), color="black", lw=1.0, label="mean")
    axes.xaxis.get_major_locator().set_params(integer=True)
    axes.set(xlabel="transit", ylabel="Δv flown / least Δv in our time")
    axes.legend(ncols=4, loc="upper center", bbox_to_anchor=(0.5, 1.12), frameon=False)
    figure.savefig(path, dpi=150)


EXPERT, WEIGHTED = "time_and_fuel", "weighted"
HEADINGS = (
    "time s", "flown m/s", "least m/s", "gap", "optima", "same", "spread", "end m",
    "clear km", "solve s", "weighted m/s",
)  # fmt: skip


def table_line(log: FlightLog, tried: list[Optimum], weighted: dict) -> list[str]:
    """The line of the transit; `tried` is not empty if the flight arrived."""
    found = sorted((o for o in tried if o.converged), key=lambda o: o.delta_v)
    if not found:
        return ["no optimum" if tried else "no arrival"]
    best, flown = found[0], log.summary["delta_v_m_s"]
    same = [o.delta_v / best.delta_v for o in found if o.delta_v < (1.0 + SAME) * best.delta_v]
    return [
        f"{log.summary['arrival_time_s']:.0f}", f"{flown:.1f}",
        f"{best.delta_v:.2f}", f"{flown / best.delta_v:.3f}", f"{len(found)}/{len(tried)}",
        str(len(same)), f"{100.0 * (same[-1] - 1.0):.2f} %", f"{best.end_error[0]:.2f}",
        f"{best.clearance / 1e3:.3f}", f"{np.median([o.seconds for o in tried]):.1f}",
        weighted_text(weighted),
    ]  # fmt: skip


def print_ratios(label: str, ratios: Mapping[int, float], transits: int) -> None:
    values = np.array(list(ratios.values()) or [np.nan])
    print(
        f"{label}, {len(ratios)} of {transits} transits: Δv over the least in the time that our "
        f"expert takes: mean {values.mean():.3f}, max {values.max():.3f}"
    )


def show_touches(asked: argparse.Namespace) -> None:
    changes = {"log_ranges": False, "dispersions": "touch_and_go"}
    scenario = load_scenario("bennu_touch_and_go", changes)
    logs = logs_with_bar([Variant("touch", "mpc")], scenario, asked)["touch"]
    found = {index: _touch_fuel.table_line(log) for index, log in logs.items()}
    lines = {str(index): line for index, (line, _) in found.items()}
    table = Shown(f"touch-and-goes of seed {asked.seed}", _touch_fuel.HEADINGS, lines)
    table.show()
    write_markdown([table], asked.markdown)
    gaps = np.array([gap for _, gap in found.values() if gap is not None] or [np.nan])
    print(f"Δv over the least: mean {gaps.mean():.3f}, max {gaps.max():.3f}")


def main() -> None:
    parser = campaign_parser(__doc__, "out/minimum-fuel", transits=50, seed=10001)
    parser.add_argument("--intervals", type=int, default=120, help="of the program")
    parser.add_argument(
        "--weights", nargs="*", default=[], metavar="KEY=VALUE",
        help="of the weighted cost, keys as in the scenario's mpc.weighted",
    )  # fmt: skip
    parser.add_argument("--touch", action="store_true", help="descents and returns at Bennu")
    parser.add_argument("--plot", type=Path, help="also draw the gaps there")
    asked = parser.parse_args()
    if asked.touch:
        show_touches(asked)
        return
    weights = dict(text.split("=", 1) for text in asked.weights)
    changes = {f"mpc.weighted.{key}": float(value) for key, value in weights.items()}
    scenario = load_scenario(None, {"log_ranges": False, **changes}, on_true_state=True)
    body = load_body(scenario.body)
    variants = [Variant(EXPERT, "mpc"), Variant(WEIGHTED, "mpc", {"mpc.cost": "weighted"})]
    logs = logs_with_bar(variants, scenario, asked)
    lines: dict[str, list[str]] = {}
    gaps: dict[int, float] = {}
    weighted_gaps: dict[int, float] = {}
    for index, log in logs[EXPERT].items():
        weighted = logs[WEIGHTED][index].summary
        tried = optima(scenario, body, log, asked.intervals) if log.summary["success"] else []
        lines[str(index)] = table_line(log, tried, weighted)
        least = min((o.delta_v for o in tried if o.converged), default=None)
        if least is not None:
            gaps[index] = log.summary["delta_v_m_s"] / least
            if weighted["arrival_time_s"] is not None:
                weighted_gaps[index] = weighted["delta_v_m_s"] / least
    table = Shown(f"transits of seed {asked.seed}, {asked.intervals} intervals", HEADINGS, lines)
    table.show()
    write_markdown([table], asked.markdown)
    print("optima: of all guesses; same: within 1 % of the least; spread: theirs")
    print_ratios("the expert", gaps, asked.transits)
    used = ", ".join(f"{key} {value:g}" for key, value in asdict(scenario.mpc.weighted).items())
    print_ratios(f"the weighted cost ({used})", weighted_gaps, asked.transits)
    if asked.plot and gaps:
        plot_gaps(gaps, weighted_gaps, asked.plot)


if __name__ == "__main__":
    main()
