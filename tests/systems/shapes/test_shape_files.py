"""Mesh files: each form in which shape models come, and what is refused."""

import gzip
import struct
from pathlib import Path

import numpy as np
import pytest
import spiceypy
import trimesh
from plain_polyhedral_gravity import box, star_shaped
from short_flights import obj_text

from proxops.assets import ASSETS
from proxops.systems.common.errors import InputError
from proxops.systems.shapes import Polyhedron, mesh_bytes, read_mesh, self_intersections

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


@pytest.mark.parametrize("form", TABS)
def test_plate_models(tmp_path: Path, form: str) -> None:
    text, found = TABS[form]
    path = tmp_path / "BODY.TAB"
    path.write_bytes(text.encode())
    mesh = read_mesh(path, "km")
    np.testing.assert_array_equal(mesh.vertices, VERTICES * 1e3)
    np.testing.assert_array_equal(mesh.facets, FACETS)
    assert mesh.format == f"PDS plate model ({found}), 8 vertices, 12 facets"
    assert (mesh.name, mesh.unit) == ("BODY.TAB", "km")
    assert Polyhedron.load(path, "km").volume > 0


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "could not be read as a mesh: it is empty"),
        ("8\n" + _rows(VERTICES), "after 8 vertices there is no count of plates"),
        ("8 12\n" + _rows(VERTICES) + _rows(FACETS[:-1] + 1), "counts 8 vertices and 12 plates"),
        ("8 12\n" + _rows(VERTICES, 1)[:-30] + _rows(FACETS + 1, 1), "could not be read"),
        (_rows(VERTICES), "holds no triangles"),
        ("# a remark\n\n", "it holds no rows of numbers"),
        (
            "8 12\n" + _rows(VERTICES)[1:].replace(" ", " 1 ", 3) + _rows(FACETS),
            "line 2: a row has too few or too many",
        ),
        (
            "8 12\n" + _rows(VERTICES, 1).replace("\n4 ", "\n7 ") + _rows(FACETS + 1),
            "do not run on",
        ),
        (
            "8 12\n" + _rows(VERTICES) + _rows(FACETS + 1, form="{}.5"),
            "line 10: '1.5' is no whole number",
        ),
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
    with pytest.raises(InputError, match=r"use one of \.obj, \.ply, \.stl, \.wrl, \.bds, \.tab, "):
        read_mesh(path)
    with pytest.raises(InputError, match=r"is written as one of .* not '\.gltf'"):
        mesh_bytes(VERTICES, FACETS, ".gltf")


BODY = star_shaped(7)
POINTS, TRIANGLES = np.array(BODY.vertices), np.array(BODY.faces)


@pytest.mark.parametrize("suffix", [".obj", ".tab"])
@pytest.mark.parametrize(
    "content",
    [
        obj_text(BODY).encode("utf-8-sig"),
        obj_text(BODY).encode("utf-16"),
        ("# gr\xf6\xdfe in km\x85\n" + obj_text(BODY)).encode("latin-1"),
        obj_text(BODY).replace("\n", "\r").encode(),
        obj_text(BODY).replace("\n", " # remark\r\n").encode(),
    ],
    ids=["UTF-8 with a mark", "UTF-16", "Latin-1", "CR", "remarks"],
)
def test_text_as_people_save_it(tmp_path: Path, suffix: str, content: bytes) -> None:
    path = tmp_path / f"body{suffix}"
    path.write_bytes(content)
    mesh = read_mesh(path, "m")
    np.testing.assert_array_equal(mesh.vertices, POINTS)
    np.testing.assert_array_equal(mesh.facets, TRIANGLES)


@pytest.mark.parametrize("suffix", [".obj", ".tab", ".ply", ".stl"])
def test_gzip(tmp_path: Path, suffix: str) -> None:
    plain, packed = tmp_path / f"body{suffix}", tmp_path / f"body{suffix}.gz"
    content = mesh_bytes(POINTS, TRIANGLES, suffix)
    plain.write_bytes(content)
    packed.write_bytes(gzip.compress(content))
    expected, mesh = read_mesh(plain), read_mesh(packed)
    np.testing.assert_array_equal(mesh.vertices, expected.vertices)
    np.testing.assert_array_equal(mesh.facets, expected.facets)
    packed.write_bytes(gzip.compress(content)[:-40])
    with pytest.raises(InputError, match=r"could not be read as a mesh: .*end"):
        read_mesh(packed)


L_FORM = np.array([[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2.0]])
L_VERTICES = np.vstack([np.c_[L_FORM, np.zeros(6)], np.c_[L_FORM, np.ones(6)]])


def _l_faces(start: int) -> list[list[int]]:
    """The faces of an L-shaped prism; the corners of both L begin at `start`."""
    top = np.roll(np.arange(6, 12), start).tolist()
    return [np.roll(np.arange(6)[::-1], start).tolist(), top] + [
        [k, (k + 1) % 6, (k + 1) % 6 + 6, k + 6] for k in range(6)
    ]


@pytest.mark.parametrize("start", [0, 3])
@pytest.mark.parametrize("suffix", [".obj", ".ply", ".wrl"])
def test_polygons_that_are_not_convex(tmp_path: Path, suffix: str, start: int) -> None:
    faces, rows = _l_faces(start), [" ".join(map(str, row)) for row in L_VERTICES.tolist()]
    text = {
        ".obj": "".join(f"v {row}\n" for row in rows)
        + "".join(f"f {' '.join(str(c + 1) for c in face)}\n" for face in faces),
        ".ply": "ply\nformat ascii 1.0\nelement vertex 12\nproperty float x\nproperty float y\n"
        "property float z\nelement face 8\nproperty list uchar int vertex_index\nend_header\n"
        + "\n".join(rows)
        + "\n"
        + "".join(f"{len(face)} {' '.join(map(str, face))}\n" for face in faces),
        ".wrl": "#VRML V2.0 utf8\nShape { geometry IndexedFaceSet { coord Coordinate { point [ "
        + ", ".join(rows)
        + " ] } coordIndex [ "
        + ", ".join(", ".join(map(str, face)) + ", -1" for face in faces)
        + " ] } }",
    }[suffix]
    path = tmp_path / f"body{suffix}"
    path.write_text(text)
    shape = Polyhedron.load(path, "m")
    assert shape.volume == pytest.approx(3.0, rel=1e-12)
    assert len(shape.facets) == 20
    assert not len(self_intersections(shape.vertices, shape.facets))


@pytest.mark.parametrize(
    ("polygon", "complaint"),
    [
        ("v 0 0 0\nv 1 0 0\nv 1 1 0.4\nv 0 1 0\nf 1 2 3 4\n", "line 5: a polygon is not planar"),
        ("v 0 0 0\nv 3 2 0\nv 3 0 0\nv 0 1 0\nf 1 2 3 4\n", "line 5: a polygon crosses itself"),
        ("v 0 0 0\nv 1 1 0\nv 1 0 0\nv 0 1 0\nf 1 2 3 4\n", "line 5: a polygon has no area"),
        ("v 0 0 0\nv 1 0 0\n\nv 1 1 0\nf 1 2\n", "line 5: a facet has fewer than 3 corners"),
        ("v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 9\n", "line 4: a facet names a vertex .* there are 3"),
        ("v 0 0 0\nv 1 0 0\nv 1 1 0\nf 0 1 2\n", "line 4: a facet names vertex 0; the first is 1"),
        ("v 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 3\n", "line 1: a vertex has 3 coordinates, not 2"),
        ("v 0 0 x\nv 1 0 0\nv 1 1 0\nf 1 2 3\n", "line 1: 'x' is no number"),
        ("v 0 0 0\nw 1 0 0\nv 1 1 0\nf 1 2 3\n", "line 2: lines that begin with 'w' are not"),
        ("v 0,5 0 1\nv 1 0 0\nv 1 1 0\nf 1 2 3\n", r"line 1: 0,5 has a decimal .* point, 0\.5"),
    ],
)
def test_a_line_that_is_not_understood_is_named(
    tmp_path: Path, polygon: str, complaint: str
) -> None:
    path = tmp_path / "body.obj"
    path.write_text(polygon)
    with pytest.raises(InputError, match=complaint):
        read_mesh(path)


def _binary_ply(order: str, more: bytes = b"") -> bytes:
    """Vertices with a colour, faces with texture coordinates of each corner, as tools write it."""
    header = (
        b"ply\nformat binary_%s_endian 1.0\n" % (b"little" if order == "<" else b"big")
        + b"comment gr\xf6\xdfe\n"
        + b"comment TextureFile rock.png\nelement vertex %d\nproperty double x\nproperty double y\n"
        b"property double z\nproperty uchar red\nelement face %d\n"
        b"property list uchar int vertex_indices\nproperty list uchar float texcoord\nend_header\n"
        % (len(POINTS), len(TRIANGLES))
    )
    body = b"".join(struct.pack(f"{order}3dB", *row, 7) for row in POINTS.tolist())
    for k, row in enumerate(TRIANGLES.tolist()):
        # Lists of different lengths, so that rows have different lengths, too.
        pairs = [0.5] * (6 if k % 3 else 0)
        body += struct.pack(f"{order}B3iB{len(pairs)}f", 3, *row, len(pairs), *pairs)
    return header + body + more


@pytest.mark.parametrize("content", [_binary_ply("<"), _binary_ply(">"), _binary_ply("<", b"\0")])
def test_ply_is_read_as_it_is(tmp_path: Path, content: bytes, capsys) -> None:
    """Texture splits no vertex, no image is looked for; a byte too many does no harm."""
    path = tmp_path / "body.ply"
    path.write_bytes(content)
    mesh = read_mesh(path, "m")
    np.testing.assert_array_equal(mesh.vertices, POINTS)
    np.testing.assert_array_equal(mesh.facets, TRIANGLES)
    assert capsys.readouterr() == ("", "")
    path.write_bytes(content[:-60])
    with pytest.raises(InputError, match=r"face announced, \d+ there: the file is cut"):
        read_mesh(path)
    path.write_bytes(b"noise")
    with pytest.raises(InputError, match="no header of a PLY file"):
        read_mesh(path)


def test_stl_that_is_cut(tmp_path: Path) -> None:
    path = tmp_path / "body.stl"
    content = mesh_bytes(POINTS, TRIANGLES, ".stl")
    path.write_bytes(content[: -50 * 20])
    count = len(TRIANGLES)
    with pytest.raises(InputError, match=f"{count} facets announced, {count - 20} there: .* cut"):
        read_mesh(path)
    text = trimesh.Trimesh(POINTS, TRIANGLES, process=False).export(file_type="stl_ascii")
    assert isinstance(text, str)
    path.write_text(text)
    assert read_mesh(path, "m").facets.shape == TRIANGLES.shape
    path.write_text(text[: len(text) // 2])
    with pytest.raises(InputError, match=r"facets begin, .* endsolid is missing"):
        read_mesh(path)


def _cube_sphere(q: int, turned: bool) -> tuple[np.ndarray, str]:
    """An ICQ model of an ellipsoid: its vertices on six faces, and the text of its file.

    The cube's faces are laid out as Gaskell's document says, or each by its own axes.
    """
    i, j = np.meshgrid(np.arange(q + 1), np.arange(q + 1))  # i is the faster one.
    low, high = 0 * i, 0 * i + q
    faces = [
        (i, j, low), (i, high, j), (low, i, j), (q - i, low, j), (high, q - i, j), (i, q - j, high),
    ]  # fmt: skip
    if turned:
        faces = [faces[k] if k % 2 else tuple(axis.T for axis in faces[k]) for k in range(6)]
    cube = np.array([np.stack(face, axis=2).reshape(-1, 3) for face in faces]).reshape(-1, 3)
    # Gaskell's first face is the northern one.
    points = np.tan((cube / q - 0.5) * np.pi / 2) * [1.0, -1.0, -1.0]
    points *= np.array([300.0, 200.0, 150.0]) / np.linalg.norm(points, axis=1)[:, None]
    rows = "".join("".join(f"{x:16.5f}" for x in row) + "\n" for row in points)
    return points, f"{q:12d}\n{rows}"


@pytest.mark.parametrize("name", ["SHAPE.ICQ", "body.txt.gz"])
@pytest.mark.parametrize("turned", [False, True])
def test_icq_models(tmp_path: Path, name: str, turned: bool) -> None:
    path, (_, text) = tmp_path / name, _cube_sphere(12, turned)
    path.write_bytes(gzip.compress(text.encode()) if name.endswith(".gz") else text.encode())
    shape = Polyhedron.load(path, "m")
    assert (len(shape.vertices), len(shape.facets)) == (6 * 12**2 + 2, 12 * 12**2)
    assert shape.volume == pytest.approx(4 / 3 * np.pi * 300 * 200 * 150, rel=0.02)
    assert not len(self_intersections(shape.vertices, shape.facets))
    path = tmp_path / "cut.txt"
    path.write_text(text[: len(text) // 2])
    with pytest.raises(InputError, match="of an ICQ model 1014 vertices would follow, not"):
        read_mesh(path)
    head, _, others = text.split("\n", 2)
    path.write_text(f"{head}\n1.0 2.0 3.0\n{others}")
    with pytest.raises(InputError, match="the vertices on common edges of the faces are not"):
        read_mesh(path)


@pytest.mark.parametrize("longitudes", ["east", "west"])
@pytest.mark.parametrize("poles", ["at each longitude", "once", "none"])
@pytest.mark.parametrize("swapped", [True, False])
def test_tables_of_radii(tmp_path: Path, longitudes: str, poles: str, swapped: bool) -> None:
    """An ellipsoid with a bump at 40 degrees east."""
    latitudes = np.linspace(-87.5, 87.5, 36) if poles == "none" else np.linspace(-90, 90, 37)
    b, a = np.meshgrid(latitudes, np.arange(0, 361, 5), indexing="ij")
    east = np.radians(a if longitudes == "east" else -a)
    unit = [np.cos(np.radians(b)) * np.cos(east), np.cos(np.radians(b)) * np.sin(east)]
    unit = np.stack([*unit, np.sin(np.radians(b))], axis=2)
    radii = 1 / np.linalg.norm(unit / [300.0, 200.0, 150.0], axis=2)
    bump = np.array([np.cos(np.radians(40)), np.sin(np.radians(40)), 0.0])
    radii += np.where(unit @ bump > 0.995, 100.0, 0.0)
    columns = [a, b, radii] if swapped else [b, a, radii]
    table = np.stack(columns, axis=2).reshape(-1, 3)
    if poles == "once":
        table = table[(np.abs(b.reshape(-1)) < 90.0) | (a.reshape(-1) == 0.0)]
    path = tmp_path / "body.tab"
    np.savetxt(path, table, fmt="%12.6f")
    with pytest.raises(InputError, match="--longitude east"):
        Polyhedron.load(path, "m")
    mesh = read_mesh(path, "m", longitudes)
    shape = Polyhedron(mesh.vertices, mesh.facets)
    assert shape.volume == pytest.approx(4 / 3 * np.pi * 300 * 200 * 150, rel=0.03)
    farthest = shape.vertices[np.argmax(shape.vertices @ bump)]
    assert farthest @ bump > 0.99 * np.linalg.norm(farthest)


def test_dsk(tmp_path: Path) -> None:
    """A kernel as SPICE itself writes it."""
    path = tmp_path / "body.bds"
    plates = TRIANGLES + 1
    handle = spiceypy.dskopn(str(path), "body", 0)
    spaix_double, spaix_int = spiceypy.dskmi2(
        POINTS, plates, 0.5, 5, 100_000, 100_000, 20_000, False, 500_000
    )
    spiceypy.dskw02(
        handle, 399, 399, 2, "IAU_EARTH", 1, np.zeros(10), -np.pi, np.pi, -1.5, 1.5, 0.0, 10.0,
        0.0, 1e9, POINTS, plates, spaix_double, spaix_int,
    )  # fmt: skip
    spiceypy.dskcls(handle, True)
    mesh = read_mesh(path)
    np.testing.assert_array_equal(mesh.vertices, POINTS * 1e3)
    np.testing.assert_array_equal(mesh.facets, TRIANGLES)
    path.write_bytes(path.read_bytes()[:3000])
    with pytest.raises(InputError, match="SPICE does not read it"):
        read_mesh(path)


@pytest.mark.parametrize(
    ("content", "what"),
    [
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 1\n", "git lfs pull"),
        (b"\n<!DOCTYPE HTML><html><body>404 Not Found</body></html>", "a web page"),
        (gzip.compress(obj_text(BODY).encode()), r"compressed by gzip: .* \.gz"),
        (b"PK\x03\x04....", "a ZIP archive"),
        (b"ply\nformat ascii 1.0\n", r"a PLY file: give it a name that ends in \.ply"),
        (b" \n", "it is empty"),
    ],
)
@pytest.mark.parametrize("suffix", [".obj", ".stl", ".tab"])
def test_what_it_is_instead(tmp_path: Path, suffix: str, content: bytes, what: str) -> None:
    path = tmp_path / f"body{suffix}"
    path.write_bytes(content)
    with pytest.raises(InputError, match=what):
        read_mesh(path)
