"""A generated body, written as the files of a body of one's own."""

from __future__ import annotations

from pathlib import Path

from proxops.assets.random_bodies import random_body
from proxops.diagrams.new_body.body_setup import body_yaml
from proxops.diagrams.new_body.shape_examination import examine
from proxops.diagrams.new_body.shape_report import Questions
from proxops.diagrams.scenario import Body
from proxops.systems.common import InputError, make_folder, write_whole
from proxops.systems.shapes import MeshFile, mesh_bytes


def write_generated_body(folder: Path, seed: int, number: int) -> Body:
    """Writes body.obj, in m, and body.yaml of a generated body.

    They are functions of the seed and the number alone.

    Args:
      folder: is made if need be.
      seed: of the bodies.
      number: of the body.

    Returns:
      The body; its `config` names the mesh as body.yaml does.

    Raises:
      InputError: the body is not sound, or a file cannot be written.
    """
    made = random_body(seed, number)
    file = MeshFile(made.vertices, made.facets, f"{made.name}.obj", "m", "OBJ")
    asked = Questions(density_kg_m3=made.density_kg_m3, rotation_period_h=made.rotation_period_h)
    body = examine(file, asked).body
    if body is None:
        raise InputError(f"{made.name} is not sound: take another seed")
    body.config.mesh = "body.obj"
    mesh = mesh_bytes(made.vertices, made.facets, ".obj", f"{made.name}, m: a {made.kind}")
    text = body_yaml(body.config, f"A generated {made.kind}, {made.density_kg_m3:.6g} kg/m^3")
    make_folder(folder)
    write_whole(folder / "body.obj", lambda name: name.write_bytes(mesh))
    write_whole(folder / "body.yaml", lambda name: name.write_text(text, encoding="utf-8"))
    return body
