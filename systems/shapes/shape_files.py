"""Reads and writes the mesh files in which shape models are published.

Meshes are read as they are in the file: nothing is welded, reordered or repaired. Polygons become
triangles. Where a form repeats vertices, which STL and ICQ do, equal ones become one.
"""

from __future__ import annotations

import gzip
import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from proxops.systems.common import InputError, Vectors3, decoded
from proxops.systems.shapes._binary_meshes import read_dsk, read_ply, read_stl
from proxops.systems.shapes._text_meshes import Read, read_obj, read_tables, read_vrml
from proxops.systems.shapes.mesh_checks import six_volumes

_METRES = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "km": 1000.0}
MESH_FORMATS = (".obj", ".ply", ".stl", ".tab")
"""Endings of the files that are written."""

_TABLES = (".tab", ".ver", ".txt", ".icq")
_READERS: dict[str, Callable[[bytes], Read]] = {
    ".obj": lambda content: read_obj(decoded(content)),
    ".ply": read_ply,
    ".stl": read_stl,
    ".wrl": lambda content: read_vrml(decoded(content)),
    ".bds": read_dsk,
}
# How files begin that are no meshes of the ending that they have, and what they are.
_INSTEAD = (
    (b"version https://git-lfs", "a pointer of Git LFS, not the file: run git lfs pull"),
    (b"/annex/objects/", "a pointer of git-annex, not the file: run git annex get"),
    (b"<!doctype html", "a web page: download the file itself, such as by the page's link `raw`"),
    (b"<html", "a web page: download the file itself, such as by the page's link `raw`"),
    (b"<?xml", "XML: download or export the mesh itself"),
    (b"\x1f\x8b", "compressed by gzip: give it a name that ends in .gz"),
    (b"pk\x03\x04", "a ZIP archive: unpack it"),
    (b"%pdf", "a PDF document: download the mesh itself"),
    (b"ply\n", "a PLY file: give it a name that ends in .ply"),
    (b"ply\r", "a PLY file: give it a name that ends in .ply"),
    (b"#vrml", "a VRML file: give it a name that ends in .wrl"),
    (b"das/dsk", "a digital shape kernel: give it a name that ends in .bds"),
    (b"gltf", "a glTF file: convert it to OBJ, such as with Blender"),
)


@dataclass(frozen=True)
class MeshFile:
    """The content of a mesh file."""

    vertices: Vectors3
    """(V, 3) in m."""
    facets: Vectors3
    """(F, 3) indices into the vertices, from 0."""
    name: str
    """The file's name, for messages."""
    unit: str
    """Unit of the numbers in the file: "mm", "cm", "m" or "km"."""
    format: str
    """Description of the format that was found."""

    def scaled(self, *, size: float | None = None, diameter: float | None = None) -> MeshFile:
        """The same model, in m, of another size: that of a model without a scale is not known.

        Args:
          size: greatest length in m along x, y or z.
          diameter: in place of it, diameter in m of the ball of the same volume.

        Raises:
          InputError: the size is not positive, or the mesh has no volume.
        """
        if size is not None:
            wanted, has = size, float(np.ptp(self.vertices, axis=0).max())
        else:
            assert diameter is not None
            volume = abs(six_volumes(self.vertices, self.facets).sum()) / 6.0
            wanted, has = diameter, float(np.cbrt(6.0 * volume / np.pi))
        if not (0.0 < wanted < np.inf and 0.0 < has < np.inf):
            raise InputError(f"{self.name}: a size of {has:g} cannot be made one of {wanted:g} m")
        return replace(self, vertices=self.vertices * (wanted / has), unit="m")


def metres_per(unit: str) -> float:
    """Metres in a unit of mesh files.

    Raises:
      InputError: the unit is not known.
    """
    if unit not in _METRES:
        known = ", ".join(map(repr, _METRES))
        raise InputError(f"mesh unit {unit!r} is not known: use one of {known}")
    return _METRES[unit]


def read_mesh(path: str | Path, unit: str = "km", longitudes: str | None = None) -> MeshFile:
    """Reads a mesh file whose numbers are in `unit`: "mm", "cm", "m" or "km".

    The ending of its name says what it is; behind it, `.gz` says that it is compressed by gzip.

    * `.obj`, `.ply`, `.stl`: polygons become triangles; colours and textures do not count.
    * `.tab`, `.ver`, `.txt`, `.icq`: the tables in which NASA's Planetary Data System keeps
      shapes, with or without an attached label:

      * `v x y z` and `f i j k` lines (Ostro, Hudson and others' radar models, EAR-A-5-DDR);
      * one line with both counts, or one count before each table; then vertices `x y z` and plates
        `i j k`. Rows may begin with their number (Eros by NEAR; Gaskell's `ver*q.tab`). A line with
        the number of corners may precede each plate (Rosetta's `.ver`);
      * the same two tables without counts; the rows of integers are the plates;
      * Gaskell's implicitly connected quadrilaterals (ICQ): q, then 6 (q + 1)^2 vertices;
      * latitude, longitude (degrees) and radius of a whole grid; it needs `longitudes`.

    * `.wrl`: VRML of one part.
    * `.bds`: a digital shape kernel of SPICE, in km; it needs the extra `spice`.

    Plates number the vertices from 1, or from 0 if a plate names vertex 0 or the vertices' own
    numbers begin with 0.

    Args:
      path: of the file.
      unit: of its numbers.
      longitudes: "east" or "west", the way in which the longitudes of a table of radii count.

    Raises:
      InputError: the file does not exist, its format or unit is not known, it is damaged, a line is
        not understood, or it has no triangles.
    """
    path = Path(path)
    scale = metres_per(unit)  # A wrong unit is reported before a missing file.
    if not path.is_file():
        raise InputError(f"mesh file {path} does not exist or is not a file")
    compressed = path.suffix.lower() == ".gz"
    suffix = Path(path.stem if compressed else path.name).suffix.lower()
    reader = _READERS.get(suffix)
    if suffix in _TABLES:
        reader = lambda content: read_tables(decoded(content), longitudes)  # noqa: E731
    if reader is None:
        raise InputError(
            f"{path} could not be read as a mesh: use one of {', '.join((*_READERS, *_TABLES))}, "
            "or such with .gz behind it; MeshLab and Blender convert other formats to OBJ"
        )
    if suffix == ".bds" and unit != "km":
        raise InputError(f"{path}: the unit of a digital shape kernel is km, not {unit}")
    try:
        content = path.read_bytes()
        if compressed:
            content = gzip.decompress(content)
        _refuse_what_is_none(content, suffix)
        vertices, facets, found = reader(content)
    except (ValueError, OSError, EOFError, zlib.error) as error:
        raise InputError(f"{path} could not be read as a mesh: {error}") from error
    if len(facets) == 0:
        raise InputError(f"{path} holds no triangles: {found}")
    return MeshFile(vertices * scale, facets, path.name, unit, found)


def _refuse_what_is_none(content: bytes, suffix: str) -> None:
    """Raises ValueError if the beginning of a file says that it is no mesh of this ending."""
    start = content[:200].lstrip(b"\xef\xbb\xbf \t\r\n").lower()
    if not start:
        raise ValueError("it is empty")
    for beginning, what in _INSTEAD:
        if start.startswith(beginning) and f"ends in {suffix}" not in what:
            raise ValueError(f"it is {what}")


def mesh_bytes(vertices: Vectors3, facets: Vectors3, suffix: str, comment: str = "") -> bytes:
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
