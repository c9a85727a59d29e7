"""`proxops survey`: makes a map of a body of which an ellipsoid is known, and its scenario."""

from __future__ import annotations

import dataclasses as dc
import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from proxops.cli.common import (
    AsJson,
    DispersionsName,
    ScenarioChanges,
    ScenarioFile,
    check_folder,
    print_rows,
    status,
    with_dispersions,
    work_bar,
)
from proxops.diagrams.scenario import Scenario, SurveyConfig, load_body, load_scenario
from proxops.systems.common import InputError, compiling_told

if TYPE_CHECKING:
    from proxops.diagrams.surveys import Surveyed


def survey_command(
    scenario: ScenarioFile = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the survey.")] = 10000,
    hours: Annotated[
        float | None, typer.Option(help="Most time in orbit in h. Default: 24.")
    ] = None,
    visits: Annotated[
        str | None,
        typer.Option(help="Scenario of the visits, such as bennu_touch_and_go. Default: transits."),
    ] = None,
    settings: ScenarioChanges = None,
    dispersions: DispersionsName = None,
    out: Annotated[Path, typer.Option(help="Folder for all files.")] = Path("out/survey"),
    movie: Annotated[
        Path | None, typer.Option(help="A film of the map as it grows: a WebP, GIF or MP4.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Survey a body that is known as an ellipsoid; write its map, body file and scenario.

    Without --dispersions and those of the scenario, the world is drawn from first_look. Run it
    again to continue after an interruption: the flight is not flown twice. It ends when the map is
    good enough, by what it says itself: see task.enough.

    Examples:

      proxops survey --out out/survey

      proxops survey bennu --dispersions approach --hours 30 --out out/approach

      proxops survey bennu --visits bennu_touch_and_go --out out/bennu
    """
    # matplotlib is slow to import.
    from proxops.diagrams.meshcat import check_film
    from proxops.diagrams.surveys import run_survey
    from proxops.studies.report import write_survey_film

    check_folder(out)
    if movie is not None:
        check_film(movie)
    wanted = load_scenario(scenario, with_dispersions(settings, dispersions))
    if not isinstance(wanted.task, SurveyConfig):
        wanted = dc.replace(wanted, task=SurveyConfig())
    if hours is not None:
        wanted = dc.replace(wanted, task=dc.replace(wanted.task, hours=hours))
    name = wanted.dispersions or "first_look"
    transit = dc.replace(wanted.transit, seed=seed)
    wanted = dc.replace(wanted, dispersions=name, transit=transit)
    after = None if visits is None else load_scenario(visits)
    if after is not None and after.body != wanted.body:
        raise InputError(f"--visits: {visits} is at {after.body}, not at {wanted.body}")
    with work_bar("surveying") as progress, compiling_told(progress):
        surveyed = run_survey(wanted, load_body(wanted.body), out, progress, after)
        rows = report_survey(out, wanted, surveyed)
        if movie is not None:
            progress(0.99, "drawing the film")
            write_survey_film(movie, surveyed)
    if as_json:
        typer.echo(json.dumps(surveyed.figures, indent=2))
    else:
        print_rows(f"survey of {wanted.body}, seed {seed}", rows)
    status.print(
        f"Wrote map.obj, body.yaml, expected.yaml, visit.yaml, survey.json and report.html in {out}"
    )


def report_survey(out: Path, scenario: Scenario, surveyed: Surveyed) -> list[tuple[str, str]]:
    """Writes the report of a survey into a folder; gives its figures as names and texts."""
    from proxops.studies.report import write_survey_report  # As above.

    rows = _rows(surveyed.figures)
    title = f"Survey of {surveyed.flight.world.body.config.name}, seed {scenario.transit.seed}"
    write_survey_report(out, title, surveyed, rows)
    return rows


def _rows(figures: dict[str, Any]) -> list[tuple[str, str]]:
    share = "{:.3%}".format
    return [
        ("map against the truth, rms over the length", share(figures["map_rms_of_size"])),
        ("as it says itself", share(figures["deviation_of_size"])),
        ("surface within 3 sigma", share(figures["within_3_sigma"])),
        ("surface seen", share(figures["covered"])),
        ("relative error of GM, and 1 sigma", _pair(figures, "gravity", "")),
        ("error of the pole in degrees, and 1 sigma", _pair(figures, "pole", "_deg")),
        ("relative error of the spin rate, and 1 sigma", _pair(figures, "rate", "")),
        ("returns used", f"{figures['returns']}"),
        ("time in orbit", f"{figures['hours']:.3g} h"),
        ("Δv", f"{figures['delta_v_m_s']:.3g} m/s"),
        ("entries of the keep-out sphere", f"{figures['keep_out_entries']}"),
        ("interventions of runtime assurance", f"{figures['interventions']}"),
        ("least clearance of the keep-out ellipsoid", f"{figures['least_clearance_m']:.4g} m"),
        (
            "computed: flight, estimation",
            f"{figures['flight_s']:.0f} s, {figures['estimation_s']:.0f} s",
        ),
    ]


def _pair(figures: dict[str, Any], name: str, unit: str) -> str:
    return f"{figures[f'{name}_error{unit}']:.2e}, {figures[f'{name}_deviation{unit}']:.2e}"
