"""The report of the paper's reproduction: each of its figures and numbers, with ours beside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from proxops.diagrams.body import Body
from proxops.diagrams.flight_log import FlightLog
from proxops.diagrams.path_scene import paths_page
from proxops.diagrams.scenario import Scenario
from proxops.systems.policy_bundle import PolicyBundle
from proxops.training import reproduction_flights as flights
from proxops.training.evaluation import EXPERT
from proxops.training.evaluation_figures import Looks, controller_looks
from proxops.training.evaluation_table import arrival_text, outcome
from proxops.training.force_figures import force_figures, plot_forces
from proxops.training.html_report import Block, Page, Picture, Section, Table, Text, picture
from proxops.training.lidar_figures import plot_frames
from proxops.training.reproduction_figures import (
    path_errors,
    plot_curves,
    plot_effort,
    plot_gates,
    plot_path_errors,
    plot_views,
    read_curves,
)
from proxops.training.reproduction_numbers import checks_passed, costs
from proxops.training.reproduction_tables import (
    comparison_lines,
    controller_figures,
    controller_table,
    cost_table,
    gate_table,
    number,
    stage_table,
)
from proxops.training.stages import Stage

SHOWN = (
    EXPERT, flights.POLICY, flights.PAPER_POLICY, flights.STRICT, flights.PAPER_GATE,
    flights.ADAPTIVE, flights.PAPER_HYBRID, flights.ZERO_STRICT,
)  # fmt: skip
"""Who is drawn, of those that fly."""
HYBRIDS = (flights.STRICT, flights.PAPER_GATE, flights.ADAPTIVE, flights.PAPER_HYBRID,
            flights.ZERO_STRICT)  # fmt: skip
"""Whose effort is compared."""
_STAGE_NAMES = {
    "lidar": "the learned lidar",
    "data-paper": "the paper's 400 flights",
    "policy-paper": "the policy by the paper's recipe",
    "data-full": "our flights",
    "policy-pilot": "our policy from them",
    "policy-dagger": "its rounds of DAgger",
}


@dataclass(frozen=True)
class Findings:
    """All that the report is made from."""

    command: str
    scenario: Scenario
    body: Body
    seed: int
    transit: int
    """The one that is drawn."""
    stages: Sequence[Stage]
    trained: Mapping[str, Stage]
    missing: Sequence[str]
    """Stages of training that neither ran nor had run."""
    policy: PolicyBundle
    results: Mapping[str, Mapping[str, Any]]
    """As `evaluate` gives them."""
    logs: Mapping[str, Mapping[int, FlightLog]]
    """As `fly_shown` gives them."""
    forces: Mapping[str, tuple[np.ndarray, np.ndarray]]
    """Of each policy along the MPC's flights: the MPC's (N, 3) and its own, in N."""
    efforts: Mapping[str, np.ndarray]
    """Of each hybrid that is drawn: what the MPC would command (N, 3) along its flight, in N."""

    @property
    def drawn(self) -> dict[str, FlightLog]:
        """The logs of the transit that is drawn."""
        return {name: self.logs[name][self.transit] for name in SHOWN if name in self.logs}


def reproduction_sections(findings: Findings) -> list[Section]:
    """The report, to be written by `write_report`."""
    looks = controller_looks(list(findings.drawn))
    return [
        _head(findings),
        Section("The paper's numbers, and ours", _comparison(findings)),
        Section("Who flies how", _controllers(findings)),
        Section("Gates compared", _gates(findings)),
        Section("What a step costs", _costs(findings)),
        Section("Figure 1: what the lidar sees", [_frame(findings)]),
        Section("Figures 2 and 3: data, and frames generated for it", _frames(findings)),
        Section("Figure 4: training", _curves(findings)),
        Section("Figure 5: paths", _paths(findings, looks)),
        Section("Figure 6: the policy's force against the MPC's", _histograms(findings)),
        Section("Figure 7: position error against the MPC's path", _errors(findings, looks)),
        Section("Figure 8: control effort against the MPC's", _efforts(findings)),
    ]


def findings_json(findings: Findings) -> dict[str, Any]:
    """What report.json holds; the flights' rows are in the record of their stage."""
    return {
        "proxops_version": metadata.version("proxops"),
        "command": findings.command,
        "seed": findings.seed,
        "policy_sha256": findings.policy.sha256,
        "stages": [
            {"name": stage.name, "folder": stage.folder.name, "wall_s": stage.wall_s,
             "skipped": stage.skipped}
            for stage in findings.stages
        ],
        "not_run": list(findings.missing),
        "paper_and_ours": [
            dict(zip(("what", "paper", "ours"), line, strict=True))
            for line in comparison_lines(findings.results, findings.scenario, findings.trained)
        ],
        "controllers": controller_figures(findings.results),
        "forces_along_the_mpc": {
            name: force_figures(*forces) for name, forces in findings.forces.items()
        },
        "forces_on_the_test_part": {
            name: stage.result["parts"]["test"]
            for name, stage in findings.trained.items()
            if "parts" in stage.result
        },
        "path_errors_m": _error_figures(findings),
        "efforts_n": _effort_figures(findings),
    }  # fmt: skip


def _head(findings: Findings) -> Section:
    count = findings.results[EXPERT]["transits"]
    arrival = findings.scenario.arrival
    blocks: list[Block] = [
        Text(findings.command, code=True),
        Text(
            f"{findings.body.config.name}, proxops {metadata.version('proxops')}. Each controller "
            f"flies the same {count} transits of seed {findings.seed}, which nothing was trained "
            f"on. Success is arrival within {arrival_text(arrival)} of the goal by "
            f"{arrival.deadline_s:g} s, to stay there for {arrival.dwell_s:g} s, with no "
            "collision and no keep-out violation; intervals are Wilson's, of 95 %."
        ),
        stage_table(findings.stages),
    ]
    if findings.missing:
        names = ", ".join(_STAGE_NAMES[name] for name in findings.missing)
        blocks.append(
            Text(
                f"Not run, and not there from an earlier run: {names}. What depends on them is "
                "missing below, or marked so; without --quick all of it is run."
            )
        )
    return Section("What was run", blocks)


def _comparison(findings: Findings) -> list[Block]:
    lines = comparison_lines(findings.results, findings.scenario, findings.trained)
    return [
        Table(["", "paper", "ours"], lines),
        Text(
            "Times are this machine's, several flights at once, so compare them with each other "
            "rather than with the paper's. The paper's 21.6 % is 0.053 s × 300 W over 0.473 s × "
            "155 W: of one step, and of a policy that flies alone. The hybrid asks the MPC as "
            "well, and the policy at every step, so that its gain is 1 / ((1 − saved) + policy "
            "time / MPC time). Our policy runs on the CPU that the MPC runs on: TDP cancels."
        ),
    ]


def _controllers(findings: Findings) -> list[Block]:
    return [
        controller_table(findings.results),
        Text(
            "Lost: flights with a step at which no ray of the lidar returns. Δv is over the "
            "MPC's, of the transits in which both succeed. Assured: with runtime assurance "
            "between policy and thrusters; it is off in all other rows. Zero commands nothing at "
            "all; the PD controllers know the true state, or what the policy takes it to be."
        ),
    ]


def _gates(findings: Findings) -> list[Block]:
    results = findings.results
    # Of those that fly, the hybrids are the ones that compare forces.
    shown = [name for name in results if checks_passed(results[name]) is not None]
    points = {
        name: (
            costs(results, name)["saved"] or 0.0,
            results[name].get("expert_delta_v_ratio") or float("nan"),
            results[name]["min_clearance_m"],
        )
        for name in shown
    }
    blocks: list[Block] = [
        gate_table(results, shown),
        Text(
            "Always zero is the hybrid with a policy that never thrusts: the share that a policy "
            "gets for having learned nothing. What a gate lets pass of it is no merit."
        ),
    ]
    if points:
        caption = "Solves saved against fuel and clearance, over all transits."
        blocks.append(picture("gates", plot_gates(points), caption))
    return blocks


def _costs(findings: Findings) -> list[Block]:
    return [
        cost_table(findings.results),
        Text(
            "By arithmetic: 1 / ((1 − saved) + policy time / MPC time), from medians, the MPC's of "
            "its own flights. Measured: the MPC's mean time of a step over the whole controller's, "
            "with what all its solves (after a pause a solve takes longer), its network and its "
            "decisions really took. Energy is time times the TDP of the paper's CPU."
        ),
    ]


def _frame(findings: Findings) -> Picture:
    log = findings.logs[EXPERT][findings.transit]
    positions = log.dataset["state"].values[:, :3]
    row = int(np.argmin(np.linalg.norm(positions, axis=1)))
    ranges = log.dataset["ranges"].values[row]
    planes, rays = ranges.shape
    reshaped = (rays // 6, 6 * planes) if rays % 6 == 0 else (rays, planes)
    figure = plot_frames(
        positions[[row]], {"as flown, with noise": ranges.reshape(1, -1)}, planes, reshaped
    )
    caption = (
        f"A frame of {planes} planes of {rays} rays from the MPC's flight, where it is nearest to "
        "the body; dark: no return. figures/replay-….html shows the returns in flight."
    )
    return picture("frame", figure, caption)


def _frames(findings: Findings) -> list[Block]:
    blocks: list[Block] = []
    for name in ("data-paper", "data-full"):
        if (stage := findings.trained.get(name)) is not None:
            figures = stage.result["all"]
            kinds = ", ".join(f"{count} {kind}" for kind, count in stage.result["kinds"].items())
            blocks.append(
                Text(
                    f"{_STAGE_NAMES[name]}: {figures['flights']} ({kinds}), {figures['steps']} "
                    f"steps, {figures['successes']} arrived, {figures['collisions']} collided; "
                    f"{100 * figures['zero_command_share']['all']:.0f} % of commands are zero."
                )
            )
    lidar = findings.trained.get("lidar")
    if lidar is None:
        return [*blocks, Text("The lidar network was not trained in this run.")]
    lines = [
        [name, f"{each['all']['mask_iou']:.4f}", number(each["all"]["range_error_m"], "median"),
         number(each["all"]["range_error_m"], "p95"), f"{each['frame_ms']:.2f}"]
        for name, each in lidar.result["methods"].items()
    ]  # fmt: skip
    head = ["", "mask IoU", "range error, median (m)", "p95 (m)", "ms a frame"]
    caption = "Frames from positions off the grid: cast, by our network, and by one as the paper's."
    return [*blocks, Table(head, lines), _file("frames", lidar.folder / "frames.png", caption)]


def _curves(findings: Findings) -> list[Block]:
    blocks: list[Block] = []
    for name, stage in findings.trained.items():
        curves = read_curves(stage.folder)
        if curves:
            caption = f"{_STAGE_NAMES[name]}: loss over epochs."
            blocks.append(picture(f"curves-{name}", plot_curves(curves), caption))
    return blocks or [Text("Nothing was trained in this run.")]


def _paths(findings: Findings, looks: Looks) -> list[Block]:
    drawn = findings.drawn
    title = f"Transit {findings.transit} of seed {findings.seed}"
    colours = {name: looks[name].colour for name in drawn} | {EXPERT: "#ffffff"}
    outcomes = ", ".join(f"{name}: {_outcome(log)}" for name, log in drawn.items())
    caption = f"{title}; drag to turn, scroll to come nearer. {outcomes}."
    return [
        Page("paths", paths_page(drawn, colours, title), caption),
        picture(
            "paths", plot_views(drawn, looks), f"{title}, in the frame of the body; star: the goal."
        ),
    ]


def _histograms(findings: Findings) -> list[Block]:
    blocks: list[Block] = []
    limit = findings.scenario.spacecraft.thrust_limit_n
    for name, stage in findings.trained.items():
        if (stage.folder / "forces.png").is_file():
            test = stage.result["parts"]["test"]
            caption = (
                f"{_STAGE_NAMES[name]}, on the test part of what it learned from: RMSE "
                f"{number(test, 'rmse_n', '.3f')} N, always zero "
                f"{number(test, 'zero_rmse_n', '.3f')} N."
            )
            blocks.append(_file(f"forces-{name}", stage.folder / "forces.png", caption))
    for name, (wanted, said) in findings.forces.items():
        figures = force_figures(wanted, said)
        caption = (
            f"{name}, along {len(findings.logs[EXPERT])} undisturbed flights of the MPC of the "
            f"evaluation: RMSE {number(figures, 'rmse_n', '.3f')} N, always zero "
            f"{number(figures, 'zero_rmse_n', '.3f')} N."
        )
        blocks.append(
            picture(f"along-{flights.label(name)}", plot_forces(wanted, said, limit), caption)
        )
    return blocks


def _errors(findings: Findings, looks: Looks) -> list[Block]:
    drawn = findings.drawn
    others = {name: log for name, log in drawn.items() if name != EXPERT}
    lines = [
        [name, number(each, "median"), number(each, "greatest"), number(each, "end")]
        for name, each in _error_figures(findings).items()
    ]
    caption = f"Distance from where the MPC is at the same time, on transit {findings.transit}."
    return [
        picture("path-errors", plot_path_errors(drawn[EXPERT], others, looks), caption),
        Table(["", "median (m)", "greatest (m)", "at the end (m)"], lines),
    ]


def _efforts(findings: Findings) -> list[Block]:
    blocks: list[Block] = [
        Text(
            "What the MPC would command at every state of the hybrid's own flight, solved after it "
            "was over, beside what was flown."
        )
    ]
    lines = [
        [name, number(each, "median", ".3f"), number(each, "p95", ".3f"),
         f"{100 * each['within_1_n']:.1f}"]
        for name, each in _effort_figures(findings).items()
    ]  # fmt: skip
    head = ["", "difference, median (N)", "p95 (N)", "below 1 N (% of steps)"]
    blocks.append(Table(head, lines))
    for name, expert in findings.efforts.items():
        log = findings.drawn[name]
        caption = f"{name}, transit {findings.transit}: {_outcome(log)}."
        blocks.append(picture(f"effort-{flights.label(name)}", plot_effort(log, expert), caption))
    return blocks


def _error_figures(findings: Findings) -> dict[str, dict[str, float]]:
    drawn = findings.drawn
    figures = {}
    for name, log in drawn.items():
        if name != EXPERT:
            _, errors = path_errors(drawn[EXPERT], log)
            figures[name] = {
                "median": float(np.median(errors)),
                "greatest": float(errors.max()),
                "end": float(errors[-1]),
            }
    return figures


def _effort_figures(findings: Findings) -> dict[str, dict[str, float]]:
    figures = {}
    for name, expert in findings.efforts.items():
        force = findings.drawn[name].dataset["force"].values[:-1]
        sizes = np.linalg.norm(force - expert, axis=1)
        sizes = sizes[np.isfinite(sizes)]
        if sizes.size:
            figures[name] = {
                "median": float(np.median(sizes)),
                "p95": float(np.percentile(sizes, 95)),
                "within_1_n": float(np.mean(sizes < 1.0)),
            }
    return figures


def _outcome(log: FlightLog) -> str:
    return outcome(log.summary)


def _file(name: str, path: Path, caption: str) -> Picture:
    """A picture that a stage has made."""
    return Picture(name, path.read_bytes(), caption)
