"""The report of the paper's reproduction: each figure and number of the paper beside ours."""

from __future__ import annotations

import dataclasses as dc
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cached_property
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from proxops.diagrams.logs import FlightLog, length_text, outcome
from proxops.diagrams.meshcat import paths_page
from proxops.diagrams.scenario import Body, Scenario, TrueStateConfig
from proxops.studies.campaigns import Stage
from proxops.studies.figures import EXPERT, Results
from proxops.studies.report import Looks, controller_looks, success_text
from proxops.studies.reproduction import costs as paper
from proxops.studies.reproduction import paper_flights as flights
from proxops.studies.reproduction.paper_plots import (
    path_errors,
    plot_curves,
    plot_effort,
    plot_gates,
    plot_path_errors,
    plot_views,
    read_curves,
)
from proxops.training.reports import (
    DASH,
    Block,
    Page,
    Picture,
    Section,
    Table,
    Text,
    force_figures,
    interval_text,
    number_text,
    picture,
    plot_forces,
    plot_frames,
)

STAGE_NAMES = {
    "lidar": "the learned lidar",
    "data-paper": "the paper's 400 flights",
    "policy-paper": "the policy by the paper's recipe",
    "data-full": "our flights",
    "policy-pilot": "our policy from them",
    "policy-dagger": "its rounds of DAgger",
}
_NOT_RUN = "not run"


@dc.dataclass(frozen=True)
class Findings:
    """Everything that the report is made from."""

    command: str
    scenario: Scenario
    body: Body
    seed: int
    transit: int
    """Number of the transit that is drawn."""
    stages: Sequence[Stage]
    trained: Mapping[str, Stage]
    missing: Sequence[str]
    """Stages of training without a result, from this run or an earlier one."""
    policy_sha256: str
    results: Results
    logs: Mapping[str, Mapping[int, FlightLog]]
    """Logs of the flights that are drawn, by variant and transit."""
    forces: Mapping[str, tuple[np.ndarray, np.ndarray]]
    """For each policy, forces along the MPC's flights: the MPC's and the policy's, (N, 3) in N."""
    efforts: Mapping[str, np.ndarray]
    """For each hybrid that is drawn, the MPC's command (N, 3) in N at the states of its flight."""

    @property
    def drawn(self) -> dict[str, FlightLog]:
        """The logs of the transit that is drawn, by variant."""
        return {
            name: self.logs[name][self.transit]
            for name in flights.DRAWN_VARIANTS
            if name in self.logs
        }

    @cached_property
    def costs(self) -> dict[str, paper.Costs]:
        """The costs of each variant."""
        return {name: paper.costs(self.results, name) for name in self.results}

    @cached_property
    def comparison(self) -> list[list[str]]:
        """A line for each number of the paper: its name, the paper's value, and ours."""
        return _comparison_lines(self)

    @property
    def path_errors_m(self) -> dict[str, dict[str, float]]:
        """Figures of the distance in m from the MPC's position at the same time, by variant."""
        errors = {
            name: path_errors(self.drawn[EXPERT], log)[1]
            for name, log in self.drawn.items()
            if name != EXPERT
        }
        return {
            name: {
                "median": float(np.median(each)),
                "greatest": float(each.max()),
                "end": float(each[-1]),
            }
            for name, each in errors.items()
        }

    @property
    def efforts_n(self) -> dict[str, dict[str, float]]:
        """Figures of the difference in N from the MPC's command along the hybrids' own flights."""
        figures = {}
        for name, expert in self.efforts.items():
            force = self.drawn[name].dataset["force"].values[:-1]
            sizes = np.linalg.norm(force - expert, axis=1)
            sizes = sizes[np.isfinite(sizes)]
            if sizes.size:
                figures[name] = {
                    "median": float(np.median(sizes)),
                    "p95": float(np.percentile(sizes, 95)),
                    "within_1_n": float(np.mean(sizes < 1.0)),
                }
        return figures


def paper_sections(findings: Findings) -> list[Section]:
    """Makes the report, which `write_report` writes."""
    looks = controller_looks(list(findings.drawn))
    return [
        Section("What was run", _head(findings)),
        Section("The paper's numbers, and ours", _comparison(findings)),
        Section("The controllers on the same transits", _controllers(findings)),
        Section("Gates compared", _gates(findings)),
        Section("Time and energy of a step", _costs(findings)),
        Section("Figure 1: what the lidar sees", [_frame(findings)]),
        Section("Figures 2 and 3: data, and frames generated for it", _frames(findings)),
        Section("Figure 4: training", _curves(findings)),
        Section("Figure 5: paths", _paths(findings, looks)),
        Section("Figure 6: the policy's force against the MPC's", _histograms(findings)),
        Section("Figure 7: position error against the MPC's path", _errors(findings, looks)),
        Section("Figure 8: control effort against the MPC's", _efforts(findings)),
    ]


def findings_json(findings: Findings) -> dict[str, Any]:
    """Makes the content of report.json; the flights' rows are in the record of their stage."""
    limit = findings.scenario.spacecraft.thrust_limit_n
    return {
        "proxops_version": metadata.version("proxops"),
        "command": findings.command,
        "seed": findings.seed,
        "policy_sha256": findings.policy_sha256,
        "stages": [
            {
                "name": stage.name,
                "folder": stage.folder.name,
                "wall_s": stage.wall_s,
                "skipped": stage.skipped,
            }
            for stage in findings.stages
        ],
        "not_run": list(findings.missing),
        "paper_and_ours": [
            {"what": what, "paper": theirs, "ours": ours}
            for what, theirs, ours in findings.comparison
        ],
        "controllers": {
            name: result.figures
            | {
                "checks_passed": paper.checks_passed(result),
                "flights_that_lost_the_body": paper.blind_flights(result),
                "costs": dc.asdict(findings.costs[name]),
            }
            for name, result in findings.results.items()
        },
        "forces_along_the_mpc": {
            name: force_figures(*forces, limit) for name, forces in findings.forces.items()
        },
        "forces_on_the_test_part": {
            name: stage.result["parts"]["test"]
            for name, stage in findings.trained.items()
            if "parts" in stage.result
        },
        "path_errors_m": findings.path_errors_m,
        "efforts_n": findings.efforts_n,
    }


# --- tables ---------------------------------------------------------------------------------------


def _head(findings: Findings) -> list[Block]:
    count = findings.results[EXPERT].transits
    blocks: list[Block] = [
        Text(findings.command, code=True),
        Text(
            f"{findings.body.config.name}, proxops {metadata.version('proxops')}. Each controller "
            f"flies the same {count} transits of seed {findings.seed}, which nothing was trained "
            f"on. {success_text(findings.scenario)}; intervals are exact ones, of 95 %."
        ),
        stage_table(findings.stages),
    ]
    if findings.missing:
        names = ", ".join(STAGE_NAMES[name] for name in findings.missing)
        blocks.append(
            Text(
                f"Not run, now or earlier: {names}. Figures that "
                "need them are missing below or marked so. Without --quick all stages are run."
            )
        )
    return blocks


def stage_table(stages: Sequence[Stage]) -> Table:
    """Makes the table of the stages: their folders, wall times, and which version ran them when."""

    def run(stage: Stage) -> str:
        if stage.version != metadata.version("proxops"):
            return f"before, by proxops {stage.version}"
        return "before" if stage.skipped else "now"

    lines = [[each.name, each.folder.name, f"{each.wall_s:.0f}", run(each)] for each in stages]
    return Table(["stage", "folder", "wall time (s)", "run"], lines)


def _comparison(findings: Findings) -> list[Block]:
    return [
        Table(["", "paper", "ours"], findings.comparison),
        Text(
            "Times were measured on this machine with several flights at once; compare them with "
            "each other rather than with the paper's. The paper's 21.6 % is 0.053 s × 300 W over "
            "0.473 s × 155 W, for one step of a policy that flies alone. A hybrid runs the policy "
            "at every step and the MPC at some, so its gain is 1 / ((1 − saved) + policy time / "
            "MPC time). Our policy and our MPC run on the same CPU, so TDP cancels."
        ),
    ]


def _comparison_lines(findings: Findings) -> list[list[str]]:
    results, scenario = findings.results, findings.scenario
    mpc_s, policy_s = findings.costs[EXPERT].mpc_s, findings.costs[flights.POLICY].policy_s
    assert mpc_s is not None
    assert policy_s is not None
    energy = paper.energy_share(policy_s, paper.CPU_W, mpc_s, paper.CPU_W)
    data = findings.trained.get("data-paper")
    kinds = {} if data is None else data.result["kinds"]
    lines = [
        ["transits collected", "about 400",
         _NOT_RUN if data is None else str(data.result["all"]["flights"])],
        ["of them as the MPC flies", "100", str(kinds.get("nominal", _NOT_RUN))],
        ["of them disturbed", "about 300", str(kinds.get("random_walk", _NOT_RUN))],
        ["a frame, rays × planes", "360 × 12", f"{scenario.lidar.rays} × {scenario.lidar.planes}"],
        ["no return, to the paper's network", "-100", "-100"],
        ["cube of positions (km)", "340", f"{scenario.transit.cube_m / 1e3:g}"],
        ["training, validation, test (%)", "60, 20, 20", "60, 20, 20"],
        ["thrust per axis (N)", "7", f"{scenario.spacecraft.thrust_limit_n:g}"],
        ["check of the fixed hybrid, 1 step in", "10", str(scenario.hybrid.check_period)],
        ["MPC, a step, median (s)", f"{paper.MPC_S}", f"{mpc_s:.5f}"],
        ["policy, a step, GPU (s)", f"{paper.POLICY_GPU_S}", "runs on the CPU"],
        ["policy, a step, CPU, median (s)", f"{paper.POLICY_CPU_S}", f"{policy_s:.5f}"],
        ["MPC over policy, CPU", f"{paper.MPC_S / paper.POLICY_CPU_S:.1f}",
         f"{mpc_s / policy_s:.1f}"],
        ["energy of a step, policy on GPU / MPC (%)", f"{100 * paper.PAPER_ENERGY_GPU:.1f}",
         "runs on the CPU"],
        ["energy of a step, policy on CPU / MPC (%)", f"{100 * paper.PAPER_ENERGY_CPU:.1f}",
         f"{100 * energy:.1f}"],
        ["pure policy, paper's recipe", "does not arrive, may crash",
         _success(results, flights.PAPER_POLICY)],
        ["pure policy, ours", DASH, _success(results, flights.POLICY)],
        ["its flights that lose the body from lidar range", "the one shown",
         _lost(results, flights.PAPER_POLICY)],
        ["the same, ours", DASH, _lost(results, flights.POLICY)],
    ]  # fmt: skip
    share = f"up to {100 * paper.POLICY_SHARE:.0f}"
    for name in (flights.PAPER_HYBRID, flights.PAPER_GATE, flights.STRICT, flights.ADAPTIVE):
        told = "arrives" if name == flights.PAPER_HYBRID else DASH
        lines += [
            [f"{name}: success", told, _success(results, name)],
            [f"{name}: flown by the policy (%)", share, _share(results, name, "policy_share")],
            [f"{name}: before arrival (%)", DASH,
             _share(results, name, "policy_share_to_arrival")],
        ]  # fmt: skip
    for name in (flights.ZERO_PAPER, flights.ZERO_STRICT, flights.ZERO_ADAPTIVE):
        lines.append([f"{name}: flown by it (%)", DASH, _share(results, name, "policy_share")])
    gains = (
        (paper.gain(paper.POLICY_SHARE, seconds * watts, paper.MPC_S * paper.CPU_W), name)
        for name, seconds, watts in (
            ("GPU", paper.POLICY_GPU_S, paper.GPU_W),
            ("CPU", paper.POLICY_CPU_S, paper.CPU_W),
        )
    )
    told = ", ".join(f"{value:.2f} ({name})" for value, name in gains)
    for name in (flights.PAPER_GATE, flights.STRICT, flights.ADAPTIVE):
        cost = findings.costs[name]
        lines += [
            [f"{name}: energy gained over the MPC alone, by arithmetic", told,
             number_text(cost.gain_arithmetic, ".2f")],
            [f"{name}: the same by all solves' cost", DASH, number_text(cost.gain_measured, ".2f")],
        ]  # fmt: skip
    return lines


def _success(results: Results, name: str) -> str:
    if name not in results:
        return _NOT_RUN
    result = results[name]
    crashed = f"{result.collisions} crash{'' if result.collisions == 1 else 'es'}"
    return f"{result.succeeded()} ({interval_text(result.success_rate_exact_interval)}), {crashed}"


def _lost(results: Results, name: str) -> str:
    if name not in results:
        return _NOT_RUN
    return f"{paper.blind_flights(results[name])} of {results[name].transits}"


def _share(results: Results, name: str, key: str) -> str:
    return number_text(getattr(results[name], key), ".1f", 100.0) if name in results else _NOT_RUN


def _by_name(names: Iterable[str], columns: Mapping[str, Callable[[str], str]]) -> Table:
    """A table with a line for each name, and for each column its head and what it tells of one."""
    lines = [[name, *(tell(name) for tell in columns.values())] for name in names]
    return Table(["", *columns], lines)


def _length(metres: float | None) -> str:
    return DASH if metres is None else length_text(metres)


def _controllers(findings: Findings) -> list[Block]:
    of = findings.results
    columns: dict[str, Callable[[str], str]] = {
        "success": lambda name: of[name].succeeded(),
        "exact 95 % interval": lambda name: interval_text(of[name].success_rate_exact_interval),
        "success, twice as wide": lambda name: of[name].succeeded(wide=True),
        "collisions": lambda name: str(of[name].collisions),
        "violations": lambda name: str(of[name].keep_out_violations),
        "lost": lambda name: str(paper.blind_flights(of[name])),
        "least clearance": lambda name: _length(of[name].min_clearance_m),
        "end error, median (m)": lambda name: number_text(
            of[name].terminal_position_error_m_median, ".1f"
        ),
        "Δv, median (m/s)": lambda name: number_text(of[name].delta_v_m_s_median, ".1f"),
        "Δv / MPC's": lambda name: number_text(of[name].expert_delta_v_ratio, ".3f"),
    }
    who = "The MPC, the hybrid's check, runtime assurance and PD use the "
    if isinstance(findings.scenario.navigation, TrueStateConfig):
        told = f"{who}true state (navigation: !TrueState), as the paper's do."
    else:
        told = f"{who}state that the lidar navigation makes of the frames; the paper's do not."
    return [
        _by_name(of, columns),
        Text(
            "Lost counts flights with a step at which no ray of the lidar returns. Δv / MPC's is "
            f"over the transits in which both succeed. {told} Assured means with runtime assurance "
            "between policy and thrusters; it is off in all other rows. Zero commands no force. "
            "The second PD controller uses the state that the policy estimates."
        ),
    ]


def _gates(findings: Findings) -> list[Block]:
    of, costs = findings.results, findings.costs
    # Only hybrids compare forces.
    passed = {name: paper.checks_passed(result) for name, result in of.items()}
    shown = [name for name, share in passed.items() if share is not None]
    columns: dict[str, Callable[[str], str]] = {
        "flown by the policy (%)": lambda name: _share(of, name, "policy_share"),
        "before arrival (%)": lambda name: _share(of, name, "policy_share_to_arrival"),
        "solves saved (%)": lambda name: number_text(costs[name].saved, ".1f", 100.0),
        "checks passed (%)": lambda name: number_text(passed[name], ".1f", 100.0),
        "success": lambda name: of[name].succeeded(),
        "violations": lambda name: str(of[name].keep_out_violations),
        "Δv / MPC's": lambda name: number_text(of[name].expert_delta_v_ratio, ".3f"),
    }
    points = {
        name: (
            costs[name].saved or 0.0,
            of[name].expert_delta_v_ratio or math.nan,
            of[name].min_clearance_m or math.nan,
        )
        for name in shown
    }
    caption = "Solves saved against fuel and clearance, over all transits."
    return [
        _by_name(shown, columns),
        Text(
            "Always zero is the hybrid with a policy that never thrusts. Its share is what a "
            "policy gets that has learned nothing."
        ),
        *([picture("gates", plot_gates(points), caption)] if points else []),
    ]


def _costs(findings: Findings) -> list[Block]:
    of = findings.costs
    columns: dict[str, Callable[[str], str]] = {
        "network, median (ms)": lambda name: number_text(of[name].policy_s, ".3f", 1e3),
        "a solve, mean (ms)": lambda name: number_text(of[name].solve_s, ".3f", 1e3),
        "solves saved (%)": lambda name: number_text(of[name].saved, ".1f", 100.0),
        "a step in all, mean (ms)": lambda name: number_text(of[name].step_s, ".3f", 1e3),
        f"at {paper.CPU_W:g} W (J)": lambda name: number_text(of[name].step_s, ".4f", paper.CPU_W),
        "gain, by arithmetic": lambda name: number_text(of[name].gain_arithmetic, ".2f"),
        "measured": lambda name: number_text(of[name].gain_measured, ".2f"),
    }
    return [
        _by_name((name for name, cost in of.items() if cost.step_s is not None), columns),
        Text(
            "Gain by arithmetic is 1 / ((1 − saved) + policy time / MPC time), from medians; the "
            "MPC's time is that of its own flights. Gain measured is the MPC's mean time of a step "
            "over that of the whole controller, with all solves (a solve takes longer after a "
            "pause), the network and the decisions. Energy is time times the TDP of the paper's "
            "CPU."
        ),
    ]


# --- the paper's figures --------------------------------------------------------------------------


def _frame(findings: Findings) -> Picture:
    log = findings.logs[EXPERT][findings.transit]
    positions = log.dataset["state"].values[:, :3]
    row = int(np.argmin(np.linalg.norm(positions, axis=1)))
    ranges = log.dataset["ranges"].values[row]
    planes, rays = ranges.shape
    figure = plot_frames(positions[[row]], {"as flown, with noise": ranges.reshape(1, -1)}, planes)
    caption = (
        f"A frame of {planes} planes of {rays} rays from the MPC's flight, where it is nearest to "
        "the body; dark: no return."
    )
    return picture("frame", figure, caption)


# What the report says of the lidar of the disturbed flights, by the folder of its bundle.
_SEEN_BY = {
    "bundle": " The frames of the disturbed flights come from our ray network (--lidar learned).",
    "paper_bundle": " The frames of the disturbed flights come from an MLP as the paper's "
    "(--lidar paper).",
}


def _frames(findings: Findings) -> list[Block]:
    blocks: list[Block] = []
    for name in ("data-paper", "data-full"):
        if (stage := findings.trained.get(name)) is not None:
            figures = stage.result["all"]
            kinds = ", ".join(f"{count} {kind}" for kind, count in stage.result["kinds"].items())
            blocks.append(
                Text(
                    f"{STAGE_NAMES[name]}: {figures['flights']} ({kinds}), {figures['steps']} "
                    f"steps, {figures['successes']} arrived, {figures['collisions']} collided; "
                    f"{100 * figures['zero_command_share']['all']:.0f} % of commands are zero."
                    + _SEEN_BY.get(str(stage.result.get("lidar")), "")
                )
            )
    lidar = findings.trained.get("lidar")
    if lidar is None:
        return [*blocks, Text("The lidar network was not trained in this run.")]
    lines = []
    for name, each in lidar.result["methods"].items():
        error = each["all"]["range_error_m"]
        errors = [number_text(error[key], ".0f") for key in ("median", "p95")]
        lines.append([name, f"{each['all']['mask_iou']:.4f}", *errors, f"{each['frame_ms']:.2f}"])
    head = ["", "mask IoU", "range error, median (m)", "p95 (m)", "ms a frame"]
    caption = "Frames from positions off the grid: cast, by our network, and by one as the paper's."
    return [*blocks, Table(head, lines), _file("frames", lidar.folder / "frames.png", caption)]


def _curves(findings: Findings) -> list[Block]:
    found = {name: read_curves(stage.folder) for name, stage in findings.trained.items()}
    return [
        picture(f"curves-{name}", plot_curves(curves), f"{STAGE_NAMES[name]}: loss over epochs.")
        for name, curves in found.items()
        if curves
    ] or [Text("Nothing was trained in this run.")]


def _paths(findings: Findings, looks: Looks) -> list[Block]:
    drawn = findings.drawn
    title = f"Transit {findings.transit} of seed {findings.seed}"
    colours = {name: looks[name].colour for name in drawn} | {EXPERT: "#ffffff"}
    outcomes = ", ".join(f"{name}: {outcome(log.summary)}" for name, log in drawn.items())
    caption = f"{title}; drag to turn, scroll to come nearer. {outcomes}."
    views = f"{title}, in the frame of the body; star: the goal."
    return [
        Page("paths", paths_page(drawn, colours, title), caption),
        picture("paths", plot_views(drawn, looks), views),
    ]


def _histograms(findings: Findings) -> list[Block]:
    blocks: list[Block] = []
    limit = findings.scenario.spacecraft.thrust_limit_n
    for name, stage in findings.trained.items():
        if (stage.folder / "forces.png").is_file():
            test = _rmse(stage.result["parts"]["test"])
            caption = f"{STAGE_NAMES[name]}, on the test part of what it learned from: {test}"
            blocks.append(_file(f"forces-{name}", stage.folder / "forces.png", caption))
    for name, (wanted, said) in findings.forces.items():
        caption = (
            f"{name}, along {len(findings.logs[EXPERT])} undisturbed flights of the MPC of the "
            f"evaluation: {_rmse(force_figures(wanted, said, limit))}"
        )
        blocks.append(picture(f"along-{_label(name)}", plot_forces(wanted, said, limit), caption))
    return blocks


def _rmse(figures: Mapping[str, Any]) -> str:
    rmse, zero = (number_text(figures[key], ".3f") for key in ("rmse_n", "zero_rmse_n"))
    return f"RMSE {rmse} N, always zero {zero} N."


def _errors(findings: Findings, looks: Looks) -> list[Block]:
    drawn = findings.drawn
    others = {name: log for name, log in drawn.items() if name != EXPERT}
    lines = [
        [name, *(f"{each[key]:.0f}" for key in ("median", "greatest", "end"))]
        for name, each in findings.path_errors_m.items()
    ]
    caption = f"Distance from where the MPC is at the same time, on transit {findings.transit}."
    return [
        picture("path-errors", plot_path_errors(drawn[EXPERT], others, looks), caption),
        Table(["", "median (m)", "greatest (m)", "at the end (m)"], lines),
    ]


def _efforts(findings: Findings) -> list[Block]:
    lines = [
        [name, f"{each['median']:.3f}", f"{each['p95']:.3f}", f"{100 * each['within_1_n']:.1f}"]
        for name, each in findings.efforts_n.items()
    ]
    head = ["", "difference, median (N)", "p95 (N)", "below 1 N (% of steps)"]
    told = (
        "The force that the hybrid flew, beside the force that the MPC commands at the same "
        "states, which was solved after the flight."
    )
    blocks: list[Block] = [Text(told), Table(head, lines)]
    for name, expert in findings.efforts.items():
        log = findings.drawn[name]
        caption = f"{name}, transit {findings.transit}: {outcome(log.summary)}."
        blocks.append(picture(f"effort-{_label(name)}", plot_effort(log, expert), caption))
    return blocks


def _label(name: str) -> str:
    """A variant's name as part of the name of a figure's file."""
    words = "".join(letter if letter.isalnum() else " " for letter in name.replace("'", ""))
    return "-".join(words.split())


def _file(name: str, path: Path, caption: str) -> Picture:
    """Reads a picture that a stage has made."""
    return Picture(name, path.read_bytes(), caption)
