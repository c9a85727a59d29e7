"""Mesh files: each form in which shape models come, and what is refused."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from plain_polyhedral_gravity import box, star_shaped

from proxops.assets import ASSETS
from proxops.systems.common.errors import InputError
from proxops.systems.shapes.polyhedron import Polyhedron
from proxops.systems.shapes.shape_files import _read_tab, mesh_bytes, read_mesh

VERTICES, FACETS = box(np.array([-1.5, 0.25, 3.0]), np.array([2.0, 1.0, 4.5]))


def _rows(rows: np.ndarray, numbers: int | None = None, form: str = "{}", sign: str = " ") -> str:
    """Lines of a table, each perhaps with its own number, from `numbers` on, before it."""
    lines = []
    for k, row in enumerate(rows.tolist()):
        words = [] if numbers is None else [str(k + numbers)]
        lines.append(sign.join(words + [form.format(x) for x in row]))
    return "\n".join(lines) + "\n"


def _flagged(base: int) -> str:
    vertices = "".join(f"v {x:14.6E} {y:14.6E} {z:14.6E}\r\n" for x, y, z in VERTICES)
    return vertices + "".join(f"f {i:7d} {j:7d} {k:7d}\r\n" for i, j, k in FACETS + base)


LABEL = """PDS_VERSION_ID = PDS3
RECORD_TYPE = FIXED_LENGTH
^VERTEX_TABLE = ("BODY.TAB", 12)
OBJECT = VERTEX_TABLE
  DESCRIPTION = "1 2 3 of no meaning"
END_OBJECT = VERTEX_TABLE
END
"""
TABS = {
    "radar, from 1": (_flagged(1), "v and f lines, from 1"),
    "radar, from 0": (_flagged(0), "v and f lines, from 0"),
    "attached label": (LABEL + _flagged(1), "v and f lines, from 1"),
    "both counts": ("   8  12\n" + _rows(VERTICES) + _rows(FACETS + 1), "counts first, from 1"),
    "both counts, numbered": (
        "8 12\n" + _rows(VERTICES, 1) + _rows(FACETS + 1, 1),
        "counts first, numbered rows, from 1",
    ),
    "numbered from 0": (
        "8 12\n" + _rows(VERTICES, 0) + _rows(FACETS, 0),
        "counts first, numbered rows, from 0",
    ),
    "counts apart, numbered": (
        "8\n" + _rows(VERTICES, 1) + "12\n" + _rows(FACETS + 1, 1),
        "each table after its count, numbered rows, from 1",
    ),
    "Rosetta": (
        "8 12\n" + _rows(VERTICES) + "3\n" + _rows(FACETS + 1).strip().replace("\n", "\n3\n"),
        "counts first, from 1",
    ),
    "bare tables": (_rows(VERTICES) + _rows(FACETS + 1), "two tables without counts, from 1"),
    "commas, Fortran": (
        "8, 12\n" + _rows(VERTICES, form="{:.6e}", sign=", ").replace("e", "D") + _rows(FACETS),
        "counts first, from 0",
    ),
    "remarks": ("# a box\n\n" + _flagged(1) + "\n# end\n", "v and f lines, from 1"),
}


@pytest.mark.parametrize("unit", ["km", "m"])
@pytest.mark.parametrize("form", TABS)
def test_plate_models(tmp_path: Path, form: str, unit: str) -> None:
    text, found = TABS[form]
    path = tmp_path / "BODY.TAB"
    path.write_bytes(text.encode())
    mesh = read_mesh(path, unit)
    np.testing.assert_array_equal(mesh.vertices, VERTICES * {"km": 1e3, "m": 1.0}[unit])
    np.testing.assert_array_equal(mesh.facets, FACETS)
    assert mesh.format == f"PDS plate model ({found}), 8 vertices, 12 facets"
    assert (mesh.name, mesh.unit) == ("BODY.TAB", unit)
    assert Polyhedron.load(path, unit).volume > 0


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "could not be read as a mesh: it holds no rows of numbers"),
        ("# a remark\n\n", "could not be read as a mesh: it holds no rows of numbers"),
        ("8\n" + _rows(VERTICES), "after 8 vertices there is no count of plates"),
        ("8\n" + _rows(VERTICES) + "0\n", "holds no triangles"),
        ("v 0 0 0\nv 1 0 0\n", "holds no triangles"),
        ("8 12\n" + _rows(VERTICES) + _rows(FACETS[:-1] + 1), "counts 8 vertices and 12 plates"),
        ("9 12\n" + _rows(VERTICES) + _rows(FACETS + 1), "counts 9 vertices and 12 plates"),
        ("8 12\n" + _rows(VERTICES) + _rows(FACETS + 1) + "1 2 3\n", "12 plates, but 8 and 13"),
        ("8 12\n" + _rows(VERTICES, 1)[:-30] + _rows(FACETS + 1, 1), "could not be read"),
        (_rows(VERTICES), "holds no triangles"),
        ("8 12\n" + _rows(VERTICES)[1:].replace(" ", " 1 ", 3) + _rows(FACETS), "too few|inhomo"),
        (
            "8 12\n" + _rows(VERTICES, 1).replace("\n4 ", "\n7 ") + _rows(FACETS + 1),
            "do not run on",
        ),
        ("names and words\nof no meaning\n", "could not be read"),
        ("8 12\n" + _rows(VERTICES) + _rows(FACETS + 1, form="{}.5"), "invalid literal"),
    ],
)
def test_plate_models_that_are_none(tmp_path: Path, text: str, complaint: str) -> None:
    path = tmp_path / "body.tab"
    path.write_text(text)
    with pytest.raises(InputError, match=complaint) as caught:
        read_mesh(path)
    assert str(path) in str(caught.value)


def test_obj_as_it_is(tmp_path: Path) -> None:
    """Normals and textures split nothing; negative numbers, polygons, unused vertices, copies."""
    path = tmp_path / "body.obj"
    path.write_text(
        "# words\nmtllib x.mtl\no rock\nv 0 0 0\nv 1 0 0 0.5 0.5 0.5\nvn 0 0 1\nvt 0 0\nv 1 1 0\n"
        "f 1/1/1 2/1/1 \\\n3/1/1\nf -3//1 -2//1 -1//1\nv 0 1 0\nf 1 2 3 4\nv 0 1 0\n"
    )
    mesh = read_mesh(path, "m")
    np.testing.assert_array_equal(
        mesh.vertices, [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 1, 0]]
    )
    np.testing.assert_array_equal(mesh.facets, [[0, 1, 2], [0, 1, 2], [0, 1, 2], [0, 2, 3]])
    assert mesh.format == "OBJ, 5 vertices, 4 facets"


def test_kleopatra_is_read_as_trimesh_reads_it() -> None:
    path = ASSETS / "kleopatra/kleopatra.obj"
    mesh, expected = read_mesh(path), trimesh.load_mesh(path, process=False)
    np.testing.assert_array_equal(mesh.vertices, expected.vertices * 1e3)
    np.testing.assert_array_equal(mesh.facets, expected.faces)


@pytest.mark.parametrize("suffix", [".obj", ".tab", ".ply", ".stl", ".OBJ"])
def test_written_files_read_back(tmp_path: Path, suffix: str) -> None:
    body = star_shaped(7)
    vertices, facets = np.array(body.vertices), np.array(body.faces)
    path = tmp_path / f"body{suffix}"
    path.write_bytes(mesh_bytes(vertices, facets, suffix, "two\nlines"))
    mesh = read_mesh(path, "m")
    exact = suffix.lower() in (".obj", ".tab")
    tolerance = 0.0 if exact else 1e-6
    np.testing.assert_allclose(
        mesh.vertices[mesh.facets], vertices[facets], rtol=0.0, atol=tolerance
    )
    assert mesh.vertices.shape == vertices.shape
    if exact:
        np.testing.assert_array_equal(mesh.facets, facets)
    Polyhedron.load(path, "m")


def test_stl_of_any_size_shares_its_vertices(tmp_path: Path) -> None:
    """Corners become one vertex where they are equal, not where they are close in some unit."""
    body = star_shaped(7)
    for size in (1e-6, 1e6):
        path = tmp_path / "body.stl"
        content = mesh_bytes(np.array(body.vertices) * size, np.array(body.faces), ".stl")
        path.write_bytes(content)
        assert Polyhedron.load(path, "m").vertices.shape == body.vertices.shape


def test_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="does not exist or is not a file"):
        read_mesh(tmp_path / "none.tab")
    with pytest.raises(InputError, match="unit 'mi' is not known"):
        read_mesh(tmp_path / "none.tab", "mi")
    path = tmp_path / "body.gltf"
    path.write_text("{}")
    with pytest.raises(InputError, match=r"use one of \.obj, \.ply, \.stl, \.tab"):
        read_mesh(path)
    with pytest.raises(InputError, match=r"is written as one of .* not '\.gltf'"):
        mesh_bytes(VERTICES, FACETS, ".gltf")


def test_a_label_of_blank_lines_takes_no_time() -> None:
    """With time that grows with the square of the lines, this would take hours."""
    with pytest.raises(ValueError, match=r"."):
        _read_tab("PDS_VERSION_ID" + 1_000_000 * "\n")
