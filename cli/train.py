"""`proxops train`: a policy from expert flights."""

from __future__ import annotations

import enum
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.progress import BarColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from proxops.cli.common import check_folder, print_rows, progress_bar, status
from proxops.systems.errors import InputError


class Recipe(enum.StrEnum):
    """What is trained, and how."""

    PAPER = "paper"


class Precision(enum.StrEnum):
    """Of the network's arithmetic while it is trained."""

    FULL = "32-true"
    BFLOAT16 = "bf16-mixed"
    FLOAT16 = "16-mixed"


def train_command(
    data: Annotated[Path, typer.Argument(help="What `proxops collect` wrote.")],
    recipe: Annotated[Recipe, typer.Option(help="paper: CNN, LSTM and MLP.")] = Recipe.PAPER,
    epochs: Annotated[int | None, typer.Option(min=1, help="At most. Default: 40.")] = None,
    minutes: Annotated[
        float | None, typer.Option(min=0.0, help="Budget of time. Default: epochs alone.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of weights and order.")] = 0,
    device: Annotated[str, typer.Option(help="cpu, cuda, mps, or auto: the best.")] = "auto",
    precision: Annotated[Precision, typer.Option(help="Of the arithmetic.")] = Precision.FULL,
    out: Annotated[Path, typer.Option(help="Folder for the policy and its report.")] = Path(
        "out/policy"
    ),
    quick: Annotated[
        bool, typer.Option(help="A small network, little data: in seconds, of no great use.")
    ] = False,
) -> None:
    """Train a policy to say what the MPC says, from lidar frames and the goal.

    Writes policy.ckpt, the curves of training as CSV and for TensorBoard, report.md, report.json,
    forces.png, and bundle, which `proxops fly --controller policy --set policy.bundle=...`
    flies. Run it again to go on after an interruption.

    Example:

      proxops train out/paper --recipe paper --out out/paper-policy
    """
    check_folder(out)
    try:
        from proxops.training import paper_recipe  # torch takes a while to import.
    except ModuleNotFoundError as error:
        raise InputError(
            f"training needs {error.name}: run make train, or pip install 'proxops[train]'"
        ) from error
    settings = paper_recipe.Settings(seed=seed, device=device, precision=precision.value)
    if quick:
        settings = paper_recipe.quick(settings)
    schedule = replace(settings.schedule, minutes=minutes)
    if epochs is not None:
        schedule = replace(schedule, epochs=epochs)
    settings = replace(settings, schedule=schedule)
    columns = (BarColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    with progress_bar(*columns, TextColumn("{task.description}")) as bar:
        task = bar.add_task("", total=1.0)

        def tell(done: float, text: str) -> None:
            bar.update(task, completed=done, description=text)

        report = paper_recipe.train_paper_policy(data, out, settings, tell)
    _print(report)
    status.print(
        f"Wrote bundle, policy.ckpt, report.md, report.json, forces.png and curves in {out}"
    )


def _print(report: dict[str, Any]) -> None:
    run, test = report["training"], report["parts"]["test"]
    rows = [
        ("epochs, best", f"{run['epochs']}, {run['best_epoch'] + 1}"),
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
