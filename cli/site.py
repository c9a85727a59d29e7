"""`proxops site`: lists and draws the places of a body that can be touched."""

from __future__ import annotations

import json
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
from proxops.diagrams.scenario import load_body, load_scenario, place_of, touch_map
from proxops.systems.common import check_limits, make_folder, write_json, write_whole
from proxops.systems.touch import SiteLimits, Sites, best_sites

# Least distance of two places of the list, over the body's greatest extent.
_APART = 0.05


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
    wanted = load_scenario(scenario, changes or [])
    body = load_body(wanted.body)
    if at is not None:
        rows = _rows(*place_of(wanted, body, limits, _numbers(at), f"--at {at}"))
        if as_json:
            print(json.dumps(rows, indent=2))
        else:
            print_rows(f"{body.config.name}: can be touched there", list(_named(rows[0])))
        return
    sites, use = touch_map(wanted, body, limits)
    extent = float(body.shape.extents.max())
    best = best_sites(sites, use, count, max(_APART * extent, 2.0 * radius))
    found = _rows(sites.taken(best), use[best])
    if as_json:
        print(json.dumps(found, indent=2))
    else:
        _print_table(body.config.name, use, found)
    make_folder(out)
    write_json(out / "sites.json", found)
    worst = use.max(axis=1)
    figure = plot_sites(body.shape, sites, worst, best, body.config.name)
    write_whole(out / "sites.png", lambda path: figure.savefig(path, dpi=120, format="png"))
    status.print(f"Wrote {out / 'sites.png'} and {out / 'sites.json'}")


def _numbers(at: str) -> list[float]:
    """The numbers of --at; none if it has others."""
    try:
        return [float(part) for part in at.split(",")]
    except ValueError:
        return []


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


def _print_table(name: str, use: np.ndarray, rows: list[dict[str, Any]]) -> None:
    share = float((use.max(axis=1) <= 1.0).mean())
    title = f"{name}: {100.0 * share:.0f} % of the places can be touched"
    table = Table(title=title, title_justify="left")
    table.add_column("", justify="right")
    for figure, _ in _named(rows[0]):
        table.add_column(figure, justify="right")
    for number, row in enumerate(rows, 1):
        table.add_row(str(number), *(value for _, value in _named(row)))
    console.print(table)
