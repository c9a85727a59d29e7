"""Bodies for trials: Kleopatra, generated ones, and those of the user's files."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import trimesh

from proxops.assets.random_bodies import relief
from proxops.diagrams.scenario import Scenario, change_scenario, load_body, load_scenario
from proxops.diagrams.yaml_files import is_yaml_path
from proxops.systems.common import InputError, generator, make_folder, write_whole
from proxops.systems.shapes import mesh_bytes, read_mesh

KLEOPATRA = "kleopatra"
# Of a user's mesh; a body's YAML file says its own.
DENSITY, PERIOD_H = 2000.0, 6.0


class Recipe(NamedTuple):
    """How a body is generated."""

    radii: Callable[[np.ndarray], np.ndarray]
    """Distance of the surface from the origin along unit vectors (N, 3), in any unit."""
    length: float
    """Greatest extent in m."""
    density: float
    """In kg/m^3."""
    period_h: float


def two_ellipsoids(directions: np.ndarray) -> np.ndarray:
    """Two ellipsoids that overlap in a narrow neck; both hold the origin."""
    lobes = (
        (np.array([-0.23, 0.0, 0.0]), np.array([0.27, 0.20, 0.18])),
        (np.array([0.26, 0.02, 0.01]), np.array([0.295, 0.24, 0.21])),
    )
    exits = []
    for centre, axes in lobes:
        d, c = directions / axes, centre / axes
        a, b = np.sum(d**2, axis=1), d @ c
        exits.append((b + np.sqrt(b**2 - a * (c @ c - 1.0))) / a)
    return np.max(exits, axis=0)


def lumpy_ball(directions: np.ndarray) -> np.ndarray:
    """A ball with lumps of 5 % of its radius."""
    return 1.0 + 0.05 * relief(directions, generator(3, 0))


def three_one_one(directions: np.ndarray) -> np.ndarray:
    """An ellipsoid 3:1:1 with a relief of 2 %: without it, nobody could see it roll about x."""
    radii = 1.0 / np.linalg.norm(directions / [3.0, 1.0, 1.0], axis=1)
    return radii * (1.0 + 0.02 * relief(directions, generator(3, 0)))


GENERATED = {
    "two-ellipsoids": Recipe(two_ellipsoids, 500.0, 2000.0, 8.0),
    "lumpy-ball": Recipe(lumpy_ball, 5e3, 1800.0, 5.0),
    "three-one-one": Recipe(three_one_one, 30e3, 2500.0, 7.0),
}


def scenario_at(name: str, folder: Path) -> Scenario:
    """The default scenario at a body, scaled as `proxops shape` scales it; no frames are logged.

    Args:
      name: `kleopatra`, a name of `GENERATED`, SEED:NUMBER of a random body, a body's YAML file, or
        a mesh file in km.
      folder: where files of bodies are written.

    Raises:
      InputError: there is no such body, or the mesh is not sound.
    """
    quiet = {"log_ranges": False}
    if name == KLEOPATRA:
        return load_scenario(None, quiet)
    from proxops.diagrams.new_body import scaled_scenario  # Slow to import.

    path = Path(name)
    if not is_yaml_path(name):
        path = _written(name, folder)
    return change_scenario(scaled_scenario(load_body(str(path)), str(path.resolve())), quiet)


def _written(name: str, folder: Path) -> Path:
    """Writes the YAML file of a generated body, or of that of a mesh file; returns its path."""
    from proxops.diagrams.new_body import (
        Questions,
        body_yaml,
        examine,
        write_generated_body,
    )

    make_folder(folder)
    mesh, density, period, content = Path(name), DENSITY, PERIOD_H, b""
    numbers = re.fullmatch(r"(\d+):(\d+)", name)
    if numbers is not None:
        own = folder / name.replace(":", "-")
        write_generated_body(own, *map(int, numbers.groups()))
        return own / "body.yaml"
    if name in GENERATED:
        recipe = GENERATED[name]
        mesh, density, period = folder / f"{name}.obj", recipe.density, recipe.period_h
        ball = trimesh.creation.icosphere(4)
        vertices = ball.vertices * recipe.radii(ball.vertices)[:, None]
        vertices *= 1e-3 * recipe.length / np.ptp(vertices, axis=0).max()
        content = mesh_bytes(vertices, ball.faces, ".obj")
    if content:
        write_whole(mesh, lambda path: path.write_bytes(content))
    report = examine(
        read_mesh(mesh, "km"), Questions(density_kg_m3=density, rotation_period_h=period)
    )
    if report.body is None:
        found = "; ".join(defect.about(mesh.name) for defect in report.defects)
        raise InputError(f"{mesh} is no sound mesh: {found}")
    config = report.body.config
    config.mesh = str(mesh.resolve())
    written = folder / f"{mesh.stem}.yaml"
    text = body_yaml(config, f"{mesh.name}, {density:g} kg/m^3")
    write_whole(written, lambda path: path.write_text(text, encoding="utf-8"))
    return written
