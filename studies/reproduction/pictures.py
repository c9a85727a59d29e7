"""The sections of the report that show the paper's figures with ours."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from proxops.diagrams.logs import FlightLog
from proxops.diagrams.meshcat import paths_page
from proxops.studies.evaluation import EXPERT, Looks, controller_looks, outcome
from proxops.studies.reproduction import flights
from proxops.studies.reproduction.figures import (
    plot_curves,
    plot_effort,
    plot_path_errors,
    plot_views,
    read_curves,
)
from proxops.studies.reproduction.findings import (
    STAGE_NAMES,
    Findings,
    effort_figures,
    error_figures,
)
from proxops.studies.reproduction.tables import number
from proxops.training.reports import (
    Block,
    Page,
    Picture,
    Section,
    Table,
    Text,
    force_figures,
    picture,
    plot_forces,
    plot_frames,
)


def figure_sections(findings: Findings) -> list[Section]:
    """Makes a section for each of the paper's figures."""
    looks = controller_looks(list(findings.drawn))
    return [
        Section("Figure 1: what the lidar sees", [_frame(findings)]),
        Section("Figures 2 and 3: data, and frames generated for it", _frames(findings)),
        Section("Figure 4: training", _curves(findings)),
        Section("Figure 5: paths", _paths(findings, looks)),
        Section("Figure 6: the policy's force against the MPC's", _histograms(findings)),
        Section("Figure 7: position error against the MPC's path", _errors(findings, looks)),
        Section("Figure 8: control effort against the MPC's", _efforts(findings)),
    ]


def _frame(findings: Findings) -> Picture:
    log = findings.logs[EXPERT][findings.transit]
    positions = log.dataset["state"].values[:, :3]
    row = int(np.argmin(np.linalg.norm(positions, axis=1)))
    ranges = log.dataset["ranges"].values[row]
    planes, rays = ranges.shape
    figure = plot_frames(positions[[row]], {"as flown, with noise": ranges.reshape(1, -1)}, planes)
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
                    f"{STAGE_NAMES[name]}: {figures['flights']} ({kinds}), {figures['steps']} "
                    f"steps, {figures['successes']} arrived, {figures['collisions']} collided; "
                    f"{100 * figures['zero_command_share']['all']:.0f} % of commands are zero."
                    + _SEEN_BY.get(str(stage.result.get("lidar")), "")
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


# What the report says of the lidar of the disturbed flights, by the folder of its bundle.
_SEEN_BY = {
    "bundle": " The frames of the disturbed flights come from our ray network (--lidar learned).",
    "paper_bundle": " The frames of the disturbed flights come from an MLP as the paper's "
    "(--lidar paper).",
}


def _curves(findings: Findings) -> list[Block]:
    blocks: list[Block] = []
    for name, stage in findings.trained.items():
        curves = read_curves(stage.folder)
        if curves:
            caption = f"{STAGE_NAMES[name]}: loss over epochs."
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
                f"{STAGE_NAMES[name]}, on the test part of what it learned from: RMSE "
                f"{number(test, 'rmse_n', '.3f')} N, always zero "
                f"{number(test, 'zero_rmse_n', '.3f')} N."
            )
            blocks.append(_file(f"forces-{name}", stage.folder / "forces.png", caption))
    for name, (wanted, said) in findings.forces.items():
        figures = force_figures(wanted, said, limit)
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
        for name, each in error_figures(findings).items()
    ]
    caption = f"Distance from where the MPC is at the same time, on transit {findings.transit}."
    return [
        picture("path-errors", plot_path_errors(drawn[EXPERT], others, looks), caption),
        Table(["", "median (m)", "greatest (m)", "at the end (m)"], lines),
    ]


def _efforts(findings: Findings) -> list[Block]:
    blocks: list[Block] = [
        Text(
            "The force that the hybrid flew, beside the force that the MPC commands at the same "
            "states, which was solved after the flight."
        )
    ]
    lines = [
        [name, number(each, "median", ".3f"), number(each, "p95", ".3f"),
         f"{100 * each['within_1_n']:.1f}"]
        for name, each in effort_figures(findings).items()
    ]  # fmt: skip
    head = ["", "difference, median (N)", "p95 (N)", "below 1 N (% of steps)"]
    blocks.append(Table(head, lines))
    for name, expert in findings.efforts.items():
        log = findings.drawn[name]
        caption = f"{name}, transit {findings.transit}: {_outcome(log)}."
        blocks.append(picture(f"effort-{flights.label(name)}", plot_effort(log, expert), caption))
    return blocks


def _outcome(log: FlightLog) -> str:
    return outcome(log.summary)


def _file(name: str, path: Path, caption: str) -> Picture:
    """Reads a picture that a stage has made."""
    return Picture(name, path.read_bytes(), caption)
