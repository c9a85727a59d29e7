"""`proxops evaluate`: closed-loop figures over a set of transits."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
from rich.table import Table

from proxops.cli.common import check_folder, console, length_text, progress_bar, status, write_json
from proxops.diagrams.body import load_body
from proxops.diagrams.campaign import run_campaign, transit_flights
from proxops.diagrams.scenario import load_scenario
from proxops.diagrams.simulation import named_controller
from proxops.diagrams.transits import draw_transit
from proxops.systems.errors import InputError
from proxops.training.evaluation import aggregate


def evaluate_command(
    scenario: Annotated[
        Path | None, typer.Argument(help="Scenario file (YAML). Default: Kleopatra.")
    ] = None,
    controllers: Annotated[
        str,
        typer.Option(
            help="Comma-separated: mpc, policy, hybrid, policy:FOLDER, hybrid:FOLDER, pd, zero, "
            "MODULE:FACTORY."
        ),
    ] = "mpc",
    transits: Annotated[int, typer.Option(min=1, help="How many transits each flies.")] = 50,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the set of transits.")] = 10000,
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", help="Change a scenario value: key.subkey=value. Repeatable."),
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for results.json.")] = Path("out/evaluation"),
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes. Default: one for each core.")
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(help="Address of a Dask scheduler to fly on instead.")
    ] = None,
    keep_logs: Annotated[bool, typer.Option(help="Keep every flight's log.")] = False,
) -> None:
    """Fly a set of transits with each controller; write results.json.

    Run it again to finish what was interrupted: no flight is flown twice.

    Example:

      proxops evaluate --controllers mpc --transits 50 --seed 10000 --out out/mpc
    """
    names = [name.strip() for name in controllers.split(",") if name.strip()]
    if not names or len(set(names)) != len(names):
        raise InputError(f"--controllers {controllers!r} must name each controller once")
    check_folder(out)
    wanted = load_scenario(scenario, settings or [])
    # Said now, before there are workers and folders.
    body = load_body(wanted.body)
    for name in names:
        named_controller(name, wanted, body)
    for index in range(min(transits, 2)):  # One of each kind: clear, and blocked by the keep-out.
        draw_transit(seed, index, wanted, body)
    flights = {name: transit_flights(wanted, name, seed, transits) for name in names}
    columns = (
        TextColumn("flying"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.description}"),
    )
    with progress_bar(*columns) as bar:
        task = bar.add_task("", total=len(names) * transits)
        failures = 0

        def tell(row: dict) -> None:
            nonlocal failures
            failures += not row["success"]
            bar.update(task, advance=1, description=f"{failures} without success")

        everything = [flight for group in flights.values() for flight in group]
        rows = run_campaign(
            everything,
            out / "flights",
            keep_logs=keep_logs,
            workers=workers,
            scheduler=scheduler,
            progress=tell,
        )
    results = {
        name: aggregate(rows[k * transits : (k + 1) * transits]) for k, name in enumerate(names)
    }
    write_json(out / "results.json", results)
    _print(results, seed)
    status.print(f"Wrote {out / 'results.json'}")


def _success(result: dict) -> str:
    return f"{round(result['success_rate'] * result['transits'])} of {result['transits']}"


def _interval(result: dict) -> str:
    low, high = result["success_rate_interval"]
    return f"{100 * low:.1f} to {100 * high:.1f} %"


_FIGURES: dict[str, Callable[[dict], str]] = {
    "success": _success,
    "success, 95 % interval": _interval,
    "collisions": lambda result: str(result["collisions"]),
    "keep-out violations": lambda result: str(result["keep_out_violations"]),
    "least clearance": lambda result: length_text(result["min_clearance_m"]),
    "end error, median (m)": lambda result: _text(result["terminal_position_error_m_median"]),
    "end error, greatest (m)": lambda result: _text(result["terminal_position_error_m_max"]),
    "end speed, greatest (m/s)": lambda result: _text(result["terminal_speed_m_s_max"], ".3f"),
    "delta-v to arrival, median (m/s)": lambda result: _text(result["delta_v_m_s_median"]),
    "arrival, median (s)": lambda result: _text(result["arrival_time_s_median"], ".0f"),
    "controller, median (ms)": lambda result: _text(result["control_ms_median"], ".2f"),
    "controller, greatest p99 of a flight (ms)": lambda result: _text(
        result["control_ms_p99"], ".2f"
    ),
}


def _print(results: dict, seed: int) -> None:
    table = Table(title=f"transits of seed {seed}", title_justify="left")
    table.add_column()
    for name in results:
        table.add_column(name, justify="right")
    for label, tell in _FIGURES.items():
        table.add_row(label, *(tell(result) for result in results.values()))
    console.print(table)


def _text(value: float | None, form: str = ".1f") -> str:
    return "–" if value is None else format(value, form)
