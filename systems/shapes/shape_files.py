"""Reads and writes the mesh files in which shape models are published.

Meshes are read as they are in the file: nothing is welded, split, reordered or repaired. The only
exception is STL, which has no shared vertices: equal corners become one vertex.
"""

from __future__ import annotations

import io
import itertools
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from proxops.systems.common import InputError

METRES_PER_UNIT = {"m": 1.0, "km": 1000.0}
MESH_FORMATS = (".obj", ".ply", ".stl", ".tab")


@dataclass(frozen=True)
class MeshFile:
    """The content of a mesh file."""

    vertices: np.ndarray
    """(V, 3) in m."""
    facets: np.ndarray
    """(F, 3) indices into the vertices, from 0."""
    name: str
    """The file's name, for messages."""
    unit: str
    """Unit of the numbers in the file: "km" or "m"."""
    format: str
    """Description of the format that was found."""


def metres_per(unit: str) -> float:
    """Metres in a unit of mesh files.

    Raises:
      InputError: the unit is not known.
    """
    if unit not in METRES_PER_UNIT:
        raise InputError(f"mesh unit {unit!r} is not known: use one of 'km', 'm'")
    return METRES_PER_UNIT[unit]


def read_mesh(path: str | Path, unit: str = "km") -> MeshFile:
    """Reads an OBJ, PLY, STL or PDS `.tab` file whose numbers are in `unit` ("km" or "m").

    Polygons of an OBJ file become fans of triangles. `.tab` files may have these forms, in which
    NASA's Planetary Data System keeps plate models, with or without an attached label:

    * `v x y z` and `f i j k` lines (Ostro, Hudson and others' radar models, EAR-A-5-DDR);
    * one line with both counts, or one count before each table; then vertices `x y z` and plates
      `i j k`. Rows may begin with their number (Eros by NEAR; Gaskell's `ver*q.tab`). A line with
      the number of corners may precede each plate (Rosetta's `.ver`);
    * the same two tables without counts; the rows of integers are the plates.

    Plates number the vertices from 1, or from 0 if a plate names vertex 0 or the vertices' own
    numbers begin with 0.

    Raises:
      InputError: the file does not exist, its format or unit is not known, or it has no triangles.
    """
    path = Path(path)
    scale = metres_per(unit)  # A wrong unit is reported before a missing file.
    if not path.is_file():
        raise InputError(f"mesh file {path} does not exist or is not a file")
    suffix = path.suffix.lower()
    if suffix not in MESH_FORMATS:
        raise InputError(
            f"{path} could not be read as a mesh: use one of {', '.join(MESH_FORMATS)}"
        )
    try:
        if suffix in (".obj", ".tab"):
            text = path.read_text(encoding="utf-8", errors="replace")
            vertices, facets, found = (_read_obj if suffix == ".obj" else _read_tab)(text)
        else:
            vertices, facets, found = _read_binary(path)
    except Exception as error:  # A damaged file can make the readers raise anything.
        raise InputError(f"{path} could not be read as a mesh: {error}") from error
    if len(facets) == 0:
        raise InputError(f"{path} holds no triangles")
    return MeshFile(vertices * scale, facets, path.name, unit, found)


def mesh_bytes(vertices: np.ndarray, facets: np.ndarray, suffix: str, comment: str = "") -> bytes:
    """The content of a mesh file of vertices (V, 3), in the file's unit, and facets (F, 3).

    `.obj` and `.tab` keep every digit; `.obj` keeps the comment; `.ply` and `.stl` have single
    precision.

    Raises:
      InputError: the suffix is not one of `MESH_FORMATS`.
    """
    import trimesh  # It is slow to import, so only when it is needed.

    suffix = suffix.lower()
    if suffix in (".obj", ".tab"):
        lines = [f"# {line}" for line in comment.splitlines()] if suffix == ".obj" else []
        lines += [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
        lines += [f"f {i} {j} {k}" for i, j, k in (facets + 1).tolist()]
        return ("\n".join(lines) + "\n").encode()
    if suffix not in MESH_FORMATS:
        raise InputError(f"a mesh is written as one of {', '.join(MESH_FORMATS)}, not {suffix!r}")
    mesh = trimesh.Trimesh(vertices, facets, process=False)
    content = mesh.export(file_type=suffix[1:])
    assert isinstance(content, bytes)
    return content


def _read_binary(path: Path) -> tuple[np.ndarray, np.ndarray, str]:
    import trimesh  # It is slow to import, so only when it is needed.

    kind = path.suffix.lower()[1:]
    mesh = trimesh.load_mesh(io.BytesIO(path.read_bytes()), file_type=kind, process=False)
    if not isinstance(mesh, trimesh.Trimesh):
        return np.empty((0, 3)), np.empty((0, 3), dtype=np.int64), kind
    vertices, facets = np.array(mesh.vertices, dtype=float), np.array(mesh.faces, dtype=np.int64)
    if kind == "stl":
        _, first, place = np.unique(vertices, axis=0, return_index=True, return_inverse=True)
        # Vertices are numbered in the order of their first appearance.
        rank = np.empty(len(first), dtype=np.int64)
        order = np.argsort(first)
        rank[order] = np.arange(len(first))
        vertices, facets = vertices[first[order]], rank[place.reshape(-1)][facets]
    return vertices, facets, f"{kind.upper()}, {len(vertices)} vertices, {len(facets)} facets"


def _read_obj(text: str) -> tuple[np.ndarray, np.ndarray, str]:
    """Reads lines `v x y z` and `f i/… j/… k/… …`; ignores normals, textures and groups."""
    vertices, facets = [], []
    for line in text.replace("\\\n", " ").splitlines():
        kind, *words = line.split() or [""]
        if kind == "v":
            vertices.append([float(word) for word in words[:3]])
        elif kind == "f":
            corners = [int(word.partition("/")[0]) for word in words]
            # Negative numbers count back from the last vertex so far.
            corners = [len(vertices) + c if c < 0 else c - 1 for c in corners]
            facets += [[corners[0], *pair] for pair in itertools.pairwise(corners[1:])]
    found = f"OBJ, {len(vertices)} vertices, {len(facets)} facets"
    return _array(vertices), _array(facets, np.int64), found


def _read_tab(text: str) -> tuple[np.ndarray, np.ndarray, str]:
    text = re.sub(
        r"\A\s*PDS_VERSION_ID.*?^[ \t]*END[ \t\r]*$", "", text, flags=re.DOTALL | re.MULTILINE
    )
    rows = [line.replace(",", " ").split() for line in text.splitlines()]
    rows = [row for row in rows if row and not row[0].startswith("#")]
    if not rows:
        raise ValueError("it holds no rows of numbers")
    if any(row[0] in ("v", "f") for row in rows):
        vertices = _numbers([row[1:4] for row in rows if row[0] == "v"])
        facets = _whole([row[1:4] for row in rows if row[0] == "f"])
        numbered_from, header = None, "v and f lines"
    else:
        vertices, facets, numbered_from, header = _read_tables(rows)
    base = 0 if numbered_from == 0 or facets.min(initial=1) == 0 else 1
    counts = f"{len(vertices)} vertices, {len(facets)} facets"
    return vertices, facets - base, f"PDS plate model ({header}, from {base}), {counts}"


def _read_tables(rows: list[list[str]]) -> tuple[np.ndarray, np.ndarray, int | None, str]:
    """Vertices, plates, the first vertex's number or None, and a description of the form."""
    if len(rows[0]) <= 2:
        vertex_count = int(rows[0][0])
        header = "counts first" if len(rows[0]) == 2 else "each table after its count"
        table, rest = rows[1 : 1 + vertex_count], rows[1 + vertex_count :]
        if len(rows[0]) == 1 and not rest:
            raise ValueError(f"after {len(table)} vertices there is no count of plates")
        plate_count = int(rows[0][1]) if len(rows[0]) == 2 else int(rest.pop(0)[0])
        rest = [row for row in rest if len(row) > 1]  # A row `3` is the next plate's corner count.
        if len(table) != vertex_count or len(rest) != plate_count:
            raise ValueError(
                f"its header counts {vertex_count} vertices and {plate_count} plates, "
                f"but {len(table)} and {len(rest)} follow"
            )
    else:
        header = "two tables without counts"
        is_plate = [all(re.fullmatch(r"\d+", word) for word in row) for row in rows]
        first = is_plate.index(True) if True in is_plate else len(rows)
        table, rest = rows[:first], rows[first:]
    values = _numbers(table)
    plates = _whole(rest)
    numbered_from = None
    if values.shape[1] == 4:
        header += ", numbered rows"
        numbered_from = int(values[0, 0])
        if not np.array_equal(values[:, 0], numbered_from + np.arange(len(values))):
            raise ValueError("the vertices' own numbers do not run on")
    return values[:, -3:], plates[:, -3:], numbered_from, header


def _numbers(rows: list[list[str]]) -> np.ndarray:
    # Fortran writes 1.5D+01.
    return _array([[float(word.replace("D", "E").replace("d", "e")) for word in r] for r in rows])


def _whole(rows: list[list[str]]) -> np.ndarray:
    return _array([[int(word) for word in row] for row in rows], np.int64)


def _array(rows: list, dtype: type = np.float64) -> np.ndarray:
    """Rows (N, 3 or 4) of numbers; raises ValueError for rows of other or unequal lengths."""
    array = np.array(rows, dtype=dtype) if rows else np.empty((0, 3), dtype=dtype)
    if array.ndim != 2 or array.shape[1] not in (3, 4):
        raise ValueError("a row has too few or too many numbers")
    return array
