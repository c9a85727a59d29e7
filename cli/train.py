"""`proxops train`: trains a policy on flights of the MPC."""

from __future__ import annotations

import enum
import json
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from proxops.cli.common import (
    AsJson,
    check_folder,
    print_rows,
    status,
    training_extra,
    work_bar,
)
from proxops.diagrams.flight import Workers
from proxops.systems.common import InputError


class Recipe(enum.StrEnum):
    """The kind of policy and how it is trained."""

    PROXOPS = "proxops"
    PAPER = "paper"


class Precision(enum.StrEnum):
    """The precision of the network's arithmetic in training."""

    FULL = "32-true"
    BFLOAT16 = "bf16-mixed"
    FLOAT16 = "16-mixed"


def train_command(
    data: Annotated[Path, typer.Argument(help="Folder that `proxops collect` wrote.")],
    recipe: Annotated[
        Recipe,
        typer.Option(help="proxops: our pilot; paper: the paper's CNN, LSTM and MLP."),
    ] = Recipe.PROXOPS,
    epochs: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Greatest number of epochs (of our pilot's guidance). Default: 20; paper: 12.",
        ),
    ] = None,
    minutes: Annotated[
        float | None, typer.Option(min=0.0, help="Greatest time in minutes; paper only.")
    ] = None,
    seed: Annotated[
        int, typer.Option(min=0, help="Seed of the first weights and of the order of examples.")
    ] = 0,
    device: Annotated[
        str,
        typer.Option(help="cpu, cuda, mps or auto: the fastest device, or the cpu for our pilot."),
    ] = "auto",
    precision: Annotated[
        Precision, typer.Option(help="Precision of the arithmetic.")
    ] = Precision.FULL,
    out: Annotated[Path, typer.Option(help="Folder for the policy and its report.")] = Path(
        "out/pilot"
    ),
    workers: Annotated[
        int | None,
        typer.Option(min=1, help="Processes that compute plans. Default: one for each core."),
    ] = None,
    quick: Annotated[
        bool, typer.Option(help="Train a small network on few data: for a first try, not for use.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Train a policy to predict the MPC's force from lidar frames and the goal.

    The command writes the policy, training curves, report.md, report.json and forces.png.
    `proxops fly --controller policy:OUT/bundle` flies the policy. Run it again to continue after
    an interruption.

    Examples:

      proxops train out/full --out out/pilot

      proxops train out/paper --recipe paper --out out/paper-policy
    """
    check_folder(out)
    with training_extra():
        # torch is slow to import.
        from proxops.training.paper import PaperSettings, train_paper_policy
        from proxops.training.pilot import PilotSettings, train_pilot
    with work_bar() as tell:
        if recipe == Recipe.PAPER:
            settings = PaperSettings(seed=seed, device=device, precision=precision.value)
            settings = settings.quick() if quick else settings
            schedule = replace(settings.schedule, minutes=minutes)
            schedule = schedule if epochs is None else replace(schedule, epochs=epochs)
            settings = replace(settings, schedule=schedule)
            report = train_paper_policy(data, out, settings, tell)
        else:
            if minutes is not None:
                raise InputError("--minutes needs --recipe paper: give --epochs or --quick")
            # Its networks are small, so a CPU is as fast as any other device.
            device = "cpu" if device == "auto" else device
            settings = PilotSettings(seed=seed, device=device, precision=precision.value)
            settings = settings.quick() if quick else settings
            guidance = settings.guidance
            guidance = guidance if epochs is None else replace(guidance, epochs=epochs)
            settings = replace(settings, guidance=guidance)
            report = train_pilot(data, out, settings, Workers(workers, progress=tell))
    if as_json:
        typer.echo(json.dumps(report, indent=2))
    else:
        print_report(report)
    status.print(f"Wrote bundle, the trained policy, report.md, forces.png and curves in {out}")


def print_report(report: dict[str, Any]) -> None:
    """Prints the results of a training."""
    run, test = report["training"], report["parts"]["test"]
    rows = [
        ("epochs, kept", f"{run['epochs']}, {run['best_epoch'] + 1}"),
        ("CPU time", f"{run['cpu_s']:.0f} s"),
    ]
    for part, figures in report["parts"].items():
        rows.append((f"RMSE, {part}", _newtons([figures["rmse_n"]])))
    rows += [
        ("RMSE, test, x, y, z", _newtons(test["rmse_axes_n"])),
        ("always zero, test", _newtons([test["zero_rmse_n"]])),
    ]
    print_rows(f"policy by the {report['recipe']} recipe", rows)


def _newtons(values: list[float | None] | None) -> str:
    known = [value for value in values or [] if value is not None]
    return f"{', '.join(f'{value:.3f}' for value in known)} N" if known else "–"
