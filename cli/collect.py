"""`proxops collect`: flies transits with the MPC for training and writes a log of each."""

from __future__ import annotations

import dataclasses as dc
import enum
import json
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Annotated, Any

import typer
from rich import box
from rich.table import Table

from proxops.cli.common import (
    EVALUATION_SEEDS,
    AsJson,
    DispersionsName,
    Processes,
    ScenarioChanges,
    ScenarioFile,
    SchedulerAddress,
    check_folder,
    check_transits_drawn,
    console,
    status,
    with_dispersions,
    work_bar,
)
from proxops.diagrams.flight import Workers
from proxops.diagrams.logs import FlightLog
from proxops.diagrams.scenario import LearnedLidarConfig, Scenario, load_scenario
from proxops.systems.common import InputError, Progress
from proxops.systems.lidar import FRAME_NETWORK
from proxops.training.data import (
    check_disturbances,
    collect,
    histogram_rows,
    learned_lidar_of,
    parse_mix,
    report_rows,
)


class LidarSource(enum.StrEnum):
    """The lidar that gives the frames in the logs."""

    CAST = "cast"
    LEARNED = "learned"
    PAPER = "paper"
    NONE = "none"


MinariName = Annotated[
    str | None,
    typer.Option(
        help="Also write the flights as a data set of Minari, such as proxops/expert-v0, with "
        "frames if the logs have them. It takes proxops[gym]. No data set may have this name yet."
    ),
]


def collect_command(
    scenario: ScenarioFile = None,
    transits: Annotated[int, typer.Option(min=1, help="Number of flights.")] = 400,
    seed: Annotated[
        int,
        typer.Option(
            min=0, help="Seed of the set of transits; seeds below 10,000 are for training."
        ),
    ] = 0,
    recovery: Annotated[
        str,
        typer.Option(
            help="Mix of flights: paper, full, or kind=weight,kind=weight; see the documentation."
        ),
    ] = "paper",
    lidar: Annotated[
        LidarSource,
        typer.Option(
            help="Frames in the logs. cast: from rays against the mesh; learned, paper: from our "
            "or the paper's network, except in nominal flights, as in the paper; none: no frames."
        ),
    ] = LidarSource.CAST,
    lidar_bundle: Annotated[
        Path | None,
        typer.Option(
            help="Bundle of the learned lidar, from `proxops train-lidar`. Default: "
            "out/lidar/bundle; with --lidar paper, out/lidar/paper_bundle."
        ),
    ] = None,
    minari: MinariName = None,
    settings: ScenarioChanges = None,
    dispersions: DispersionsName = None,
    out: Annotated[Path, typer.Option(help="Folder for the logs and manifest.json.")] = (
        Path("out/collection")
    ),
    workers: Processes = None,
    scheduler: SchedulerAddress = None,
    as_json: AsJson = False,
) -> None:
    """Fly transits with the MPC; write a log of each, manifest.json and a report.

    The MPC knows the true state, unless the scenario says otherwise. Run it again to finish an
    interrupted set: no flight is flown twice. With more --transits it adds to the set.

    Examples:

      proxops collect --transits 400 --out out/paper

      proxops collect --recovery full --seed 1 --transits 1000 --out out/full

      proxops collect --recovery nominal=1,noise=3 --set force_noise.std_n=2 --lidar none

      proxops collect --lidar none --minari proxops/expert-v0 --out out/expert
    """
    mix = parse_mix(recovery)
    check_folder(out)
    _warn_of_seed(seed)
    write = None if minari is None else _minari_writer(minari)
    wanted = load_scenario(scenario, with_dispersions(settings, dispersions), on_true_state=True)
    check_transits_drawn(wanted, settings)
    check_disturbances(wanted, mix)
    wanted = dc.replace(wanted, log_ranges=wanted.log_ranges and lidar != LidarSource.NONE)
    learned = _learned_lidar(lidar, lidar_bundle, wanted)
    with work_bar("preparing the flights") as progress:
        fleet = Workers(workers, scheduler, progress)
        manifest, report = collect(
            wanted, mix, seed, transits, out, learned_lidar=learned, workers=fleet
        )
    if write is not None:
        with work_bar(f"writing them as {minari}") as progress:  # A second for each flight.
            write(_loaded(out, manifest, progress), wanted, seed)
        status.print(f"Wrote them as {minari}: minari.load_dataset({minari!r})")
    if as_json:
        typer.echo(json.dumps(report, indent=2))
    else:
        _print(report)
    logs = len(manifest["flights"])  # Of unflyable worlds there are none.
    status.print(f"Wrote {logs} logs, manifest.json, report.json and report.md in {out}")


def _warn_of_seed(seed: int) -> None:
    if seed >= EVALUATION_SEEDS:
        status.print(
            f"warning: seeds from {EVALUATION_SEEDS:,} on are for evaluation: train nothing on "
            f"the flights of seed {seed}"
        )


def _loaded(out: Path, manifest: dict[str, Any], progress: Progress) -> Iterator[FlightLog]:
    """Reads the logs of a set, one after the other, and reports how many have been used."""
    files, count = [row["file"] for row in manifest["flights"]], len(manifest["flights"])
    for number, file in enumerate(files):
        progress(number / count, f"writing, {number} of {count} flights")
        yield FlightLog.load(out / "flights" / file)


def _learned_lidar(
    source: LidarSource, bundle: Path | None, scenario: Scenario
) -> LearnedLidarConfig | None:
    """The network that gives the frames in the logs; None if none does."""
    if bundle is not None and source not in (LidarSource.LEARNED, LidarSource.PAPER):
        raise InputError(
            f"--lidar-bundle needs --lidar {LidarSource.LEARNED.value} or {LidarSource.PAPER.value}"
        )
    if source == LidarSource.LEARNED:
        bundle = bundle or Path("out/lidar/bundle")
        return learned_lidar_of(scenario, bundle)
    if source == LidarSource.PAPER:
        bundle = bundle or Path("out/lidar/paper_bundle")
        return learned_lidar_of(scenario, bundle, FRAME_NETWORK)
    return None


def _minari_writer(name: str) -> Callable[[Iterable[FlightLog], Scenario, int], object]:
    """Gives what writes flights as a data set of Minari.

    Raises:
      InputError: the data set cannot be made; see `check_minari_name`.
    """
    try:
        from proxops.training.environment import check_minari_name, write_minari
    except ModuleNotFoundError as error:
        raise InputError(
            f"--minari: {error.name} is not installed: run make gym, or pip install 'proxops[gym]'"
        ) from error
    check_minari_name(name)
    return lambda logs, scenario, seed: write_minari(
        name, logs, scenario, seed, "lidar" if scenario.log_ranges else "state"
    )


def _print(report: dict[str, Any]) -> None:
    head, lines = report_rows(report)
    # There are two tables, so that each fits an ordinary terminal.
    for title, columns in (
        (f"expert flights of seed {report['seed']}", range(7)),
        ("their data", [0, *range(7, len(head))]),
    ):
        table = Table(title=title, title_justify="left", box=box.SIMPLE)
        for column in columns:
            table.add_column(head[column], justify="right" if column else "left")
        for line in lines:
            table.add_row(*(line[column] for column in columns))
        console.print(table)
    figures = report["all"]
    for title, edges, counts in (
        ("to the goal", report["goal_distance_edges"], figures["goal_distances"]),
        ("to the keep-out", report["clearance_edges"], figures["clearances"]),
    ):
        parts = [f"{label}: {share}" for label, share in histogram_rows(edges, counts)]
        console.print(f"distance {title}, in radii of arrival: {', '.join(parts)}")
