"""`proxops dagger`: trains the pilot on its own flights."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Annotated

import typer

from proxops.cli.common import (
    EVALUATION_SEEDS,
    AsJson,
    Processes,
    SchedulerAddress,
    check_folder,
    print_rows,
    status,
    training_extra,
    work_bar,
)
from proxops.cli.train import print_report, print_shares
from proxops.diagrams.flight import Workers
from proxops.systems.common import InputError


def dagger_command(
    data: Annotated[
        Path | None,
        typer.Argument(help="Folder that `proxops collect` wrote; none for any body."),
    ] = None,
    pilot: Annotated[
        Path,
        typer.Option(
            help="Folder that `proxops train` wrote: from the same data, or for any body."
        ),
    ] = Path("out/pilot"),
    rounds: Annotated[
        int, typer.Option(min=1, help="Number of rounds. With DATA the last trains for longer.")
    ] = 2,
    flights: Annotated[
        int | None,
        typer.Option(
            min=1, help="Flights of each round. Default: 240, or 3 at each body of a family."
        ),
    ] = None,
    seed: Annotated[
        int,
        typer.Option(
            min=0,
            help="Seed of the first round's transits; each further round uses the next. All must "
            "be below 10,000: the others are for evaluation.",
        ),
    ] = 100,
    minutes: Annotated[
        float, typer.Option(min=0.0, help="Time in minutes after which no further round begins.")
    ] = math.inf,
    out: Annotated[Path, typer.Option(help="Folder for the rounds and the pilot.")] = Path(
        "out/dagger"
    ),
    workers: Processes = None,
    scheduler: SchedulerAddress = None,
    as_json: AsJson = False,
) -> None:
    """Let the pilot fly, label its flights with the MPC's forces, and train on them: DAgger.

    Each round leaves its flights, their labels and its pilot in OUT/round-N. OUT has the last
    round's bundle and report; with DATA, its weights too. Without DATA the policy is the one for
    any body: it flies at each of its family, on navigation, first in worlds of after_survey. Run it
    again to continue, or with more --rounds to add rounds. With DATA, the round that was the last
    before is then trained anew, for a shorter time.

    Examples:

      proxops dagger out/full --pilot out/pilot --out out/dagger

      proxops dagger --pilot out/any-body --out out/any-body-dagger
    """
    _check_numbers(seed, rounds, minutes)
    check_folder(out)
    if out.resolve() == pilot.resolve():
        raise InputError(f"--out {out} is the folder of --pilot: give another, to keep the pilot")
    if data is None and (pilot / "pilot.ckpt").exists():
        raise InputError(f"name the folder of flights that {pilot} was trained from")
    with training_extra():
        from proxops.training.recipes import DaggerSettings, run_dagger
    settings = DaggerSettings(rounds=rounds, flights=flights, seed=seed, minutes=minutes)
    with work_bar() as tell, Workers(workers, scheduler, tell).kept() as fleet:
        report = run_dagger(data, pilot, out, settings, fleet)
    if as_json:
        typer.echo(json.dumps(report, indent=2))
    else:
        (print_shares if data is None else print_report)(report)
        for number, row in enumerate(report["rounds"], start=1):
            flown = f"{row['arrived']} of {row['flights']} arrived, {row['violations']} violations"
            print_rows(f"round {number}", [("before it", flown), ("labels", str(row["labels"]))])
    status.print(f"Wrote bundle, report.md and report.json in {out}")


def _check_numbers(seed: int, rounds: int, minutes: float) -> None:
    """Raises `InputError` for no number, or if a round would learn from transits of evaluation."""
    if math.isnan(minutes):
        raise InputError("--minutes must be a number")
    last = seed + rounds - 1
    if last >= EVALUATION_SEEDS:
        raise InputError(
            f"--seed {seed} --rounds {rounds}: the last round would learn from transits of seed "
            f"{last}; seeds from {EVALUATION_SEEDS:,} on are for evaluation, on which nothing is "
            "trained"
        )
