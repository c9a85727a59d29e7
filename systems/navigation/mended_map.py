"""`MendedMap`: the map with what a flight taught of its surface, and what may still be wrong."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from proxops.systems.common import InputError, Values, one_thread, write_whole
from proxops.systems.navigation.estimate import BASE, SIZE, Estimate
from proxops.systems.navigation.map_error import MapError
from proxops.systems.shapes import Polyhedron, mesh_bytes, metres_per, vertex_normals

_UNIT = "km"
# The estimate is sure of more than it knows: its theory is linear, and the finest errors look alike
# from frame to frame. So this share of the first deviation of each coefficient is left at least.
_DOUBT = 0.3
# What is left holds all but this share of its variance.
_NEGLIGIBLE = 1e-6
# A mesh that is off from the one in the file of errors by more than this share of its size is
# another one.
_SAME = 1e-9


class MendedMap(NamedTuple):
    """A map, and the error that is left of it."""

    shape: Polyhedron
    error: MapError

    @property
    def deviations(self) -> Values:
        """Standard deviation (V,) in m of each vertex along its normal."""
        return self.error.deviations


@one_thread()
def mended_map(shape: Polyhedron, map_error: MapError, estimate: Estimate) -> MendedMap:
    """Moves the surface of a map to where an estimate has it.

    Each vertex moves along its normal by the estimated error of the map, times the share of its
    variance that the flight explained, and with the estimated size. What is left is the error of
    both as the estimate's covariance says, and 0.3 of the first error everywhere. So places that
    were not seen keep the error that they had.

    Args:
      shape: the map by which was navigated. map_error: its error.
      estimate: after the flight.

    Raises:
      InputError: nothing of the map was estimated, or the mended surface is not sound.
    """
    chosen = np.r_[SIZE, BASE : BASE + map_error.modes]
    covariance = estimate.covariance[np.ix_(chosen, chosen)]
    if not np.trace(covariance) > 0.0:
        raise InputError(
            "the map is not mended: the navigation took it to be right; "
            "set navigation.expected.surface_rms_m to the error that it may have"
        )
    normals, _ = vertex_normals(shape)
    outwards = np.einsum("vi,vi->v", normals, shape.vertices)
    # Where little was seen, an estimate that is a little wrong would do harm.
    table = map_error.table
    variances = np.einsum("vm,mn,vn->v", table, covariance[1:, 1:], table, optimize=True)
    first = np.einsum("vm,vm->v", table, table)
    learned = 1.0 - np.clip(variances / np.maximum(first, 1e-300), 0.0, 1.0)
    heights = learned * (table @ estimate.mean[BASE : BASE + map_error.modes])
    vertices = (1.0 + estimate.mean[SIZE]) * shape.vertices + heights[:, None] * normals
    moved = np.column_stack([outwards, table])
    covariance[1:, 1:] += _DOUBT**2 * np.eye(map_error.modes)
    values, vectors = np.linalg.eigh(covariance)
    left = (moved @ vectors) * np.sqrt(np.maximum(values, 0.0))
    held = np.einsum("vm,vm->m", left, left)
    left = left[:, held > _NEGLIGIBLE * held.sum()]
    mended = Polyhedron(vertices, shape.facets, f"{shape.name}, mended")
    return MendedMap(mended, MapError.known(left, map_error.rest))


def save_mended_map(mended: MendedMap, path: Path) -> None:
    """Writes the mesh as an OBJ file in km, and beside it the error that is left.

    The second file has the suffix `.npz`: `vertices` (V, 3) of the mesh in m, `left` (V, M) in m,
    the displacement of each vertex along its normal by each of M independent errors of variance 1,
    and `rest`, in m^2: what is finer counts in each frame as noise of this variance.

    Raises:
      InputError: the path does not end in `.obj`, or the folder cannot be written.
    """
    if path.suffix != ".obj":
        raise InputError(
            f"the mended map is an OBJ file: give a name that ends in .obj, not {path}"
        )
    shape, error = mended
    scaled = shape.vertices / metres_per(_UNIT)
    content = mesh_bytes(scaled, shape.facets, ".obj", f"{shape.name}, in {_UNIT}, in K")
    left = error.table.astype(np.float32)

    def write(name: Path) -> None:
        with name.open("wb") as file:
            np.savez_compressed(file, vertices=shape.vertices, left=left, rest=error.rest)

    write_whole(path.with_suffix(".npz"), write)
    write_whole(path, lambda name: name.write_bytes(content))


def map_files(path: Path) -> list[Path]:
    """The files that `load_map` reads."""
    beside = path.with_suffix(".npz")
    return [path, beside] if beside.is_file() else [path]


def load_map(path: Path, unit: str) -> tuple[Polyhedron, MapError | None]:
    """Reads a map, and the error that is left of it if it was written by `save_mended_map`.

    Args:
      path: a mesh file, whose vertices are in K. unit: of the numbers in it, "km" or "m".

    Raises:
      InputError: the mesh cannot be read or is not sound, or the file of errors beside it is
        damaged or of another mesh.
    """
    shape = Polyhedron.load(path, unit)
    beside = path.with_suffix(".npz")
    if not beside.is_file():
        return shape, None
    try:
        with beside.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            vertices, left, rest = (file[name] for name in ("vertices", "left", "rest"))
            left, rest = left.astype(float), float(rest)
    except Exception as error:  # Damaged files raise errors of many types.
        raise InputError(f"{beside} is not the error of a map: {error}") from error
    most = _SAME * float(shape.extents.max())
    if vertices.shape != shape.vertices.shape or np.abs(vertices - shape.vertices).max() > most:
        raise InputError(
            f"{beside} is the error of another mesh than {path.name}: remove it if the mesh was "
            "changed on purpose, and give navigation.expected.surface_rms_m"
        )
    if left.ndim != 2 or len(left) != len(vertices) or not (np.isfinite(left).all() and rest >= 0):
        raise InputError(f"{beside} is damaged: its errors are not finite numbers for each vertex")
    return shape, MapError.known(left, rest)
