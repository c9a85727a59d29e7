"""Shows what the model leaves out, as forces on the spacecraft, and how much each would matter.

Each row is the greatest acceleration that an assumption leaves out, over points in the cube of the
default scenario and outside the keep-out ellipsoid, then the force that balances it on a spacecraft
of 100 kg, and the Δv of balancing it through a transit of 5,000 s. Gravity itself stands first.

    python benchmarks/modelling_limits.py
"""

import argparse
import os

for name in ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[name] = "1"

import numpy as np
from rich.console import Console
from rich.table import Table

from proxops.diagrams.scenario import Body, load_body, load_scenario
from proxops.systems.gravity import GRAVITATIONAL_CONSTANT, GravityField

TRANSIT = 5000.0  # s
DENSER = 0.10  # share by which one lobe is denser than the mean, and the other less dense
TILT = np.radians(1.0)  # of the body about its y axis, as a wobble would have it
LATTICE = 4e3  # m, spacing of the point masses that stand for the denser lobe
ASTRONOMICAL_UNIT = 1.495978707e11
SUN_DISTANCE = 2.79 * ASTRONOMICAL_UNIT  # Kleopatra's mean
SUN_GM = 1.32712440018e20
SOLAR_PRESSURE = 4.56e-6  # N/m^2 at 1 au, absorbed
SUNLIT_AREA, REFLECTION = 5.0, 1.3  # m^2, panels included
# Its two moons are below 10 km across and beyond 450 km: taken as one of 10 km, of its density.
MOON_RADIUS, MOON_DISTANCE = 5e3, 450e3
ATTITUDE = np.radians(0.1)


def sample(body: Body, half: float, count: int = 4000) -> np.ndarray:
    """Points (N, 3) in the cube and outside the keep-out ellipsoid."""
    points = np.random.default_rng(0).uniform(-half, half, (count, 3))
    return points[np.sum((points / body.keep_out_semi_axes) ** 2, axis=1) > 1.0]


def lobes(body: Body, field: GravityField, points: np.ndarray) -> np.ndarray:
    """Change of acceleration (N, 3) if the lobe at x > 0 is denser and the other less."""
    corners = body.shape.vertices
    ends = zip(corners.min(axis=0), corners.max(axis=0), strict=True)
    ranges = [np.arange(low, high, LATTICE) for low, high in ends]
    places = np.stack(np.meshgrid(*ranges, indexing="ij"), axis=-1).reshape(-1, 3)
    places = places[field.evaluate(places).inside]
    extra = field.mass / len(places) * DENSER * np.sign(places[:, 0])
    extra -= extra.mean()  # The mass is what it is.
    shift = extra @ places / field.mass
    # Seen from the centre of mass, where navigation has its origin, and which has moved too.
    seen = points + shift
    change = field.evaluate(seen).acceleration - field.evaluate(points).acceleration
    for place, mass in zip(places, extra, strict=True):
        away = place - seen
        change += GRAVITATIONAL_CONSTANT * mass * away / np.sum(away**2, axis=1)[:, None] ** 1.5
    return change


def tilted(field: GravityField, points: np.ndarray) -> np.ndarray:
    """Change of acceleration (N, 3) if the body is turned by `TILT` about y."""
    c, s = np.cos(TILT), np.sin(TILT)
    turn = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    return field.evaluate(points @ turn).acceleration @ turn.T - field.evaluate(points).acceleration


def main() -> None:
    argparse.ArgumentParser(description=__doc__.splitlines()[0]).parse_args()
    scenario = load_scenario()
    body = load_body(scenario.body)
    field, mass = body.exact_field, scenario.spacecraft.mass_kg
    points = sample(body, 0.5 * scenario.transit.cube_m)
    far = float(np.linalg.norm(points, axis=1).max())
    gravity = np.linalg.norm(field.evaluate(points).acceleration, axis=1)
    pressure = SOLAR_PRESSURE * REFLECTION * SUNLIT_AREA / mass
    moon = 4.0 / 3.0 * np.pi * MOON_RADIUS**3 * field.density * GRAVITATIONAL_CONSTANT
    rows = {
        "gravity itself, for comparison": gravity.max(),
        "mass known to 11 %": 0.11 * gravity.max(),
        f"lobes {100 * DENSER:.0f} % denser and less dense": np.linalg.norm(
            lobes(body, field, points), axis=1
        ).max(),
        "body tilted by 1 degree": np.linalg.norm(tilted(field, points), axis=1).max(),
        "solar pressure on 5 m²": pressure / (SUN_DISTANCE / ASTRONOMICAL_UNIT) ** 2,
        "the Sun's tide": 2.0 * SUN_GM * far / SUN_DISTANCE**3,
        "a moon of 10 km at 450 km": moon / (MOON_DISTANCE - far) ** 2,
    }
    table = Table(title=f"{len(points)} points, {mass:g} kg")
    for heading in ("left out", "m/s²", "N", f"m/s in {TRANSIT:.0f} s"):
        table.add_column(heading, justify="right" if heading != "left out" else "left")
    for label, value in rows.items():
        table.add_row(label, f"{value:.1e}", f"{mass * value:.1e}", f"{TRANSIT * value:.1e}")
    console = Console(width=100)
    console.print(table)
    console.print(
        f"attitude off by 0.1 degree moves a return 150 km away by {ATTITUDE * 150e3:.0f} m"
    )


if __name__ == "__main__":
    main()
