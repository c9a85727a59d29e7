"""`proxops shape`: examines and mends a mesh, and sets up its body."""

from __future__ import annotations

import dataclasses
import json
import os
import typing
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from proxops.cli.common import (
    AsJson,
    check_folder,
    console,
    print_rows,
    status,
    write_json,
)
from proxops.diagrams.scenario import dump_scenario
from proxops.systems.common import InputError, make_folder, write_whole
from proxops.systems.shapes import (
    MESH_FORMATS,
    MeshFile,
    mesh_bytes,
    metres_per,
    read_mesh,
    repair_mesh,
)

# This room imports matplotlib, which is slow, so the functions import it where they use it.
if typing.TYPE_CHECKING:
    from proxops.diagrams.new_body import ShapeReport


def shape_command(
    mesh_file: Annotated[
        Path, typer.Argument(metavar="FILE", help="Mesh: OBJ, STL, PLY or PDS .tab.")
    ],
    unit: Annotated[str, typer.Option(help="Unit of the numbers in the file: km or m.")] = "km",
    mass: Annotated[float | None, typer.Option(help="Mass of the body in kg.")] = None,
    density: Annotated[
        float | None, typer.Option(help="Density of the body in kg/m^3, in place of --mass.")
    ] = None,
    period: Annotated[float | None, typer.Option(help="Rotation period about z in h.")] = None,
    margin: Annotated[
        float, typer.Option(help="Share added to each semi-axis of the keep-out ellipsoid.")
    ] = 0.05,
    craft_mass: Annotated[float, typer.Option(help="Mass of the spacecraft in kg.")] = 100.0,
    fix: Annotated[
        Path | None, typer.Option(help="Write the mended mesh to this file, in the same unit.")
    ] = None,
    align: Annotated[
        bool, typer.Option(help="With --fix: turn the principal axes onto x, y, z.")
    ] = False,
    body: Annotated[Path | None, typer.Option(help="Write the body's YAML file here.")] = None,
    scenario: Annotated[
        Path | None,
        typer.Option(help="With --body: write a scenario here that is scaled to the body."),
    ] = None,
    name: Annotated[
        str | None, typer.Option(help="Name of the body. Default: the name of its YAML file.")
    ] = None,
    out: Annotated[
        Path, typer.Option(help="Folder for shape.png and shape.json, or a .png file.")
    ] = Path("out/shape"),
    as_json: AsJson = False,
) -> None:
    """Examine a mesh, mend it, and set up its body for flights.

    Exit codes: 0 sound, 1 defects found, 2 bad input.

    Examples:

      proxops shape eros.tab --mass 6.687e15 --period 5.27

      proxops shape scan.stl --unit m --density 1900 --period 9 --fix rock.obj --body rock.yaml
    """
    from proxops.diagrams.new_body import Questions, examine

    if scenario is not None and body is None:
        raise InputError("--scenario needs --body: a scenario names the YAML file of its body")
    if align and fix is None:
        raise InputError("--align needs --fix: it changes the mesh")
    if body is not None and ((mass is None and density is None) or period is None):
        raise InputError("--body needs --mass or --density, and --period")
    _check_output(fix, MESH_FORMATS)
    _check_output(body, (".yaml", ".yml"))
    _check_output(scenario, (".yaml", ".yml"))
    picture = out if out.suffix.lower() == ".png" else out / "shape.png"
    check_folder(picture.parent)
    asked = Questions(mass, density, period, craft_mass, margin)
    found = read_mesh(mesh_file, unit)
    report = examine(found, asked)
    findings: dict[str, Any] = {}
    if fix is not None:
        findings["before"] = report.to_dict()
        report, findings["repair"] = _mend(report, fix, align)
    findings = report.to_dict() | findings
    make_folder(picture.parent)
    _draw(report, picture)
    if picture != out:
        write_json(out / "shape.json", findings)
    if as_json:
        print(json.dumps(findings, indent=2))
    _print(report, findings, status if as_json else console)
    status.print(f"Wrote {picture}" + ("" if picture == out else f" and {out / 'shape.json'}"))
    refused = "refused" in findings.get("repair", {})
    if body is not None and report.body is not None and not refused:
        mesh_path = fix if fix is not None else mesh_file
        _write_body(report, mesh_path, body, scenario, name)
    elif body is not None:
        status.print(f"{body} is not written: the mesh is not sound")
    if refused or not report.sound:
        raise typer.Exit(1)


def _check_output(path: Path | None, suffixes: tuple[str, ...]) -> None:
    """Raises `InputError` if a file, where one is asked for, could not be written or named so."""
    if path is None:
        return
    check_folder(path.parent)
    if path.suffix.lower() not in suffixes:
        raise InputError(f"{path}: its name must end in {' or '.join(suffixes)}")


def _mend(report: ShapeReport, fix: Path, align: bool) -> tuple[ShapeReport, dict[str, Any]]:
    """Mends the mesh and writes it.

    Returns:
      The report on the written mesh, or the old report if the mesh cannot be mended; and the
      actions that mended it, or the reason why it cannot be mended.
    """
    from proxops.diagrams.new_body import examine

    file = report.file
    try:
        repair = repair_mesh(file.vertices, file.facets, align=align)
    except InputError as error:
        return report, {"refused": str(error)}
    scale = metres_per(file.unit)
    comment = "\n".join([f"{file.name}, {file.unit}, mended by proxops shape", *repair.actions])
    content = mesh_bytes(repair.vertices / scale, repair.facets, fix.suffix, comment)
    make_folder(fix.parent)
    write_whole(fix, lambda path: path.write_bytes(content))
    mended: MeshFile = read_mesh(fix, file.unit)
    return examine(mended, report.questions), {"out": str(fix), "actions": repair.actions}


def _draw(report: ShapeReport, path: Path) -> None:
    from proxops.diagrams.new_body import plot_shape

    figure = plot_shape(report)
    write_whole(path, lambda name: figure.savefig(name, dpi=120, format="png"))


def _print(report: ShapeReport, findings: dict[str, Any], where: Console) -> None:
    from proxops.diagrams.new_body import figure_rows

    def say(text: str) -> None:
        """Prints a text as one line without wrapping, so that a pipe gets whole sentences."""
        where.print(text, highlight=False, soft_wrap=True)

    for defect in findings.get("before", {}).get("defects", []):
        say(f"defect before: {defect['text']}")
    repair = findings.get("repair", {})
    for action in repair.get("actions", []):
        say(f"done: {action}")
    if "out" in repair:
        say(f"Wrote {repair['out']}" if repair["actions"] else "nothing had to be mended")
    if "refused" in repair:
        say(f"not mended: {repair['refused']}")
    for defect in report.defects:
        say(f"defect: {defect.about(report.file.name)}")
    for remark in report.remarks:
        say(f"note: {remark}")
    verdict = "sound" if report.sound else f"{len(report.defects)} kinds of defects"
    title = f"{report.file.name} ({report.file.format}): {verdict}"
    if where is console:
        print_rows(title, figure_rows(report))


def _write_body(
    report: ShapeReport, mesh: Path, path: Path, scenario: Path | None, name: str | None
) -> None:
    from proxops.diagrams.new_body import body_yaml, scaled_scenario

    assert report.body is not None
    make_folder(path.parent)
    config = dataclasses.replace(
        report.body.config,
        name=name or path.stem,
        mesh=Path(os.path.relpath(mesh, path.parent)).as_posix(),
    )
    remark = f"Set up by proxops shape from {report.file.name}, {report.questions.margin:g} margin"
    write_whole(path, lambda file: file.write_text(body_yaml(config, remark), encoding="utf-8"))
    status.print(f"Wrote {path}")
    if scenario is not None:
        make_folder(scenario.parent)
        named = Path(os.path.relpath(path, scenario.parent)).as_posix()
        text = dump_scenario(scaled_scenario(report.body, named, report.questions.craft_mass_kg))
        remark = f"# Kleopatra's scenario, scaled to {config.name} by proxops shape\n"
        write_whole(scenario, lambda file: file.write_text(remark + text, encoding="utf-8"))
        status.print(f"Wrote {scenario}: proxops fly {scenario}")
