"""Compares gravity, the lidar and Kleopatra's field with others, point by point.

- Gravity against ESA's polyhedral-gravity, outside the body and inside it;
- the lidar against trimesh, by its own rays and by Embree;
- the second-degree harmonics of Kleopatra's field, fitted far outside, against the moments of its
  volume, and its equilibria against published ones.

The peers come with the extra `bench`:

    python benchmarks/agreement_of_parts.py [--bodies kleopatra two-ellipsoids …] [--points 500]
"""

import argparse
from pathlib import Path

import numpy as np
import trimesh
from _bodies import GENERATED, KLEOPATRA, scenario_at
from _peers import esa_model
from rich.console import Console
from rich.progress import track
from rich.table import Table
from trimesh.ray.ray_pyembree import RayMeshIntersector as EmbreeRays
from trimesh.ray.ray_triangle import RayMeshIntersector as TrimeshRays

from proxops.diagrams.scenario import Body, load_body
from proxops.systems import GravityField, Polyhedron, ray_directions
from proxops.systems.common import generator
from proxops.systems.gravity import GRAVITATIONAL_CONSTANT, find_equilibria
from proxops.systems.shapes import ray_caster

# X. Wang, Y. Jiang, S. Gong, "Analysis of the potential field and equilibrium points of
# irregular-shaped minor celestial bodies", Astrophys. Space Sci. 353 (2014) 105: the radar model at
# 3,600 kg/m^3 and 5.385 h; E1 to E4, in km.
PUBLISHED = np.array(
    [
        [142.852, 2.441, 1.181],
        [-1.164, 100.740, -0.545],
        [-144.684, 5.188, -0.272],
        [2.230, -102.102, 0.271],
    ]
)
PUBLISHED_DENSITY, PUBLISHED_PERIOD = 3600.0, 5.385 * 3600.0
FRAMES = 20


def some_points(body: Body, count: int) -> dict[str, np.ndarray]:
    """Points (N, 3) in m outside the body, up to three half lengths from it, and inside it."""
    half = 0.5 * body.shape.extents.max()
    points = generator(2, 0).uniform(-3.0 * half, 3.0 * half, (40 * count, 3))
    near = generator(2, 1).uniform(-0.5, 0.5, (40 * count, 3)) * body.shape.extents
    inside = body.exact_field.evaluate(near).inside
    free = ~body.exact_field.evaluate(points[:count]).inside
    return {"outside": points[:count][free], "inside": near[inside][:count]}


def gravity_apart(body: Body, points: np.ndarray) -> list[float]:
    """Greatest differences of potential, acceleration and gradient, each over its size there."""
    model, ours = esa_model(body.exact_field), body.exact_field.evaluate(points)
    values = [model(point, False) for point in points]
    potential = np.array([value[0] for value in values])
    pull = np.array([value[1] for value in values])
    xx, yy, zz, xy, xz, yz = np.array([value[2] for value in values]).T
    gradient = np.stack([xx, xy, xz, xy, yy, yz, xz, yz, zz], axis=1)
    pairs = (
        (ours.potential[:, None], potential[:, None]),
        (ours.acceleration, pull),
        (ours.gradient.reshape(-1, 9), gradient),
    )
    apart = []
    for mine, theirs in pairs:
        size = np.linalg.norm(theirs, axis=1)
        # The other's sign may be the opposite one, but then of all of its values.
        same, opposite = (np.linalg.norm(mine - sign * theirs, axis=1) / size for sign in (1, -1))
        apart.append(float(min(same.max(), opposite.max())))
    return apart


def lidar_apart(body: Body) -> list[str]:
    """Rays on which another cast hits or misses alone, and the greatest difference of the rest."""
    directions, mesh, caster = ray_directions(), body.shape.to_trimesh(), ray_caster(body.shape)
    half = 0.5 * float(body.shape.extents.max())
    axes = generator(3, 0).normal(size=(FRAMES, 3))
    poses = 2.0 * half * axes / np.linalg.norm(axes, axis=1, keepdims=True)
    found: list[str] = []
    for kind in (TrimeshRays, EmbreeRays):
        peer, others, worst, hits = kind(mesh), 0, 0.0, 0
        for pose in poses:
            origins = np.broadcast_to(pose, directions.shape)
            mine = caster.distances(origins, directions)
            points, rays, _ = peer.intersects_location(origins, directions, multiple_hits=False)
            theirs = np.full(len(directions), np.inf)
            theirs[rays] = np.linalg.norm(points - pose, axis=1)
            both = np.isfinite(mine) & np.isfinite(theirs)
            others += int((np.isfinite(mine) ^ np.isfinite(theirs)).sum())
            worst = max(worst, float(np.abs(mine - theirs)[both].max(initial=0.0)))
            hits += int(both.sum())
        found += [f"{hits:,}", str(others), f"{worst / half:.1e}"]
    return [found[0], found[1], found[2], found[4], found[5]]


def second_moments(shape: Polyhedron) -> np.ndarray:
    """Means (3, 3) of x_i x_j over the volume, in m^2, from its tetrahedra to the origin."""
    corners = shape.vertices[shape.facets]
    volumes = np.linalg.det(corners) / 6.0
    sums = corners.sum(axis=1)
    products = np.einsum("n,ni,nj->ij", volumes, sums, sums)
    products += np.einsum("n,nki,nkj->ij", volumes, corners, corners)
    return products / 20.0 / volumes.sum()


def fitted_moments(field: GravityField) -> np.ndarray:
    """C20 and C22 times a squared length in m^2, from the potential on a far sphere.

    The potential times a harmonic is integrated over the sphere by Gauss and by the trapezium rule.
    """
    radius = 10.0 * float(field.shape.extents.max())
    heights, weights = np.polynomial.legendre.leggauss(24)
    angles = np.arange(48) * 2.0 * np.pi / 48
    z, angle = (grid.ravel() for grid in np.meshgrid(heights, angles, indexing="ij"))
    weight = np.repeat(weights, 48) / 48 / 2.0
    flat = np.sqrt(1.0 - z**2)
    points = radius * np.stack([flat * np.cos(angle), flat * np.sin(angle), z], axis=1)
    potential = field.evaluate(points).potential / (GRAVITATIONAL_CONSTANT * field.mass / radius)
    # Squares of these are 1/5 and 12/5 in the mean over the sphere.
    zonal, sectoral = 1.5 * z**2 - 0.5, 3.0 * flat**2 * np.cos(2.0 * angle)
    parts = [5.0 * np.sum(weight * potential * zonal)]
    parts.append(5.0 / 12.0 * np.sum(weight * potential * sectoral))
    return radius**2 * np.array(parts)


def kleopatra_rows() -> list[tuple[str, str]]:
    """Harmonics and equilibria of Kleopatra."""
    shape = load_body(KLEOPATRA).shape
    field = GravityField(shape, density=PUBLISHED_DENSITY)
    means, radius = second_moments(shape), np.cbrt(0.75 * shape.volume / np.pi)
    told = [means[2, 2] - 0.5 * (means[0, 0] + means[1, 1]), 0.25 * (means[0, 0] - means[1, 1])]
    fitted = fitted_moments(field)
    # Those to compare with are of the shape in its principal axes.
    turn = np.linalg.eigh(shape.to_trimesh().moment_inertia)[1]
    turn *= np.sign(np.diag(turn))
    principal = GravityField(
        Polyhedron(shape.vertices @ turn, shape.facets, shape.name), density=PUBLISHED_DENSITY
    )
    points = find_equilibria(principal, 2.0 * np.pi / PUBLISHED_PERIOD)
    outside = np.array([point.position for point in points if not point.inside])
    apart = np.linalg.norm(outside - 1e3 * PUBLISHED, axis=1)
    rows = [
        (f"{name}, reference radius {1e-3 * radius:.2f} km", f"{value / radius**2:.9f}")
        for name, value in zip(("C20", "C22"), fitted, strict=True)
    ]
    rows += [
        ("apart from the moments of the volume", f"{np.abs(fitted / told - 1.0).max():.1e}"),
        ("E1 to E4 from the published (m)", ", ".join(f"{value:.0f}" for value in apart)),
        (
            "published from the centre (km)",
            ", ".join(f"{np.linalg.norm(p):.0f}" for p in PUBLISHED),
        ),
    ]
    return rows


def main() -> None:
    """Prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--bodies", nargs="+", default=[KLEOPATRA, *GENERATED], metavar="BODY")
    parser.add_argument("--points", type=int, default=500)
    parser.add_argument("--out", type=Path, default=Path("out/agreement"), help="for the bodies")
    arguments = parser.parse_args()
    gravity = Table(title="greatest relative difference from ESA's gravity", title_justify="left")
    for heading in ("", "points", "potential", "acceleration", "gradient"):
        gravity.add_column(heading, justify="right" if heading else "left")
    casts = Table(title=f"{FRAMES} frames against trimesh", title_justify="left")
    headings = ("", "hits", "hit by one alone", "apart (of half length)", "alone, Embree")
    for heading in (*headings, "apart, Embree"):
        casts.add_column(heading, justify="right" if heading else "left")
    for name in track(arguments.bodies, "comparing", console=Console(stderr=True)):
        body = load_body(scenario_at(name, arguments.out).body)
        for where, points in some_points(body, arguments.points).items():
            values = [f"{value:.1e}" for value in gravity_apart(body, points)]
            gravity.add_row(f"{name}, {where}", str(len(points)), *values)
        casts.add_row(name, *lidar_apart(body))
    console = Console()
    console.print(gravity)
    console.print(casts)
    for name, value in kleopatra_rows():
        console.print(f"{name}: {value}")


if __name__ == "__main__":
    trimesh.util.log.disabled = True
    main()
