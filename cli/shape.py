"""`proxops shape`: examines and mends a mesh, and sets up its body."""

from __future__ import annotations

import dataclasses
import json
import os
import re
import typing
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console

from proxops.cli.common import (
    AsJson,
    check_folder,
    console,
    print_rows,
    status,
    work_bar,
)
from proxops.diagrams.scenario import check_constants, dump_changes
from proxops.systems.common import InputError, make_folder, write_json, write_whole
from proxops.systems.shapes import (
    LONGITUDES,
    MESH_FORMATS,
    MeshFile,
    mesh_bytes,
    metres_per,
    read_mesh,
    repair_mesh,
)

# This room imports matplotlib, which is slow, so the functions import it where they use it.
if typing.TYPE_CHECKING:
    from proxops.assets.random_bodies import RandomBody
    from proxops.diagrams.new_body import Questions, ShapeReport


def shape_command(
    mesh_file: Annotated[
        Path | None,
        typer.Argument(
            metavar="[FILE]",
            help="Mesh: OBJ, STL, PLY, VRML, a table of the PDS (plates, ICQ, radii), or DSK; "
            "each may be gzipped.",
        ),
    ] = None,
    random: Annotated[
        str | None,
        typer.Option(
            metavar="SEED:NUMBER",
            help="Generate a body in place of FILE, and write its files to the folder --out.",
        ),
    ] = None,
    unit: Annotated[
        str | None, typer.Option(help="Its unit: mm, cm, m or km. Default: km.")
    ] = None,
    size: Annotated[
        float | None,
        typer.Option(help="Greatest length of the body in m, of a model without a scale."),
    ] = None,
    diameter: Annotated[
        float | None,
        typer.Option(help="In place of --size: diameter in m of the ball of the same volume."),
    ] = None,
    longitude: Annotated[
        str | None,
        typer.Option(help="Which way the longitudes of a table of radii count: east or west."),
    ] = None,
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
    flip: Annotated[
        bool,
        typer.Option(help="With --fix: turn half a turn about x, so that a spin about -z is +z."),
    ] = False,
    body: Annotated[Path | None, typer.Option(help="Write the body's YAML file here.")] = None,
    torque_free: Annotated[
        bool,
        typer.Option(help="With --body: it turns as its inertia makes it, about z at the start."),
    ] = False,
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

      proxops shape --random 1:7 --out out/random-1-7
    """
    from proxops.diagrams.new_body import Questions

    if random is not None:
        others = (mesh_file, unit, size, diameter, longitude, mass, density, period, fix, body)
        given = any(other is not None for other in (*others, scenario))
        if given or align or flip or torque_free or out.suffix.lower() == ".png":
            raise InputError(
                "--random generates mesh, density and period, and writes to a folder: give only "
                "--out, --margin, --craft-mass, --name and --json with it"
            )
        check_folder(out)
        made = _random_body(random)
        mesh_file, unit = _write_generated(made, out), "m"
        density, period = made.density_kg_m3, made.rotation_period_h
        body, scenario = mesh_file.with_suffix(".yaml"), out / "scenario.yaml"
    if mesh_file is None:
        raise InputError("give the mesh file, or --random SEED:NUMBER to generate a body")
    asked = _Asked(
        mesh_file, unit, size, diameter, longitude, fix, align, flip, body, scenario, name, out,
        Questions(mass, density, period, craft_mass, margin, torque_free),
    )  # fmt: skip
    asked.check()
    _set_up(asked, as_json)


# What an option is of no use without.
_NEEDED = {"scenario": "body", "name": "body", "align": "fix", "flip": "fix"}


class _Asked(typing.NamedTuple):
    """What `proxops shape` reads and writes, as its options say."""

    mesh: Path
    unit: str | None
    size: float | None
    diameter: float | None
    longitude: str | None
    fix: Path | None
    align: bool
    flip: bool
    body: Path | None
    scenario: Path | None
    name: str | None
    out: Path
    questions: Questions

    @property
    def picture(self) -> Path:
        """The file of the picture."""
        return self.out if self.out.suffix.lower() == ".png" else self.out / "shape.png"

    def check(self) -> None:
        """Raises `InputError` if options contradict each other, or a file could not be written."""
        given = {
            name: value for name, value in self._asdict().items() if value not in (None, False)
        }
        lengths, known = given.keys() & {"unit", "size", "diameter"}, self.questions
        why = {"body": "it belongs to the body's YAML file", "fix": "it changes the mesh"}
        for option, needed in _NEEDED.items():
            if option in given and needed not in given:
                raise InputError(f"--{option} needs --{needed}: {why[needed]}")
        if known.torque_free and self.body is None:
            raise InputError("--torque-free needs --body: it belongs to the body's YAML file")
        massless = known.mass_kg is None and known.density_kg_m3 is None
        if "body" in given and (massless or known.rotation_period_h is None):
            raise InputError("--body needs --mass or --density, and --period")
        if len(lengths) > 1:
            raise InputError("give one of --unit, --size and --diameter: each says how large it is")
        if known.density_kg_m3 is not None and not lengths:
            raise InputError(
                "--density needs --unit, --size or --diameter: nothing else says how large the "
                "body is"
            )
        if self.longitude not in (None, *LONGITUDES):
            raise InputError(f"--longitude must be {' or '.join(LONGITUDES)}, got {self.longitude}")
        for option in ("size", "diameter", "longitude"):
            if option in given and self.body is not None and self.fix is None:
                raise InputError(
                    f"--{option} with --body needs --fix: the body's YAML file names a mesh, which "
                    "has to be written"
                )
        if self.fix is not None and self.fix.resolve() == self.mesh.resolve():
            raise InputError(f"--fix {self.fix} is the mesh that is read: give another name")
        if self.body and self.scenario and self.body.resolve() == self.scenario.resolve():
            raise InputError(f"--scenario {self.scenario} is the file of --body: give another name")
        yaml = (".yaml", ".yml")
        for option, suffixes in {"fix": MESH_FORMATS, "body": yaml, "scenario": yaml}.items():
            path = given.get(option)
            if path is not None:
                check_folder(path.parent, f"--{option}")
                if path.suffix.lower() not in suffixes:
                    raise InputError(f"{path}: its name must end in {' or '.join(suffixes)}")
        check_folder(self.picture.parent)

    def read(self) -> MeshFile:
        """Reads the mesh."""
        file = read_mesh(self.mesh, self.unit or "km", self.longitude)
        if self.size is None and self.diameter is None:
            return file
        return file.scaled(size=self.size, diameter=self.diameter)


def _random_body(text: str) -> RandomBody:
    from proxops.assets.random_bodies import random_body

    parts = re.fullmatch("([0-9]{1,19}):([0-9]{1,19})", text)
    if parts is None:
        raise InputError(f"--random {text}: it must be SEED:NUMBER, two whole numbers such as 1:7")
    return random_body(*map(int, parts.groups()))


def _write_generated(made: RandomBody, out: Path) -> Path:
    """Writes the mesh of a generated body; returns its path."""
    mesh = out / f"{made.name}.obj"
    comment = f"{made.name}, m: a {made.kind} generated by proxops shape"
    content = mesh_bytes(made.vertices, made.facets, mesh.suffix, comment)
    make_folder(out)
    write_whole(mesh, lambda path: path.write_bytes(content))
    status.print(f"Wrote {mesh}: a {made.kind}")
    return mesh


def _set_up(asked: _Asked, as_json: bool) -> None:
    """Examines and mends the mesh, and writes what is asked for; may exit with code 1."""
    from proxops.diagrams.new_body import examine, plot_shape

    with work_bar("reading") as progress:
        file = asked.read()
        report = examine(file, asked.questions, progress, with_hover=asked.fix is None)
    findings: dict[str, Any] = {}
    if asked.fix is not None:
        findings["before"] = report.to_dict()
        report, findings["repair"] = _mend(report, asked, asked.fix)
    findings = report.to_dict() | findings
    make_folder(asked.picture.parent)
    figure = plot_shape(report)
    write_whole(asked.picture, lambda name: figure.savefig(name, dpi=120, format="png"))
    written = [asked.picture]
    if asked.picture != asked.out:
        written.append(asked.out / "shape.json")
        write_json(written[-1], findings)
    if as_json:
        print(json.dumps(findings, indent=2))
    _print(report, findings, status if as_json else console)
    status.print(f"Wrote {' and '.join(map(str, written))}")
    refused = "refused" in findings.get("repair", {})
    if asked.body is not None and report.body is not None and not refused:
        _write_body(report, asked, asked.body)
    elif asked.body is not None:
        status.print(f"{asked.body} is not written: the mesh is not sound")
    if refused or not report.sound:
        raise typer.Exit(1)


def _mend(report: ShapeReport, asked: _Asked, fix: Path) -> tuple[ShapeReport, dict[str, Any]]:
    """Mends the mesh and writes it.

    Returns:
      The report on the written mesh, or the old report if the mesh cannot be mended; and the
      actions that mended it, or the reason why it cannot be mended.
    """
    from proxops.diagrams.new_body import examine

    file = report.file
    with work_bar("mending") as progress:
        try:
            repair = repair_mesh(file.vertices, file.facets, align=asked.align, flip=asked.flip)
        except InputError as error:
            return report, {"refused": str(error)}
        scale = metres_per(file.unit)
        comment = "\n".join([f"{file.name}, {file.unit}, mended by proxops shape", *repair.actions])
        content = mesh_bytes(repair.vertices / scale, repair.facets, fix.suffix, comment)
        make_folder(fix.parent)
        write_whole(fix, lambda path: path.write_bytes(content))
        mended = examine(read_mesh(fix, file.unit), report.questions, progress)
    sizes = {
        name: {"volume_m3": size.volume, "area_m2": size.area, "extents_m": size.extents.tolist()}
        for name, size in (("before", repair.before), ("after", repair.size))
    }
    return mended, {"out": str(fix), "actions": repair.actions} | sizes


def _print(report: ShapeReport, findings: dict[str, Any], where: Console) -> None:
    from proxops.diagrams.new_body import figure_rows

    def say(text: str) -> None:
        """Prints a text as one line without wrapping, so that a pipe gets whole sentences."""
        where.print(text, highlight=False, soft_wrap=True)

    repair = findings.get("repair", {})
    if "out" in repair:
        for defect in findings["before"]["defects"]:
            say(f"defect before: {defect['text']}")
    for action in repair.get("actions", []):
        say(f"done: {action}")
    if repair.get("actions"):
        say(f"solid: {_change(repair['before'], repair['after'])}")
    if "out" in repair:
        say(f"Wrote {repair['out']}" + ("" if repair["actions"] else ": nothing had to be mended"))
    if "refused" in repair:
        say(f"not mended: {repair['refused']}")
    for defect in report.defects:
        say(f"defect: {defect.about(report.file.name)}")
    for remark in report.remarks:
        say(f"note: {remark}")
    verdict = "sound" if report.sound else _counted(len(report.defects))
    title = f"{report.file.name} ({report.file.format}): {verdict}"
    if where is console:
        print_rows(title, figure_rows(report))


def _change(before: dict[str, Any], after: dict[str, Any]) -> str:
    """What a repair made of volume, area and extents."""
    texts = []
    for key, name, unit in (
        ("volume_m3", "volume", "m³"),
        ("area_m2", "area", "m²"),
        ("extents_m", "extents", "m"),
    ):
        old, new = (
            " × ".join(f"{value:.6g}" for value in np.atleast_1d(each[key]))
            for each in (before, after)
        )
        texts.append(f"{name} {old} → {new} {unit}")
    return ", ".join(texts)


def _counted(kinds: int) -> str:
    return "1 kind of defect" if kinds == 1 else f"{kinds} kinds of defects"


def _write_body(report: ShapeReport, asked: _Asked, path: Path) -> None:
    from proxops.diagrams.new_body import body_yaml, scaled_scenario

    assert report.body is not None
    make_folder(path.parent)
    mesh = asked.mesh if asked.fix is None else asked.fix
    config = dataclasses.replace(
        report.body.config,
        name=asked.name or path.stem,
        mesh=Path(os.path.relpath(mesh, path.parent)).as_posix(),
    )
    check_constants(config, str(path))
    remark = f"Set up by proxops shape from {report.file.name}, {report.questions.margin:g} margin"
    _write(path, body_yaml(config, remark))
    status.print(f"Wrote {path}")
    if (scenario := asked.scenario) is not None:
        make_folder(scenario.parent)
        named = Path(os.path.relpath(path, scenario.parent)).as_posix()
        text = dump_changes(scaled_scenario(report.body, named, report.questions.craft_mass_kg))
        _write(
            scenario, f"# Kleopatra's scenario, scaled to {config.name} by proxops shape\n{text}"
        )
        status.print(f"Wrote {scenario}: proxops fly {scenario}")


def _write(path: Path, text: str) -> None:
    write_whole(path, lambda file: file.write_text(text, encoding="utf-8"))
