"""`proxops replay`: makes a page that plays without a network from a log, and other formats."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from proxops.cli.common import check_folder, status
from proxops.diagrams.exchange import EPOCH, write_mcap, write_oem
from proxops.diagrams.logs import FlightLog
from proxops.diagrams.meshcat import write_movie, write_replay
from proxops.systems.common import InputError, make_folder


def replay_command(
    log_file: Annotated[Path, typer.Argument(help="Flight log, such as flight.nc.")],
    out: Annotated[Path | None, typer.Option(help="HTML file. Default: beside the log.")] = None,
    movie: Annotated[
        Path | None, typer.Option(help="Write a film too, .webp, .gif or .mp4; needs Chromium.")
    ] = None,
    mcap: Annotated[
        Path | None, typer.Option(help="Write an MCAP file too, for Foxglove and others.")
    ] = None,
    oem: Annotated[
        Path | None, typer.Option(help="Write the motion as a CCSDS OEM too, in an inertial frame.")
    ] = None,
    epoch: Annotated[
        str | None,
        typer.Option(help=f"Of time 0 in the OEM: YYYY-MM-DDThh:mm:ss in TDB. Default: {EPOCH}."),
    ] = None,
) -> None:
    """Make the replay page of a flight log, and files for other tools.

    --mcap and --oem need `pip install 'proxops[exchange]'`, a film in .mp4 `'proxops[movie]'`.

    Examples:

      proxops replay out/flight/flight.nc --out flight.html

      proxops replay out/flight/flight.nc --movie flight.webp

      proxops replay out/flight/flight.nc --mcap flight.mcap --oem flight.oem
    """
    if epoch is not None and oem is None:
        raise InputError("--epoch needs --oem: no other file has a date")
    path = out or log_file.with_name("replay.html")
    named = {"--out": path, "--movie": movie, "--mcap": mcap, "--oem": oem}
    for option, file in named.items():
        if file is not None:
            check_folder(file.parent, option)
    wanted = [file for file in named.values() if file is not None]
    places = [file.resolve() for file in (log_file, *wanted)]
    if len(set(places)) < len(places):
        raise InputError(f"{', '.join(named)} must name files of their own, and not the log")
    log = FlightLog.load(log_file)
    for file in wanted:
        make_folder(file.parent)
    # First those that may be refused.
    if oem is not None:
        write_oem(log, oem, epoch or EPOCH)
    if mcap is not None:
        write_mcap(log, mcap)
    if movie is not None:
        write_movie(log, movie)
    write_replay(log, path)
    for file in wanted:
        status.print(f"Wrote {file}")
