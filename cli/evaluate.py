"""`proxops evaluate`: flies controllers on a set of transits and compares them."""

from __future__ import annotations

import dataclasses as dc
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table
from rich.text import Text

from proxops.cli.common import (
    DispersionsName,
    Processes,
    ScenarioChanges,
    ScenarioFile,
    SchedulerAddress,
    check_folder,
    check_transits_drawn,
    coloured,
    complete_controllers,
    console,
    print_remarks,
    status,
    typed_command,
    with_dispersions,
    work_bar,
)
from proxops.diagrams.flight import Row, Workers, made_with, named_controller
from proxops.diagrams.scenario import (
    ArrivalConfig,
    Body,
    Scenario,
    SurveyConfig,
    load_body,
    load_scenario,
    of_transit,
    scenario_transit,
    with_site,
)
from proxops.systems.common import InputError, write_json

if TYPE_CHECKING:
    from proxops.studies.campaigns import Variant
    from proxops.studies.figures import Results


def evaluate_command(
    scenario: ScenarioFile = None,
    controllers: Annotated[
        str,
        typer.Option(
            help="Comma-separated: mpc[:BUNDLE], policy[:BUNDLE], hybrid[:BUNDLE], pd[:BUNDLE], "
            "zero, MODULE:FACTORY. BUNDLE is a folder, or end-to-end: the pilot for Kleopatra that "
            "ships.",
            autocompletion=complete_controllers,
        ),
    ] = "mpc",
    transits: Annotated[
        int, typer.Option(min=1, help="Number of transits that each controller flies.")
    ] = 50,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the set of transits.")] = 10000,
    settings: ScenarioChanges = None,
    dispersions: DispersionsName = None,
    out: Annotated[Path, typer.Option(help="Folder for results.json and the report.")] = Path(
        "out/evaluation"
    ),
    workers: Processes = None,
    scheduler: SchedulerAddress = None,
    keep_logs: Annotated[
        bool, typer.Option("--keep-logs", help="Keep every flight's log.")
    ] = False,
) -> None:
    """Fly a set of transits with each controller; write results.json, report.html and report.md.

    Surveys, touch-and-goes and missions likewise, if the scenario's task is one; surveys are
    compared by their estimators, survey or MODULE:FUNCTION.

    policy:BUNDLE flies the policy of that folder; pd:BUNDLE flies a PD controller on the state that
    this policy estimates. Run it again to continue after an interruption: no flight is flown twice.

    Examples:

      proxops evaluate --controllers mpc --transits 50 --seed 10000 --out out/mpc

      proxops evaluate --controllers mpc,policy:out/paper-policy/bundle,pd,zero --transits 50

      proxops evaluate bennu_mission --dispersions mission --controllers hybrid --transits 8
    """
    # matplotlib is slow to import.
    from proxops.diagrams.surveys import OWN_ESTIMATOR, named_estimator
    from proxops.studies.campaigns import Variant, fly_tasks, makes_a_map

    names = [name.strip() for name in controllers.split(",") if name.strip()]
    if not names or len(set(names)) != len(names):
        raise InputError(f"--controllers {controllers!r} must name each controller once")
    check_folder(out)
    wanted = load_scenario(scenario, with_dispersions(settings, dispersions))
    check_transits_drawn(wanted, settings)
    # Errors are reported now, before workers and folders exist.
    body = load_body(wanted.body)
    wanted = with_site(wanted, body)
    if isinstance(wanted.task, SurveyConfig):
        names = [OWN_ESTIMATOR] if names == ["mpc"] else names  # The default, of transits.
        for name in names:
            named_estimator(name)
        wanted = dc.replace(wanted, dispersions=wanted.dispersions or "first_look")
    else:
        for name in names:
            named_controller(name, wanted, body)
        print_remarks(wanted, body)
    variants = [Variant(name, name) for name in names]
    with work_bar("preparing the flights") as progress:
        fleet = Workers(workers, scheduler, progress)
        if makes_a_map(wanted):
            rows = fly_tasks(variants, wanted, seed, transits, out / "flights", fleet)
        else:
            rows = _flown(variants, wanted, body, seed, transits, out / "flights", keep_logs, fleet)
    _tell(out, rows, wanted, seed, Workers(workers, scheduler))


def _tell(
    out: Path, rows: dict[str, list[Row]], wanted: Scenario, seed: int, workers: Workers
) -> None:
    """Prints the first figures of all rows, and writes results and report."""
    from proxops.studies.figures import aggregate_all  # As above.
    from proxops.studies.report import write_evaluation

    status.print("Aggregating")  # With dispersions, some seconds for each controller.
    results = aggregate_all(rows)
    origin = {"command": typed_command(), **made_with()}
    entries = {name: dc.asdict(each) for name, each in results.items()}
    write_json(out / "results.json", {"provenance": origin, "controllers": entries})
    surveys = isinstance(wanted.task, SurveyConfig)
    count = len(next(iter(rows.values())))
    title = f"{count} {'surveys' if surveys else 'transits'} of seed {seed}"
    console.print(_first_figures(title, results, None if surveys else wanted.arrival))
    with work_bar("writing the report") as progress:
        write_evaluation(
            out, results, wanted, seed, provenance=origin, workers=workers.reporting(progress)
        )
    status.print(f"Wrote results.json, report.html and report.md in {out}")


def _flown(
    variants: list[Variant], wanted: Scenario, body: Body, seed: int, transits: int, folder: Path,
    keep_logs: bool, workers: Workers,
) -> dict[str, list[Row]]:  # fmt: skip
    """The rows of transits or touch-and-goes by each controller."""
    from proxops.studies.campaigns import describe_flight, fly_variants  # As above.
    from proxops.studies.report import may_be_shown

    for index in range(min(transits, 2)):  # One clear transit and one blocked transit.
        scenario_transit(of_transit(wanted, seed, index), body)
    return fly_variants(
        variants, wanted, seed, transits, folder,
        keep_logs=keep_logs or may_be_shown, describe=describe_flight, workers=workers,
    )  # fmt: skip


def _first_figures(title: str, results: Results, arrival: ArrivalConfig | None) -> Table:
    """The table of the first ten figures; the report has all."""
    from proxops.studies.figures import figure_rows  # It is slow to import.

    table = Table(title=title, title_justify="left")
    table.add_column()
    for name in results:
        table.add_column(name, justify="right")
    group = ""
    for row in figure_rows(results, arrival):
        if not row.group:
            continue
        if row.group != group:
            table.add_section()
            group = row.group
        cells = [Text(text, coloured(good)) for text, good in zip(row.cells, row.good, strict=True)]
        table.add_row(row.label, *cells)
    return table
