"""`proxops score`: flies a controller over a track that stays the same, and writes its row."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from proxops.cli.common import (
    Processes,
    SchedulerAddress,
    check_folder,
    print_rows,
    status,
    work_bar,
)
from proxops.diagrams.flight import Workers, controller_label


def score_command(
    track: Annotated[
        str,
        typer.Argument(help="state, lidar, lidar-after-survey, survey, touch, mission, or a file."),
    ],
    controller: Annotated[
        str,
        typer.Option(
            help="mpc, policy[:BUNDLE], hybrid[:BUNDLE], …, or MODULE:FACTORY. Of surveys the "
            "estimator: survey, or MODULE:FUNCTION."
        ),
    ],
    name: Annotated[
        str | None, typer.Option(help="What tables call it. Default: the controller.")
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", help="Change a value of mpc, policy or hybrid. Repeatable."),
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for the row and the flights.")] = Path(
        "out/score"
    ),
    workers: Processes = None,
    scheduler: SchedulerAddress = None,
) -> None:
    """Fly a controller over a track of the benchmark; write and print its row.

    A track is transits and worlds that never change. Run it again to continue after an
    interruption: no flight is flown twice.

    Examples:

      proxops score state --controller pd

      proxops score lidar-after-survey --controller hybrid --set hybrid.period_rule=adaptive

      proxops score survey --controller mine:estimate
    """
    # matplotlib is slow to import.
    from proxops.studies.scoring import TRACKS, load_track, row_table, save_row, score

    check_folder(out)
    chosen = load_track(track)
    label = controller_label(" ".join([controller, *(settings or [])]))
    folder = out / f"{chosen.sha256[:12]}-{label}"
    with work_bar("preparing the flights") as progress:
        row = score(
            chosen,
            controller,
            folder,
            name=name,
            settings=settings or [],
            workers=Workers(workers, scheduler, progress),
        )
    # Two files may have one name.
    stem = track if track in TRACKS else f"{Path(track).stem}-{chosen.sha256[:12]}"
    path = out / f"{stem}-{label}.json"
    save_row(row, path)
    head, cells = row_table(chosen, [row])
    print_rows(f"track {chosen.name}", list(zip(head, cells, strict=True)))
    status.print(f"Wrote {path}")
