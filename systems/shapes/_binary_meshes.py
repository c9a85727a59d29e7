"""Readers of the mesh files that may be binary: PLY, STL, and SPICE's DSK.

Each takes the content of a file and gives vertices (V, 3) in the file's unit, facets (F, 3) of
indices from 0, and a description of the form. They raise ValueError.
"""

from __future__ import annotations

import re
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np

from proxops.systems.shapes._polygons import triangulated
from proxops.systems.shapes._text_meshes import Read, distinct

_TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4",
    "float": "f4", "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2",
    "int32": "i4", "uint32": "u4", "float32": "f4", "float64": "f8",
}  # fmt: skip
_STL = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


class _Property(NamedTuple):
    """A property of an element of a PLY file."""

    name: str
    kind: str
    length: str | None
    """Type of a list's length; None: it is no list."""


def read_ply(content: bytes) -> Read:
    """Reads vertices `x y z` and the lists `vertex_indices` of faces; all else does not count."""
    header, end, body = content.partition(b"end_header")
    if not content.startswith(b"ply") or not end:
        raise ValueError("it has no header of a PLY file, from `ply` to `end_header`")
    body = body.partition(b"\n")[2] if b"\n" in body else body.partition(b"\r")[2]
    form, elements = _header(header.decode("latin-1").splitlines()[1:])
    read = _ascii_elements if form == "ascii" else _binary_elements
    found = read(body, form, elements)
    vertices = found.get("vertex", {})
    if not vertices.keys() >= {"x", "y", "z"}:
        raise ValueError("it has no element vertex with x, y and z")
    points = np.stack([np.asarray(vertices[axis], dtype=float) for axis in "xyz"], axis=1)
    faces = found.get("face", {})
    lists = faces.get("vertex_indices", faces.get("vertex_index"))
    if lists is None:
        other = " (it has strips)" if "tristrips" in found else ""
        raise ValueError(f"it has no element face with vertex_indices{other}: export triangles")
    facets = triangulated(points, lists, lambda k: f"face {k}")
    return points, facets, f"PLY, {len(points)} vertices, {len(facets)} facets"


def read_stl(content: bytes) -> Read:
    """Reads the corners of triangles, binary or as text; equal corners become one vertex."""
    announced = int.from_bytes(content[80:84], "little")
    there = (len(content) - 84) // _STL.itemsize
    # The headers of many binary files begin with `solid`, too.
    if content.lstrip().startswith(b"solid") and re.search(rb"\bfacet\s+normal\b", content[:4096]):
        corners = _ascii_stl(content.decode("latin-1"))
    elif len(content) < 84:
        raise ValueError("it is shorter than the header of an STL file")
    elif there < announced:
        raise ValueError(
            f"{announced} facets announced, {there} there: the file is cut, so load it once more"
        )
    else:
        corners = np.frombuffer(content, _STL, announced, 84)["corners"].astype(float)
    vertices, place = distinct(corners.reshape(-1, 3))
    facets = place.reshape(-1, 3)
    return vertices, facets, f"STL, {len(vertices)} vertices, {len(facets)} facets"


def read_dsk(content: bytes) -> Read:
    """Reads the plates of all segments of a digital shape kernel of type 2, by `spiceypy`."""
    try:
        import spiceypy
        from spiceypy.utils.exceptions import SpiceyError
    except ModuleNotFoundError as error:
        raise ValueError("to read a DSK, pip install 'proxops[spice]'") from error
    vertices, plates = [np.empty((0, 3))], [np.empty((0, 3), dtype=np.int64)]
    with tempfile.TemporaryDirectory() as folder:  # SPICE opens paths only.
        path = Path(folder) / "shape.bds"
        path.write_bytes(content)
        handle = None
        try:
            handle = spiceypy.dasopr(str(path))
            segment = spiceypy.dlabfs(handle)
            while True:
                vertex_count, plate_count = spiceypy.dskz02(handle, segment)
                before = sum(map(len, vertices))
                vertices.append(spiceypy.dskv02(handle, segment, 1, vertex_count))
                plates.append(spiceypy.dskp02(handle, segment, 1, plate_count) - 1 + before)
                try:
                    segment = spiceypy.dlafns(handle, segment)
                except spiceypy.NotFoundError:
                    break
        except (SpiceyError, spiceypy.NotFoundError) as error:
            raise ValueError(f"SPICE does not read it as a DSK of plates: {error}") from error
        finally:
            if handle is not None:
                spiceypy.dascls(handle)
    points, facets = np.concatenate(vertices), np.concatenate(plates).astype(np.int64)
    return points, facets, f"DSK, {len(points)} vertices, {len(facets)} facets"


def _header(lines: list[str]) -> tuple[str, list[tuple[str, int, list[_Property]]]]:
    """The encoding, and name, number and properties of each element."""
    form, elements = "", []
    for line in lines:
        match line.split():
            case ["format", encoding, _]:
                form = encoding
            case ["element", name, count] if count.isdigit():
                elements.append((name, int(count), []))
            case ["property", "list", count, kind, name] if (
                elements and {count, kind} <= _TYPES.keys()
            ):
                elements[-1][2].append(_Property(name, _TYPES[kind], _TYPES[count]))
            case ["property", kind, name] if elements and kind in _TYPES:
                elements[-1][2].append(_Property(name, _TYPES[kind], None))
            case [] | ["comment" | "obj_info", *_]:
                pass
            case _:
                raise ValueError(f"its header has the line {line[:60]!r}, which is not understood")
    if form not in ("ascii", "binary_little_endian", "binary_big_endian"):
        raise ValueError(f"its header has the format {form!r}, which is not understood")
    return form, elements


def _ascii_elements(body: bytes, form: str, elements: list) -> dict[str, dict]:
    rows = iter(line.split() for line in body.decode("latin-1").splitlines() if line.strip())
    found = {}
    for name, count, properties in elements:
        columns = {each.name: [] for each in properties}
        for k in range(count):
            words = next(rows, None)
            if words is None:
                raise ValueError(f"{count} of {name} announced, {k} there: the file is cut")
            try:
                _take_row(words, properties, columns)
            except (ValueError, IndexError):
                raise ValueError(
                    f"{name} {k}, {' '.join(words)[:60]!r}, does not have the numbers that the "
                    "header announces"
                ) from None
        found[name] = columns
    return found


def _take_row(words: list[str], properties: list[_Property], columns: dict[str, list]) -> None:
    """Appends the values of a row to the columns; ValueError or IndexError: it has others."""
    place = 0
    for each in properties:
        number = float if each.kind.startswith("f") else int
        if each.length is None:
            columns[each.name].append(number(words[place]))
            place += 1
        else:
            end = place + 1 + int(words[place])
            if end > len(words):
                raise IndexError
            columns[each.name].append([*map(number, words[place + 1 : end])])
            place = end
    if place != len(words):
        raise IndexError


def _binary_elements(body: bytes, form: str, elements: list) -> dict[str, dict]:
    order = "<" if form == "binary_little_endian" else ">"
    found, place = {}, 0
    for name, count, properties in elements:
        found[name], place = _binary_element(body, place, order, name, count, properties)
    return found


def _binary_element(body, place, order, name, count, properties):
    """The columns of an element whose rows begin at a place, and the place after them."""
    columns = {each.name: [] for each in properties}
    done, many = 0, 1
    while done < count:
        # Rows whose lists have the lengths of this row's are read at once.
        fields, at = [], place
        for each in properties:
            size: tuple[int, ...] = ()
            if each.length is not None:
                length = np.frombuffer(body[at : at + 8], order + each.length, 1)
                fields.append((f"#{each.name}", order + each.length))
                at += length.itemsize
                size = (int(length[0]),)
            fields.append((each.name, order + each.kind, size))
            at += np.dtype(fields[-1:]).itemsize
        row = np.dtype(fields)
        there = min((len(body) - place) // row.itemsize if row.itemsize else 0, count - done, many)
        if there <= 0:
            raise ValueError(f"{count} of {name} announced, {done} there: the file is cut")
        rows = np.frombuffer(body, row, there, place)
        same = np.ones(there, dtype=bool)
        for each in properties:
            if each.length is not None:
                same &= rows[f"#{each.name}"] == rows[f"#{each.name}"][0]
        alike = there if same.all() else int(np.argmin(same))
        for each in properties:
            columns[each.name].append(rows[each.name][:alike])
        many = 4 * many if alike == there else 1
        done += alike
        place += alike * row.itemsize
    joined = {
        each.name: [row for part in columns[each.name] for row in part.tolist()]
        for each in properties
    }
    return joined, place


def _ascii_stl(text: str) -> np.ndarray:
    """Corners (F, 3, 3) of the facets of an STL that is text."""
    facets, ends = len(re.findall(r"\bfacet\s", text)), len(re.findall(r"\bendfacet\b", text))
    words = re.findall(r"\bvertex\s+(\S+)\s+(\S+)\s+(\S+)", text)
    if facets != ends or len(words) != 3 * ends or "endsolid" not in text:
        raise ValueError(
            f"{facets} facets begin, {ends} end, with {len(words)} corners in all"
            + ("" if "endsolid" in text else "; the line endsolid is missing: the file is cut")
        )
    return np.array(words, dtype=float).reshape(-1, 3, 3)
