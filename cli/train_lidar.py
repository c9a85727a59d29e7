"""`proxops train-lidar`: trains the learned lidar."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from proxops.cli.common import (
    AsJson,
    ScenarioChanges,
    ScenarioFile,
    check_folder,
    console,
    status,
    training_extra,
    work_bar,
)
from proxops.diagrams.scenario import load_body, load_scenario
from proxops.training.reports import DASH, number_text


def train_lidar_command(
    scenario: ScenarioFile = None,
    spacing: Annotated[
        float, typer.Option(help="Spacing in km of the grid of training positions.")
    ] = 20.0,
    epochs: Annotated[
        int | None, typer.Option(min=1, help="Epochs of the ray network. Default: 24.")
    ] = None,
    seed: Annotated[
        int, typer.Option(min=0, help="Seed of weights, order and test positions.")
    ] = 0,
    settings: ScenarioChanges = None,
    out: Annotated[Path, typer.Option(help="Folder for the bundles and the report.")] = Path(
        "out/lidar"
    ),
    quick: Annotated[
        bool,
        typer.Option(
            help="Double the spacing and train for few steps: for a first try, not for use."
        ),
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Train two networks that predict lidar frames, ours and the paper's; compare them with others.

    The command writes two bundles, bundle (ours) and paper_bundle (the paper's), which a scenario
    uses with `lidar: !LearnedLidar {bundle: out/lidar/bundle}`. It also writes report.md,
    report.json, figures, and the training curves as CSV and for TensorBoard. Run it again to
    continue after an interruption.

    Example:

      proxops train-lidar --spacing 20 --out out/lidar
    """
    check_folder(out)
    wanted = load_scenario(scenario, settings or [], on_true_state=True)
    body = load_body(wanted.body)
    with training_extra():
        # torch is slow to import.
        from proxops.training.lidar import LidarSettings, train_lidar
    chosen = LidarSettings(spacing=1e3 * spacing, seed=seed)
    if quick:
        chosen = chosen.quick()
    if epochs is not None:
        chosen = replace(chosen, ray=replace(chosen.ray, epochs=epochs))
    with work_bar("casting frames") as tell:
        report = train_lidar(wanted, body, chosen, out, tell)
    if as_json:
        typer.echo(json.dumps(report, indent=2))
    else:
        _print(report)
    status.print(f"Wrote bundle, report.md, report.json, frames.png and curves in {out}")


def _print(report: dict[str, Any]) -> None:
    verdict = "met" if report["targets_met"] else "not met"
    table = Table(title=f"{report['body']}: targets {verdict}", title_justify="left")
    for head in ("", "mask IoU", "false hits", "missed hits", "error, median (km)", "p95 (km)",
                 "ms a frame"):  # fmt: skip
        table.add_column(head, justify="right" if head else "left")
    for name, figures in report["methods"].items():
        overall, errors = figures["all"], figures["all"]["range_error_m"]
        table.add_row(
            name,
            *(
                number_text(overall[key], ".4f")
                for key in ("mask_iou", "false_hits", "missed_hits")
            ),
            *(number_text(errors[key], ".3f", 1e-3) for key in ("median", "p95")),
            number_text(figures["frame_ms"], ".2f"),
        )
    table.add_row("ray-caster", *[DASH] * 5, number_text(report["ray_caster_frame_ms"], ".2f"))
    console.print(table)
