"""Readers of the shape models that are text: OBJ, plate models, ICQ, tables of radii, VRML.

Each takes the text of a file and gives vertices (V, 3) in the file's unit, facets (F, 3) of indices
from 0, and a description of the form. A line that is not understood raises ValueError with its
number; none is passed over.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from proxops.systems.shapes._polygons import triangulated
from proxops.systems.shapes.mesh_checks import six_volumes

Read = tuple[np.ndarray, np.ndarray, str]
"""Vertices, facets, and a description of the form."""

LONGITUDES = ("east", "west")
"""The ways in which longitudes are counted."""

# Lines of OBJ that are about the look of a surface, its parts and its names, or lines and points.
_NO_SURFACE = (
    "vt", "vn", "vp", "g", "o", "s", "mg", "usemtl", "mtllib", "usemap", "maplib", "l", "p",
    "bevel", "c_interp", "d_interp", "lod", "shadow_obj", "trace_obj",
)  # fmt: skip
_LABEL = re.compile(
    r"\A\s*PDS_VERSION_ID.*?^[ \t]*END[ \t\r]*$", flags=re.DOTALL | re.MULTILINE
)  # fmt: skip
_DECIMAL_COMMA = re.compile(r"[-+]?\d+,\d+([eEdD][-+]?\d+)?")


class _Row(NamedTuple):
    """A line that is neither blank nor a remark."""

    line: int
    words: list[str]


def read_obj(text: str) -> Read:
    """Reads lines `v x y z` and `f i/… j/… k/… …`; normals, textures and groups do not count."""
    vertices, facets, _ = _flagged(_rows(text), least=1)
    return vertices, facets, f"OBJ, {_counts(vertices, facets)}"


def read_tables(text: str, longitudes: str | None) -> Read:
    """Reads the tables of numbers in which NASA's Planetary Data System keeps shapes.

    Args:
      text: perhaps with an attached label.
      longitudes: of a table of radii, one of `LONGITUDES`; None: not known.
    """
    rows = list(_rows(_LABEL.sub(lambda label: "\n" * label[0].count("\n"), text)))
    if not rows:
        raise ValueError("it holds no rows of numbers")
    if any(row.words[0] in ("v", "f") for row in rows):
        vertices, facets, base = _flagged(iter(rows), least=0)
        form = f"v and f lines, from {base}"
    else:
        made = _icq(rows) or _radii(rows, longitudes)
        if made is not None:
            return made
        vertices, facets, form = _plates(rows)
    return vertices, facets, f"PDS plate model ({form}), {_counts(vertices, facets)}"


def read_vrml(text: str) -> Read:
    """Reads the one set of faces of a VRML file, version 1 or 2."""
    text = re.sub(r"#[^\n]*", "", text)
    points = re.findall(r"\bpoint\s*\[([^]]*)\]", text)
    indices = re.findall(r"\bcoordIndex\s*\[([^]]*)\]", text)
    moved = re.search(r"\b(translation|rotation|scale|scaleFactor|matrix)\b", text)
    if len(points) != 1 or len(indices) != 1 or moved:
        raise ValueError(
            "it holds several parts, or parts that are moved: convert it to OBJ, such as with "
            "MeshLab or Blender"
        )
    numbers = [_number(word) for word in points[0].replace(",", " ").split()]
    if len(numbers) % 3:
        raise ValueError(f"its points are {len(numbers)} numbers, not three for each")
    vertices = np.array(numbers).reshape(-1, 3)
    faces, face = [], []
    for word in [*indices[0].replace(",", " ").split(), "-1"]:
        if word != "-1":
            face.append(_whole(word))
        elif face:
            faces.append(face)
            face = []
    facets = triangulated(vertices, faces, lambda k: f"face {k}")
    return vertices, facets, f"VRML, {_counts(vertices, facets)}"


def _counts(vertices: np.ndarray, facets: np.ndarray) -> str:
    return f"{len(vertices)} vertices, {len(facets)} facets"


def _rows(text: str) -> Iterator[_Row]:
    """The lines of a text with their words, without remarks; a backslash goes on in the next."""
    held = ""
    for number, line in enumerate(text.split("\n"), start=1):
        line = held + line.partition("#")[0].rstrip()
        if line.endswith("\\"):
            held = line[:-1] + " "
            continue
        held = ""
        words = line.split()
        if "," in line:
            commas = [word for word in words if _DECIMAL_COMMA.fullmatch(word)]
            if commas and len(words) > 1:
                raise ValueError(
                    f"line {number}: {commas[0]} has a decimal comma; write a point, "
                    f"{commas[0].replace(',', '.')}"
                )
            words = line.replace(",", " ").split()
        if words:
            yield _Row(number, words)


def _number(word: str) -> float:
    try:
        return float(word)
    except ValueError:
        pass
    try:
        return float(re.sub("[dD]", "e", word))  # Fortran writes 1.5D+01.
    except ValueError:
        raise ValueError(f"{word!r} is no number") from None


def _whole(word: str) -> int:
    try:
        return int(word)
    except ValueError:
        raise ValueError(f"{word!r} is no whole number") from None


def _flagged(rows: Iterator[_Row], least: int) -> tuple[np.ndarray, np.ndarray, int]:
    """Vertices and facets of `v` and `f` lines, and the number of the first vertex.

    Args:
      rows: the lines.
      least: the least number of a vertex; with 0 the numbers begin with 0 if a facet has that one.
    """
    vertices, polygons, lines = [], [], []
    for line, (kind, *words) in rows:
        try:
            if kind == "v":
                # A weight or a colour may follow.
                if len(words) not in (3, 4, 6, 7):
                    raise ValueError(f"a vertex has 3 coordinates, not {len(words)}")
                vertices.append([_number(word) for word in words[:3]])
            elif kind == "f":
                corners = [_whole(word.partition("/")[0]) for word in words]
                if min(corners, default=1) < 0:  # They count back from the last vertex so far.
                    corners = [len(vertices) + c + 1 if c < 0 else c for c in corners]
                if min(corners, default=1) < least:
                    raise ValueError(f"a facet names vertex {min(corners)}; the first is {least}")
                polygons.append(corners)
                lines.append(line)
            elif kind not in _NO_SURFACE:
                raise ValueError(f"lines that begin with {kind[:40]!r} are not understood")
        except ValueError as error:
            raise ValueError(f"line {line}: {error}") from None
    base = 0 if any(0 in corners for corners in polygons) else 1
    if base:
        polygons = [[c - 1 for c in corners] for corners in polygons]
    points = np.array(vertices, dtype=float).reshape(-1, 3)
    return points, triangulated(points, polygons, lambda k: f"line {lines[k]}"), base


def _plates(rows: list[_Row]) -> Read:
    """Vertices, plates, and a description of the form, of two tables."""
    head = rows[0].words
    if len(head) <= 2:
        vertex_count = _counted(rows[0], 0)
        header = "counts first" if len(head) == 2 else "each table after its count"
        table, rest = rows[1 : 1 + vertex_count], rows[1 + vertex_count :]
        if len(head) == 1 and (not rest or len(rest[0].words) > 1):
            raise ValueError(
                f"its first line counts {vertex_count}, but after {len(table)} vertices there is "
                f"no count of plates; of an ICQ model {6 * (vertex_count + 1) ** 2} vertices would "
                f"follow, not {len(rows) - 1}"
            )
        plate_count = _counted(rows[0], 1) if len(head) == 2 else _counted(rest.pop(0), 0)
        # A row `3` is the next plate's corner count.
        rest = [row for row in rest if len(row.words) > 1]
        if len(table) != vertex_count or len(rest) != plate_count:
            raise ValueError(
                f"its header counts {vertex_count} vertices and {plate_count} plates, "
                f"but {len(table)} and {len(rest)} follow"
            )
    else:
        header = "two tables without counts"
        is_plate = [all(re.fullmatch(r"\d+", word) for word in row.words) for row in rows]
        first = is_plate.index(True) if True in is_plate else len(rows)
        table, rest = rows[:first], rows[first:]
    values = _table(table, _number)
    plates = _table(rest, _whole)[:, -3:]
    base = 1
    if values.shape[1] == 4:
        header += ", numbered rows"
        base = int(values[0, 0])
        if not np.array_equal(values[:, 0], base + np.arange(len(values))):
            raise ValueError("the vertices' own numbers do not run on")
    base = 0 if base == 0 or plates.min(initial=1) == 0 else 1
    return values[:, -3:], plates - base, f"{header}, from {base}"


def _counted(row: _Row, place: int) -> int:
    try:
        return _whole(row.words[place])
    except ValueError as error:
        raise ValueError(f"line {row.line}: {error}") from None


def _table(rows: list[_Row], read: Callable[[str], float]) -> np.ndarray:
    """Rows (N, 3) of numbers, or (N, 4) where they are numbered."""
    found, width = [], len(rows[0].words) if rows else 3
    for line, words in rows:
        if len(words) != width or width not in (3, 4):
            raise ValueError(f"line {line}: a row has too few or too many numbers")
        try:
            found.append([read(word) for word in words])
        except ValueError as error:
            raise ValueError(f"line {line}: {error}") from None
    return np.array(found, dtype=np.int64 if read is _whole else float).reshape(-1, width)


def _icq(rows: list[_Row]) -> Read | None:
    """The shape of an implicitly connected quadrilateral model; None if it is none.

    Gaskell's form: a number q, then the vertices v(i, j, f) of the six faces of a cube,
    i = 0 … q fastest, then j, then f = 1 … 6. Faces share the vertices of their edges, which the
    file repeats. Each quadrilateral is split along its shorter diagonal. Gaskell's wind outwards in
    the order v(i, j), v(i, j + 1), v(i + 1, j + 1), v(i + 1, j); faces of a model that has them the
    other way round are turned.
    """
    if len(rows[0].words) != 1 or not rows[0].words[0].isdigit():
        return None
    q = int(rows[0].words[0])
    if q < 1 or len(rows) - 1 != 6 * (q + 1) ** 2:
        return None
    # A zero has no sign, so that it is equal to itself.
    points = _table(rows[1:], _number)[:, -3:] + 0.0
    vertices, place = distinct(points)
    if len(vertices) != 6 * q**2 + 2:
        raise ValueError(
            f"the six faces of an ICQ model with q = {q} have {6 * q**2 + 2} vertices, these have "
            f"{len(vertices)}: the vertices on common edges of the faces are not the same"
        )
    grid = place.reshape(6, q + 1, q + 1)
    a, b = grid[:, :-1, :-1], grid[:, 1:, :-1]
    c, d = grid[:, 1:, 1:], grid[:, :-1, 1:]
    facets = split_quadrilaterals(vertices, a, b, c, d).reshape(6, -1, 3)
    inwards = six_volumes(vertices, facets.reshape(-1, 3)).reshape(6, -1).sum(axis=1) < 0.0
    facets = np.where(inwards[:, None, None], facets[:, :, ::-1], facets).reshape(-1, 3)
    return vertices, facets, f"ICQ model, q = {q}, {_counts(vertices, facets)}"


def _radii(rows: list[_Row], longitudes: str | None) -> Read | None:
    """The shape of a table of latitudes, longitudes (degrees) and radii; None if it is none."""
    try:
        table = _table(rows, _number)
    except ValueError:
        return None
    if table.shape[1] != 3:
        return None
    if np.abs(table[:, 0]).max() > 90.0:
        table = table[:, [1, 0, 2]]
    table = table[np.lexsort((table[:, 1], table[:, 0]))]
    # A pole may stand once, or at each longitude.
    polar, table = table[np.abs(table[:, 0]) == 90.0], table[np.abs(table[:, 0]) < 90.0]
    latitudes, around = np.unique(table[:, 0]), np.unique(table[:, 1])
    whole_grid = np.stack(np.meshgrid(latitudes, around, indexing="ij"), axis=2)
    if (
        min(len(latitudes), len(around)) < 3
        or not np.array_equal(whole_grid.reshape(-1, 2), table[:, :2])
        or np.ptp(around) < 180.0
        or min(table[:, 2].min(), polar[:, 2].min(initial=1.0)) <= 0.0
    ):
        return None
    if longitudes not in LONGITUDES:
        raise ValueError(
            "it is a table of latitudes, longitudes and radii, and does not say which way "
            "longitudes count: proxops shape FILE --longitude east (or west) --fix FILE.obj makes "
            "a mesh of it"
        )
    radii = table[:, 2].reshape(len(latitudes), len(around))
    if np.isclose(around[-1], around[0] + 360.0):
        around, radii = around[:-1], radii[:, :-1]
    # Each pole is one vertex: of its own radius, or of the mean of the row next to it.
    ends = []
    for pole, row in ((-90.0, radii[0]), (90.0, radii[-1])):
        own = polar[polar[:, 0] == pole, 2]
        ends.append(float((own if own.size else row).mean()))
    b = np.radians(latitudes)[:, None]
    a = np.radians(around if longitudes == "east" else -around)[None, :]
    unit = np.stack([np.cos(b) * np.cos(a), np.cos(b) * np.sin(a), np.sin(b) + 0.0 * a], axis=2)
    m, n = len(latitudes), len(around)
    vertices = np.concatenate(
        [(radii[:, :, None] * unit).reshape(-1, 3), [[0, 0, -ends[0]], [0, 0, ends[1]]]]
    )
    grid = np.arange(m * n).reshape(m, n)
    after = np.roll(grid, -1, axis=1)
    sides = split_quadrilaterals(vertices, grid[:-1], after[:-1], after[1:], grid[1:])
    south, north = np.full(n, m * n), np.full(n, m * n + 1)
    caps = [
        np.stack([south, after[0], grid[0]], axis=1),
        np.stack([north, grid[-1], after[-1]], axis=1),
    ]
    facets = np.concatenate([sides, *caps])
    if longitudes == "west":
        facets = facets[:, ::-1]
    form = f"table of {len(latitudes)} latitudes and {n} longitudes, {longitudes}"
    return vertices, facets, f"{form}, {_counts(vertices, facets)}"


def distinct(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The different points (V, 3) of points (N, 3), in order of appearance, and of each its place.

    Returns:
      Points (V, 3), and indices (N,) of them.
    """
    _, first, place = np.unique(points, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty(len(first), dtype=np.int64)
    rank[order] = np.arange(len(first))
    return points[first[order]], rank[place.reshape(-1)]


def split_quadrilaterals(vertices: np.ndarray, *corners: np.ndarray) -> np.ndarray:
    """Facets (2N, 3) of N quadrilaterals, each split along its shorter diagonal.

    Args:
      vertices: (V, 3).
      corners: four arrays of N indices of vertices, in the order of the winding.
    """
    a, b, c, d = (corner.reshape(-1) for corner in corners)
    first = np.linalg.norm(vertices[a] - vertices[c], axis=1)
    other = np.linalg.norm(vertices[b] - vertices[d], axis=1)
    by_first = np.stack([a, b, c, a, c, d], axis=1)
    by_other = np.stack([a, b, d, b, c, d], axis=1)
    return np.where((first <= other)[:, None], by_first, by_other).reshape(-1, 3)
