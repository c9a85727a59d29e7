"""`proxops site`: lists and draws the places of a body that can be touched."""

from __future__ import annotations

import json
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.table import Table

from proxops.cli.common import (
    AsJson,
    ScenarioChanges,
    ScenarioFile,
    check_folder,
    console,
    print_rows,
    status,
)
from proxops.diagrams.scenario import Body, Scenario, load_body, load_scenario, site_world
from proxops.systems.common import (
    InputError,
    Vector3,
    check_limits,
    make_folder,
    write_json,
    write_whole,
)
from proxops.systems.touch import (
    LIMITS,
    SiteLimits,
    Sites,
    SiteWorld,
    best_sites,
    map_sites,
    measured_sites,
    nearest_site,
    place_below,
    place_near,
    use_of_limits,
    why_not,
)

# How far off the map a position may be, in radii of the disc; and the least distance of two places
# of the list, over the body's greatest extent.
_OFF, _APART = 1.0, 0.05


class _Survey(typing.NamedTuple):
    """A map's places, as they were measured."""

    body: Body
    world: SiteWorld
    thrust: float
    limits: SiteLimits
    sites: Sites
    use: np.ndarray


def site_command(
    scenario: ScenarioFile = None,
    at: Annotated[
        str | None,
        typer.Option(
            metavar="LAT,LON|X,Y,Z",
            help="Ask about one place: latitude and longitude in degrees, or a position in m in K.",
        ),
    ] = None,
    count: Annotated[int, typer.Option(min=1, help="Places to list.")] = 10,
    radius: Annotated[float, typer.Option(help="Radius in m of the disc that must be even.")] = 5.0,
    slope: Annotated[float, typer.Option(help="Greatest slope in degrees.")] = 30.0,
    roughness: Annotated[
        float, typer.Option(help="Greatest rms in m of the surface about its plane.")
    ] = 0.5,
    height: Annotated[
        float, typer.Option(help="Greatest height in m of the surface over its plane.")
    ] = 1.5,
    cone: Annotated[
        float, typer.Option(help="Half-angle in degrees of the way down, a cone about the normal.")
    ] = 20.0,
    length: Annotated[float, typer.Option(help="Length in m of the way down.")] = 125.0,
    changes: ScenarioChanges = None,
    out: Annotated[Path, typer.Option(help="Folder for sites.png and sites.json.")] = Path(
        "out/site"
    ),
    as_json: AsJson = False,
) -> None:
    """List the places of a scenario's body that can be touched, the best first, and draw them.

    The best uses the least of its limits. rms and top are of the surface over its plane, in a disc;
    hovering may take half of the thrust.

    Examples:

      proxops site bennu

      proxops site bennu --at 55,40 --radius 3

      proxops site ryugu --slope 15 --set sunlight={} --json
    """
    from proxops.diagrams.plots import plot_sites

    check_folder(out)
    limits = SiteLimits(
        radius_m=radius,
        slope_deg=slope,
        roughness_m=roughness,
        height_m=height,
        cone_deg=cone,
        length_m=length,
    )
    check_limits(limits, "proxops site")
    survey = _surveyed(load_scenario(scenario, changes or []), limits)
    if at is not None:
        place, use = _asked(survey, at)
        found, best = _rows(place, use), None
    else:
        extent = float(survey.body.shape.extents.max())
        best = best_sites(survey.sites, survey.use, count, max(_APART * extent, 2.0 * radius))
        found = _rows(survey.sites.taken(best), survey.use[best])
    if as_json:
        print(json.dumps(found, indent=2))
    elif best is None:
        print_rows(f"{survey.body.config.name}: can be touched there", list(_named(found[0])))
    else:
        _print_table(survey, found)
    if best is None:
        return
    make_folder(out)
    write_json(out / "sites.json", found)
    worst = survey.use.max(axis=1)
    figure = plot_sites(survey.body.shape, survey.sites, worst, best, survey.body.config.name)
    write_whole(out / "sites.png", lambda path: figure.savefig(path, dpi=120, format="png"))
    status.print(f"Wrote {out / 'sites.png'} and {out / 'sites.json'}")


def _surveyed(scenario: Scenario, limits: SiteLimits) -> _Survey:
    """Measures all places.

    Raises:
      InputError: none can be touched; the message says what most of them lack.
    """
    body, thrust = load_body(scenario.body), scenario.spacecraft.thrust_limit_n
    world = site_world(scenario, body)
    sites, _ = map_sites(body.shape, limits, world)
    use = use_of_limits(sites, limits, thrust)
    if (use.max(axis=1) > 1.0).all():
        lacking = LIMITS[int((use > 1.0).sum(axis=0).argmax())]
        near = int(use.max(axis=1).argmin())
        why = "; ".join(why_not(sites, use, near, limits, thrust))
        raise InputError(
            f"no place of {body.config.name} can be touched, most for their {lacking}. The best is "
            f"{_place_text(sites, near)}, but {why}"
        )
    return _Survey(body, world, thrust, limits, sites, use)


def _asked(survey: _Survey, at: str) -> tuple[Sites, np.ndarray]:
    """One place and its use of the limits.

    Raises:
      InputError: it is off the map, or cannot be touched; the message gives the nearest that can.
    """
    shape, limits = survey.body.shape, survey.limits
    try:
        numbers = [float(part) for part in at.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in (2, 3) or not np.isfinite(numbers).all():
        raise InputError(f"--at {at}: give LAT,LON in degrees or X,Y,Z in m, such as 55,40")
    if len(numbers) == 2:
        point, facet = place_below(shape, *numbers)
    else:
        position = np.array(numbers)
        try:
            point, facet = place_near(shape, position, _OFF * limits.radius_m)
        except InputError as error:
            raise InputError(f"--at {at}: {error}; {_nearest_text(survey, position)}") from error
    place = measured_sites(shape, point[None], shape.normals[facet][None], limits, survey.world)
    use = use_of_limits(place, limits, survey.thrust)
    lacking = why_not(place, use, 0, limits, survey.thrust)
    if lacking:
        raise InputError(
            f"--at {at} cannot be touched: {'; '.join(lacking)}; {_nearest_text(survey, point)}"
        )
    return place, use


def _nearest_text(survey: _Survey, position: Vector3) -> str:
    near = nearest_site(survey.sites, survey.use, position)
    assert near is not None
    return f"the nearest place that can be is {_place_text(survey.sites, near)}"


def _place_text(sites: Sites, k: int) -> str:
    return f"{sites.latitudes[k]:.2f},{sites.longitudes[k]:.2f}"


def _rows(sites: Sites, use: np.ndarray) -> list[dict[str, Any]]:
    """Figures of places, for JSON."""
    return [
        {
            "latitude_deg": float(sites.latitudes[k]),
            "longitude_deg": float(sites.longitudes[k]),
            "position_m": sites.positions[k].tolist(),
            "normal": sites.normals[k].tolist(),
            "slope_deg": float(np.degrees(sites.slope[k])),
            "roughness_m": float(sites.roughness[k]),
            "height_m": float(sites.height[k]),
            "hover_n": float(sites.hover[k]),
            "sun_deg": float(np.degrees(sites.light[k])),
            "greatest_share_of_a_limit": float(use[k].max()),
        }
        for k in range(len(sites.positions))
    ]


def _named(row: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Name and value of each figure of a place."""
    yield "lat, lon (°)", f"{row['latitude_deg']:.2f}, {row['longitude_deg']:.2f}"
    yield "position (m)", ", ".join(f"{x:.0f}" for x in row["position_m"])
    yield "slope", f"{row['slope_deg']:.1f}°"
    yield "rms (m)", f"{row['roughness_m']:.3f}"
    yield "top (m)", f"{row['height_m']:.3f}"
    yield "hover (N)", f"{row['hover_n']:.3g}"
    yield "used", f"{100.0 * row['greatest_share_of_a_limit']:.0f} %"


def _print_table(survey: _Survey, rows: list[dict[str, Any]]) -> None:
    share = float((survey.use.max(axis=1) <= 1.0).mean())
    title = f"{survey.body.config.name}: {100.0 * share:.0f} % of the places can be touched"
    table = Table(title=title, title_justify="left")
    table.add_column("", justify="right")
    for name, _ in _named(rows[0]):
        table.add_column(name, justify="right")
    for number, row in enumerate(rows, 1):
        table.add_row(str(number), *(value for _, value in _named(row)))
    console.print(table)
