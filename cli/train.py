"""`proxops train`: trains a policy on flights of the MPC."""

from __future__ import annotations

import enum
import json
import math
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


class RecipeName(enum.StrEnum):
    """The kind of policy and how it is trained."""

    PROXOPS = "proxops"
    PAPER = "paper"
    ANY_BODY = "any-body"
    DESCENT = "descent"


# Those that make their own examples.
_WITHOUT_DATA = (RecipeName.ANY_BODY, RecipeName.DESCENT)
# One for each: in the other's folder, a training would replace the bundle.
_FOLDERS = {
    RecipeName.PROXOPS: Path("out/pilot"),
    RecipeName.PAPER: Path("out/paper-policy"),
    RecipeName.ANY_BODY: Path("out/any-body"),
    RecipeName.DESCENT: Path("out/descent"),
}


class Precision(enum.StrEnum):
    """The precision of the network's arithmetic in training."""

    FULL = "32-true"
    BFLOAT16 = "bf16-mixed"
    FLOAT16 = "16-mixed"


def train_command(
    data: Annotated[
        Path | None,
        typer.Argument(help="Folder that `proxops collect` wrote; any-body and descent need none."),
    ] = None,
    recipe: Annotated[
        RecipeName,
        typer.Option(
            help="proxops: our pilot, from lidar frames; paper: the paper's CNN, LSTM and MLP; "
            "any-body: from the navigation's state, for a family of bodies; descent: of a "
            "touch-and-go, likewise."
        ),
    ] = RecipeName.PROXOPS,
    epochs: Annotated[
        int | None,
        typer.Option(min=1, help="Most epochs. Default: 20; any-body 30; descent 60; paper 12."),
    ] = None,
    minutes: Annotated[
        float | None, typer.Option(min=0.0, help="Greatest time in minutes; paper only.")
    ] = None,
    seed: Annotated[
        int, typer.Option(min=0, help="Seed of the first weights and of the order of examples.")
    ] = 0,
    device: Annotated[
        str,
        typer.Option(
            help="cpu, cuda, mps or auto: for the paper's recipe the fastest, else the cpu."
        ),
    ] = "auto",
    precision: Annotated[
        Precision, typer.Option(help="Precision of the arithmetic.")
    ] = Precision.FULL,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for policy and report. Default: out/pilot, or by the recipe."),
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(min=1, help="Processes that compute plans. Default: one for each core."),
    ] = None,
    quick: Annotated[
        bool, typer.Option(help="Train a small network on few data: for a first try, not for use.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Train a policy to predict the MPC's force.

    The command writes the policy, training curves, report.md and report.json. `proxops fly
    --controller policy:OUT/bundle` flies it. Run it again to continue after an interruption.

    Examples:

      proxops train out/full --out out/pilot

      proxops train out/paper --recipe paper --out out/paper-policy

      proxops train --recipe any-body --out out/any-body

      proxops train --recipe descent --out out/descent
    """
    out = out or _FOLDERS[recipe]
    check_folder(out)
    _check_options(recipe, data, minutes, workers)
    options = {} if device == "auto" else {"device": device}
    with training_extra():
        # torch is slow to import.
        from proxops.training.recipes import RECIPES
    settings = RECIPES[recipe].settings(seed=seed, precision=precision.value, **options)
    settings = (settings.quick() if quick else settings).limited(epochs, minutes)
    with work_bar() as tell:
        report = RECIPES[recipe].train(data, out, settings, Workers(workers).reporting(tell))
    if as_json:
        typer.echo(json.dumps(report, indent=2))
    else:
        (print_shares if recipe in _WITHOUT_DATA else print_report)(report)
    status.print(f"Wrote bundle, the trained policy, report.md and curves in {out}")


def _check_options(
    recipe: RecipeName, data: Path | None, minutes: float | None, workers: int | None
) -> None:
    """Raises `InputError` if the recipe does not take an option that is given, or needs data."""
    if minutes is not None and math.isnan(minutes):
        raise InputError("--minutes must be a number")
    if minutes is not None and recipe != RecipeName.PAPER:
        raise InputError("--minutes needs --recipe paper: give --epochs or --quick")
    if recipe in _WITHOUT_DATA and data is not None:
        raise InputError(f"--recipe {recipe} makes its own examples: leave out {data}")
    if recipe not in _WITHOUT_DATA and data is None:
        raise InputError("name the folder that `proxops collect` wrote")
    if recipe == RecipeName.PAPER and workers is not None:
        raise InputError("--workers is for recipes that compute plans: leave it out")


def print_shares(report: dict[str, Any]) -> None:
    """Prints the results of a training whose errors are shares."""
    run, errors = report["training"], report["force_errors"]
    rows = [("epochs", str(run["epochs"])), ("CPU time", f"{run['cpu_s']:.0f} s")]
    rows += [
        (f"median error of the force, {part}", f"{row['median']:.1%}")
        for part, row in errors.items()
    ]
    print_rows(f"policy by the {report['recipe']} recipe", rows)


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
