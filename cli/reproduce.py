"""`proxops reproduce`: reproduces the paper, from data to a report, with one command."""

from __future__ import annotations

import contextlib
import enum
import shlex
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated

import typer
from rich.progress import BarColumn, TextColumn, TimeElapsedColumn

from proxops.cli.common import (
    Processes,
    ScenarioChanges,
    SchedulerAddress,
    check_folder,
    print_rows,
    progress_bar,
    status,
    training_extra,
)
from proxops.diagrams.flight import Workers
from proxops.diagrams.scenario import load_body, load_scenario


class LidarNetwork(enum.StrEnum):
    """The network that replaces the lidar in the flights in which the paper's network does."""

    LEARNED = "learned"
    PAPER = "paper"


def reproduce_command(
    scenario: Annotated[
        Path | None, typer.Argument(help="Scenario file (YAML). Default: Kleopatra.")
    ] = None,
    quick: Annotated[
        bool,
        typer.Option(
            help="Train nothing and fly few transits, with the shipped policy or the one that "
            "--set policy.bundle=FOLDER names. It takes minutes."
        ),
    ] = False,
    transits: Annotated[
        int | None,
        typer.Option(
            min=2, help="Number of transits for each controller. Default: 200, or 10 with --quick."
        ),
    ] = None,
    seed: Annotated[
        int,
        typer.Option(
            min=10_000, help="Seed of these transits; seeds below 10,000 are for training."
        ),
    ] = 10_000,
    lidar: Annotated[
        LidarNetwork,
        typer.Option(
            help="Network that makes the frames of the paper's disturbed flights: our ray network "
            "(learned), or an MLP like the paper's (paper)."
        ),
    ] = LidarNetwork.LEARNED,
    settings: ScenarioChanges = None,
    out: Annotated[Path, typer.Option(help="Folder for all stages and the report.")] = Path(
        "out/reproduction"
    ),
    workers: Processes = None,
    scheduler: SchedulerAddress = None,
) -> None:
    """Collect, train, evaluate, and write a report with the paper's figures and numbers and ours.

    As in the paper, the MPC knows the true state. The command writes report.html, report.md and
    report.json, and a folder for each stage. Run it again to continue after an interruption; a
    stage that is done is repeated only if its inputs have changed.

    Examples:

      proxops reproduce --out out/reproduction

      proxops reproduce --quick --out out/look --set policy.bundle=out/dagger/bundle
    """
    check_folder(out)
    wanted = load_scenario(scenario, settings or [], on_true_state=True)
    load_body(wanted.body)
    # matplotlib and torch are slow to import.
    from proxops.studies.reproduction import ReproductionSettings, reproduce

    judged = ReproductionSettings(seed=seed)
    judged = judged.quick() if quick else judged
    judged = judged if transits is None else judged.of_transits(transits)
    training = None
    if not quick:
        with training_extra("; or give --quick"):
            from proxops.studies.reproduction import TrainingSettings
        training = TrainingSettings(lidar_network=lidar.value)
    with _stage_bar() as tell:
        report = reproduce(
            wanted,
            out,
            judged,
            training,
            command=shlex.join(["proxops", *sys.argv[1:]]),
            workers=Workers(workers, scheduler),
            tell=tell,
        )
    lines = [(f"{line['what']} (paper: {line['paper']})", line["ours"])
             for line in report["paper_and_ours"]]  # fmt: skip
    print_rows("the paper's numbers, and ours", lines)
    if report["not_run"]:
        status.print(f"Not run: {', '.join(report['not_run'])}")
    status.print(f"Wrote report.html, report.md and report.json in {out}")


@contextlib.contextmanager
def _stage_bar() -> Iterator[Callable[[str, float, str], None]]:
    """Shows a progress bar with the stage, the done share of the stage, and a text."""
    columns = (TextColumn("{task.fields[stage]}"), BarColumn(), TimeElapsedColumn())
    with progress_bar(*columns, TextColumn("{task.description}")) as bar:
        task = bar.add_task("", total=1.0, stage="")

        def tell(stage: str, done: float, text: str) -> None:
            bar.update(task, completed=done, description=text, stage=stage)

        yield tell
