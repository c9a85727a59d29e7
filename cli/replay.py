"""`proxops replay`: makes a page from a flight log; the page plays without a network."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from proxops.cli.common import check_folder, status
from proxops.diagrams.logs import FlightLog
from proxops.diagrams.meshcat import write_replay
from proxops.systems.common import make_folder


def replay_command(
    log_file: Annotated[Path, typer.Argument(help="Flight log, such as flight.nc.")],
    out: Annotated[Path | None, typer.Option(help="HTML file. Default: beside the log.")] = None,
) -> None:
    """Make the replay page of a flight log.

    Example:

      proxops replay out/flight/flight.nc --out flight.html
    """
    path = out or log_file.with_name("replay.html")
    check_folder(path.parent)
    log = FlightLog.load(log_file)
    make_folder(path.parent)
    write_replay(log, path)
    status.print(f"Wrote {path}")
