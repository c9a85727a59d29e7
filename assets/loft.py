"""The shapes of the bodies that ship: from a table of radii to the shipped mesh.

Kleopatra's table gives cross-sections of the body along its long axis; that of the other bodies
gives the radius by latitude and longitude, of which each latitude is a section about z. ``loft``
joins the sections, station by station, to the full-resolution surface: exact, but with
needle-shaped facets at the tips. ``build_mesh`` wraps that surface in some 4,000 well-shaped
facets. It starts from a geodesic capsule (the caps of a subdivided icosahedron with a longer band
between them), lays it on the loft by distance along the axis and azimuth, and alternates smoothing
along the surface with projection back on to it. Last, the vertices move along their normals until
facets and loft agree on average: with its vertices on a convex surface a mesh lies inside it, and
would lose volume.

Lengths are in kilometres. Axes: those of the model that was measured (Kleopatra: x the long axis, z
the spin axis; otherwise z is the pole of the table). Origin: the centre of mass at uniform density,
of the measured model in the table and the loft, of the mesh itself in ``build_mesh``'s result.

``python -m proxops.assets.loft`` rebuilds all meshes beside their tables and prints how good they
are; ``python -m proxops.assets.loft bennu`` rebuilds one.
"""

from __future__ import annotations

import dataclasses as dc
import sys
import typing
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.interpolate import RegularGridInterpolator
from scipy.sparse.linalg import spsolve
from scipy.spatial import KDTree

from proxops.assets import ASSETS

if typing.TYPE_CHECKING:
    import trimesh

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Weight of a vertex's move against the distance of a sample, both squared.
_STIFFNESS = 0.1


@dc.dataclass(frozen=True)
class Figure:
    """A shape that ships: its table, and the net of which its mesh is made."""

    path: str
    """Of both files in the assets' folder, without what they end in."""
    cap: int
    band: int
    """Numbers of `geodesic_capsule`: the mesh has 10 cap (cap + band) facets."""
    heading: str
    """Whose shape it is, and its axes."""
    source: str
    """What was measured; in lines, as the mesh's first comment has them."""

    @property
    def table(self) -> Path:
        """The table of radii."""
        return ASSETS / f"{self.path}_radii.csv"

    @property
    def mesh(self) -> Path:
        """The shipped mesh."""
        return ASSETS / f"{self.path}.obj"

    @property
    def header(self) -> str:
        """The first lines of the mesh's file."""
        text = (
            f"{self.heading}, origin the centre of mass\n(uniform density). "
            f"Built from {self.table.name}, which was measured on {self.source}\n"
            "To rebuild: python -m proxops.assets.loft"
        )
        return "".join(f"# {line}\n" for line in text.split("\n"))


_POLE = "km: z the pole"
# A body of revolution as thick as it is long takes cap = band; a longer band suits a longer body.
FIGURES = {
    "kleopatra": Figure(
        "kleopatra/kleopatra", 8, 42, "(216) Kleopatra, km: x the long axis, z the spin axis",
        "the radar model of\n"
        "S. J. Ostro et al., Science 288 (2000), PDS data set EAR-A-5-DDR-RADARSHAPE-MODELS-V2.0.",
    ),
    "bennu": Figure(
        "bennu/bennu", 14, 14, f"(101955) Bennu, {_POLE}",
        "the\nlaser altimetry model SPO v54 of the OSIRIS-REx Altimetry Working Group (CC0).",
    ),
    "ryugu": Figure(
        "ryugu/ryugu", 14, 14, f"(162173) Ryugu, {_POLE}",
        "the\nSfM model of S. Watanabe et al., Science 364 (2019), ISAS/JAXA (CC BY 4.0).",
    ),
    "toutatis": Figure(
        "toutatis/toutatis", 10, 30, "(4179) Toutatis, km: z the long axis",
        "the\nradar model of R. S. Hudson and S. J. Ostro, Science 270 (1995), PDS (CC0).",
    ),
    "didymos": Figure(
        "didymos/didymos", 14, 14, f"(65803) Didymos, {_POLE}",
        "the\nDART model v003 of R. T. Daly et al., PDS (CC0).",
    ),
    "dimorphos": Figure(
        "didymos/dimorphos", 14, 14, f"Dimorphos, {_POLE}",
        "the\nDART model v004 of R. T. Daly et al., PDS (CC0).",
    ),
}  # fmt: skip
KLEOPATRA = FIGURES["kleopatra"]


def read_sections(path: Path = KLEOPATRA.table) -> FloatArray:
    """The measured surface points (S, A, 3), km: S sections across an axis, A azimuths around it.

    Either the axis is x: each row of the table, after the header, is one section, x_km, yc_km,
    zc_km and the radii from that centre at equal steps of azimuth from +y to +z. Or, if the header
    begins with latitude_deg, it is z: each row is a latitude and the distances from the origin at
    equal steps of longitude from +x to +y. The first section and the last are the tips, or the
    poles: single points.

    Raises:
        ValueError: the rows do not ascend, do not begin and end with a tip, or hold a radius that
            is not positive in between.
    """
    with path.open(encoding="ascii") as file:
        by_latitude = file.readline().startswith("latitude_deg")
    rows = np.loadtxt(path, delimiter=",", skiprows=1, dtype=np.float64, ndmin=2)
    if not (np.diff(rows[:, 0]) > 0).all():
        raise ValueError(f"{path}: stations must ascend")
    return _by_latitude(rows, path) if by_latitude else _across_x(rows, path)


def _across_x(rows: FloatArray, path: Path) -> FloatArray:
    centres, radii = rows[:, None, :3], rows[:, 3:]
    if radii[[0, -1]].any() or not (radii[1:-1] > 0).all():
        raise ValueError(f"{path}: radii must be zero in the first and last row only")
    angle = np.arange(radii.shape[1]) * (2 * np.pi / radii.shape[1])
    spokes = np.stack([np.zeros_like(angle), np.cos(angle), np.sin(angle)], axis=1)
    return centres + radii[..., None] * spokes


def _by_latitude(rows: FloatArray, path: Path) -> FloatArray:
    latitude, radii = np.radians(rows[:, :1]), rows[:, 1:]
    poles = radii[[0, -1]]
    if (rows[[0, -1], 0] != [-90, 90]).any() or (poles != poles[:, :1]).any():
        raise ValueError(f"{path}: the first and last row must be the poles, each with one radius")
    if not (radii > 0).all():
        raise ValueError(f"{path}: radii must be positive")
    longitude = np.arange(radii.shape[1]) * (2 * np.pi / radii.shape[1])
    across = radii * np.cos(latitude)
    across[[0, -1]] = 0.0  # The cosine of 90 degrees is not quite 0.
    places = across * np.cos(longitude), across * np.sin(longitude), radii * np.sin(latitude)
    return np.stack(places, axis=-1)


def loft(sections: FloatArray) -> trimesh.Trimesh:
    """The full-resolution surface, outward: (S - 2) A + 2 vertices, 2 (S - 2) A facets, km.

    Each quadrangle between two stations is split along its shorter diagonal.
    """
    import trimesh  # It is slow to import, so only when it is needed.

    tips, body = sections[[0, -1], 0], sections[1:-1].reshape(-1, 3)
    vertices = np.concatenate([tips[:1], body, tips[1:]])
    ring = 1 + np.arange(len(body)).reshape(-1, sections.shape[1])
    after = np.roll(ring, -1, axis=1)  # the next azimuth
    a, b, c, d = (part.ravel() for part in (ring[:-1], after[:-1], after[1:], ring[1:]))
    split_ac = (_length(vertices[c] - vertices[a]) <= _length(vertices[d] - vertices[b]))[:, None]
    faces = [
        np.stack([np.zeros_like(ring[0]), after[0], ring[0]], axis=1),
        np.where(split_ac, np.stack([a, b, c], axis=1), np.stack([a, b, d], axis=1)),
        np.where(split_ac, np.stack([a, c, d], axis=1), np.stack([b, c, d], axis=1)),
        np.stack([np.full_like(ring[0], len(vertices) - 1), ring[-1], after[-1]], axis=1),
    ]
    return trimesh.Trimesh(vertices, np.concatenate(faces), process=False)


def geodesic_capsule(cap: int, band: int) -> tuple[IntArray, FloatArray, IntArray]:
    """A closed net of 10 cap (cap + band) triangles; all but twelve vertices have six neighbours.

    Ring k counted from either tip has 5 k vertices up to k = cap; in between, every ring has
    5 cap. ``band`` is even and at least 2.

    Returns:
        ring of each vertex (V,), 0 to 2 cap + band; its azimuth (V,) in radians; and the facets
        (F, 3), outward where the rings ascend along +x and azimuth runs from +y towards +z.
    """
    last = 2 * cap + band
    sector = [min(k, cap, last - k) for k in range(last + 1)]  # vertices in a fifth of the ring
    size = [max(1, 5 * s) for s in sector]
    start = np.concatenate([[0], np.cumsum(size)])
    # Within the band every other ring is turned by half a step.
    turned = [k % 2 for k in (max(0, min(k - cap, band)) for k in range(last + 1))]
    azimuth = [2 * np.pi * (np.arange(n) + t / 2) / n for n, t in zip(size, turned, strict=True)]

    faces = []
    for k in range(last):
        p, q = sector[k], sector[k + 1]
        low, high = np.arange(5 * p), np.arange(5 * q)  # edges, named by their first vertex
        late = turned[k] if p == q else int(p < q)
        low_apex = low // max(p, 1) * q + low % max(p, 1) + late
        high_apex = high // max(q, 1) * p + high % max(q, 1) + 1 - late
        n, m, i, j = size[k], size[k + 1], start[k], start[k + 1]
        faces.append(np.stack([i + low, i + (low + 1) % n, j + low_apex % m], axis=1))
        faces.append(np.stack([j + (high + 1) % m, j + high, i + high_apex % n], axis=1))
    rings = np.repeat(np.arange(last + 1), size)
    return rings, np.concatenate(azimuth), np.concatenate(faces)


def sample(surface: trimesh.Trimesh, count: int = 100_000) -> tuple[FloatArray, IntArray]:
    """Points spread evenly over a surface by area, no chance involved: (N, 3), and facets (N,).

    Places within a facet follow the additive sequence of M. Roberts, "The unreasonable
    effectiveness of quasirandom sequences" (2018), with the plastic number's powers as steps.
    """
    area = np.cumsum(surface.area_faces)
    facet = np.searchsorted(area, (np.arange(count) + 0.5) / count * area[-1])
    u, v = np.arange(count) * np.array([[0.7548776662466927], [0.5698402909980532]]) % 1
    u, v = np.where(u + v > 1, 1 - u, u)[:, None], np.where(u + v > 1, 1 - v, v)[:, None]
    a, b, c = np.moveaxis(np.asarray(surface.triangles)[facet], 1, 0)
    return a + u * (b - a) + v * (c - a), facet


class NearestPoint:
    """Closest points of a surface, among the facets that hold the eight closest of many samples.

    Exact for all but a few points near concave folds: of points on the shipped mesh, 0.4 % come
    out more than 10 m too far from the loft (0.3 km at worst), none too near.
    """

    def __init__(self, surface: trimesh.Trimesh) -> None:
        """Prepare for queries; later changes to the surface are not seen."""
        self._triangles = np.array(surface.triangles)
        points, self._facet = sample(surface)
        self._tree = KDTree(points)

    def __call__(self, points: FloatArray) -> tuple[FloatArray, IntArray]:
        """Closest point (N, 3) and its facet (N,) for each of the points (N, 3), km."""
        import trimesh  # It is slow to import, so only when it is needed.

        facet = self._facet[self._tree.query(points, k=8)[1]]
        repeated = np.repeat(points, facet.shape[1], axis=0)
        closest = trimesh.triangles.closest_point(self._triangles[facet.ravel()], repeated)
        best = np.argmin(_length(closest - repeated).reshape(facet.shape), axis=1)
        row = np.arange(len(points))
        return closest.reshape(*facet.shape, 3)[row, best], facet[row, best]


def smooth(mesh: trimesh.Trimesh, nearest: NearestPoint, steps: int) -> None:
    """Even out the facets in place: each vertex slides towards its neighbours, along the surface.

    An edge pulls by its length times its length: long edges shrink, and lengths even out.
    """
    first, second = mesh.edges_unique.T
    count = len(mesh.vertices)
    for _ in range(steps):
        vertices, normals = np.array(mesh.vertices), np.array(mesh.vertex_normals)
        weight = _length(vertices[first] - vertices[second])
        pull = sparse.coo_array((weight, (first, second)), (count, count)).tocsr()
        pull = pull + pull.T
        move = pull @ vertices / (pull @ np.ones(count))[:, None] - vertices
        move -= np.sum(move * normals, axis=1)[:, None] * normals
        mesh.vertices = nearest(vertices + 0.7 * move)[0]


def balance(mesh: trimesh.Trimesh, surface: trimesh.Trimesh) -> None:
    """Move the vertices in place along their normals to the least mean square distance.

    With d the distance of a sample of the surface outward from the mesh, and b the barycentric
    weights of the mesh's closest point, the moves m minimise sum (b . m - d)^2 + 0.1 |m|^2.
    """
    import trimesh  # It is slow to import, so only when it is needed.

    samples, _ = sample(surface)
    closest, facet = NearestPoint(mesh)(samples)
    corners = np.asarray(mesh.faces)[facet]
    weight = trimesh.triangles.points_to_barycentric(np.asarray(mesh.triangles)[facet], closest)
    weight *= np.einsum("sci,si->sc", mesh.vertex_normals[corners], mesh.face_normals[facet])
    distance = np.sum((samples - closest) * mesh.face_normals[facet], axis=1)
    row = np.repeat(np.arange(len(samples)), 3)
    shape = (len(samples), len(mesh.vertices))
    design = sparse.coo_array((weight.ravel(), (row, corners.ravel())), shape).tocsc()
    normal_matrix = design.T @ design + _STIFFNESS * sparse.eye_array(shape[1])
    move = spsolve(normal_matrix.tocsc(), design.T @ distance)
    mesh.vertices = mesh.vertices + np.asarray(move)[:, None] * mesh.vertex_normals


def build_mesh(
    sections: FloatArray, cap: int = KLEOPATRA.cap, band: int = KLEOPATRA.band
) -> trimesh.Trimesh:
    """The shipped mesh: outward, km, origin at its centre of mass.

    Args:
        sections: (S, A, 3), from `read_sections`.
        cap: of the net, as of `geodesic_capsule`; it has 10 cap (cap + band) facets.
        band: likewise.
    """
    import trimesh  # It is slow to import, so only when it is needed.

    surface = loft(sections)
    ring, azimuth, faces = geodesic_capsule(cap, band)

    # Rings start evenly spaced by distance along the surface, the mean over the azimuths.
    points = np.concatenate([sections, sections[:, :1]], axis=1)  # azimuth 360 degrees is 0
    step = _length(np.diff(points, axis=0)).mean(axis=1)
    along = np.concatenate([[0.0], np.cumsum(step)])
    axes = (along, np.linspace(0, 2 * np.pi, points.shape[1]))
    places = np.stack([ring / ring[-1] * along[-1], azimuth], axis=1)
    mesh = trimesh.Trimesh(RegularGridInterpolator(axes, points)(places), faces, process=False)

    smooth(mesh, NearestPoint(surface), steps=200)
    for _ in range(3):  # the closest points change as the mesh moves; the third changes little
        balance(mesh, surface)
    mesh.vertices = mesh.vertices - mesh.center_mass
    return mesh


def write_obj(mesh: trimesh.Trimesh, path: Path, header: str = KLEOPATRA.header) -> None:
    """Write a header, vertices (km, to 1 cm) and facets as a Wavefront OBJ file."""
    vertices = "".join(f"v {x:.5f} {y:.5f} {z:.5f}\n" for x, y, z in mesh.vertices)
    faces = "".join(f"f {a} {b} {c}\n" for a, b, c in np.asarray(mesh.faces) + 1)
    path.write_text(header + vertices + faces, encoding="ascii", newline="\n")


def main() -> None:
    """Rebuild the meshes that are named, or all, and print how they compare with their lofts."""
    for name in sys.argv[1:] or FIGURES:
        _rebuild(name)


def _rebuild(name: str) -> None:
    """Rebuild a mesh beside its table and print how it compares with the loft."""
    import trimesh  # It is slow to import, so only when it is needed.

    figure = FIGURES[name]
    sections = read_sections(figure.table)
    surface = loft(sections)
    write_obj(build_mesh(sections, figure.cap, figure.band), figure.mesh, figure.header)
    mesh = trimesh.load_mesh(figure.mesh, process=False)
    to_loft, from_loft = _distances(mesh, surface), _distances(surface, mesh)
    sizes = " x ".join(f"{size:.4g}" for size in mesh.extents)
    edges = mesh.edges_unique_length
    print(f"{name}: {figure.mesh}")
    print(f"facets                    {len(mesh.faces)}, Euler number {mesh.euler_number}")
    print(f"watertight and outward    {mesh.is_volume}")
    print(f"smallest angle            {np.degrees(mesh.face_angles.min()):.1f} deg")
    print(f"edges                     {edges.min():.3g} to {edges.max():.3g} km")
    for title, d in (("mesh to loft", to_loft), ("loft to mesh", from_loft)):
        print(f"{title}, rms and worst  {np.sqrt(np.mean(d**2)):.3g}, {d.max():.2g} km")
    print(f"extents                   {sizes} km")
    print(f"volume over the loft's    {mesh.volume / surface.volume:.5f} ({mesh.volume:,.6g} km3)")
    print(f"centre of mass off by     {1e3 * _length(mesh.center_mass):.3f} m")


def _distances(source: trimesh.Trimesh, target: trimesh.Trimesh) -> FloatArray:
    """Distance to the target from points spread over the source, (N,), km."""
    points, _ = sample(source, 150_000)
    return _length(NearestPoint(target)(points)[0] - points)


def _length(vectors: FloatArray) -> FloatArray:
    return np.linalg.norm(vectors, axis=-1)


if __name__ == "__main__":
    main()
