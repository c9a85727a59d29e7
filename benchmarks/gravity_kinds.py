"""Compares kinds of polynomials for a table of gravity: error against memory and time.

An octree is divided outside Kleopatra's keep-out ellipsoid until each box has a relative error of
potential and acceleration below a bound, at points that the fit did not use. In a box stands

- `harmonic`: a harmonic polynomial of degree 16, as `TabulatedField` has it, fitted to potential,
  acceleration and gradient on the box's surface;
- `Chebyshev N`: a product of Chebyshev polynomials of degree N along each axis, through the
  potential at Chebyshev nodes; the acceleration is its derivative. N = 5 is a quintic.

Boxes are those of one octant, times eight: figures of the whole body are a few per cent less. Where
they would take more than `--most` MB, it stops. The time is that of a look-up of potential and
acceleration in the smallest boxes, at random points, without the way down the octree; `harmonic`
gives the gradient too.

    python benchmarks/gravity_kinds.py [--bounds 1e-5 1e-7 1e-9] [--degrees 5 8 10]
        [--most 256] [--markdown FILE]
"""

import argparse
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[name] = "1"

import numba
import numpy as np
from _campaign import show
from numpy.polynomial import chebyshev

from proxops.diagrams.scenario import load_body
from proxops.systems.gravity import GravityField
from proxops.systems.gravity import _harmonic_boxes as harmonic
from proxops.systems.gravity import _table_kernel as kernel
from proxops.systems.gravity._far_field import SWITCH

HEADINGS = ("numbers a box", "boxes", "memory (MB)", "evaluations (M)", "look-up (µs)")
_OCTANTS = np.array(list(np.ndindex(2, 2, 2))) - 0.5
_LOOK_UPS = 20_000

Fit = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Gives coefficients (N, …) and relative errors (N,) of boxes with centres (N, 3) and halves."""


class Kind(NamedTuple):
    """A kind of polynomial."""

    name: str
    numbers: int
    """Coefficients of a box, with what is stored to read them fast."""
    samples: int
    """Evaluations of the field that a fit and its check take."""
    fit: Fit
    look_up: Callable[[np.ndarray, np.ndarray, np.ndarray], None]
    """Fills at least four columns of out (N, 14) from boxes and points (N, 3) in them, in turn."""


class Octant(NamedTuple):
    """What an octant takes."""

    boxes: int
    """Those that are good enough."""
    fits: int
    """Those that were fitted."""
    coefficients: np.ndarray
    """Of the smallest boxes."""


def harmonic_kind(field: GravityField) -> Kind:
    """What `TabulatedField` has."""
    steps, degree = harmonic.recursion(harmonic.DEGREE), harmonic.DEGREE
    points, _ = harmonic._inverse()

    def fit(places: np.ndarray, halves: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return harmonic._fit(field.columns, places, halves)

    def look_up(coefficients: np.ndarray, points: np.ndarray, out: np.ndarray) -> None:
        one_each(coefficients, points, steps, degree, out)

    samples = len(points) + len(harmonic._checks())
    return Kind("harmonic", 2 * harmonic.entries(degree), samples, fit, look_up)


@numba.njit(error_model="numpy")
def one_each(coefficients, points, steps, degree, out):
    for i in range(len(points)):
        x, y, z = points[i]
        box = coefficients[i % len(coefficients)]
        kernel._fill(kernel._expand(x, y, z, box, steps, degree), out[i])


def chebyshev_kind(field: GravityField, degree: int) -> Kind:
    """A product of Chebyshev polynomials along the axes."""
    count = degree + 1
    nodes = np.cos(np.pi * (np.arange(count) + 0.5) / count)
    grid = np.stack(np.meshgrid(nodes, nodes, nodes, indexing="ij"), axis=-1).reshape(-1, 3)
    inverse = np.linalg.inv(chebyshev.chebvander(nodes, degree))
    checks = harmonic._checks()
    value = [chebyshev.chebvander(checks[:, k], degree) for k in range(3)]
    slopes = chebyshev.chebder(np.eye(count))
    slope = [chebyshev.chebvander(checks[:, k], degree - 1) @ slopes for k in range(3)]

    def fit(places: np.ndarray, halves: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        at = places[:, None] + halves[:, None, None] * grid
        potential = field.columns(at.reshape(-1, 3))[:, 0].reshape(-1, count, count, count)
        coefficients = np.einsum("bijk,xi,yj,zk->bxyz", potential, *[inverse] * 3, optimize=True)
        at = places[:, None] + halves[:, None, None] * checks
        wanted = field.columns(at.reshape(-1, 3))[:, :4].reshape(len(places), -1, 4)
        found = np.empty_like(wanted)
        for k in range(4):
            along = [slope[a] if a == k - 1 else value[a] for a in range(3)]
            found[:, :, k] = np.einsum("bxyz,px,py,pz->bp", coefficients, *along, optimize=True)
        found[:, :, 1:] /= halves[:, None, None]
        off = found - wanted
        pull = np.linalg.norm(off[:, :, 1:], axis=2) / np.linalg.norm(wanted[:, :, 1:], axis=2)
        return coefficients, np.maximum(np.abs(off[:, :, 0] / wanted[:, :, 0]), pull).max(axis=1)

    samples = len(grid) + len(checks)
    return Kind(f"Chebyshev {degree}", count**3, samples, fit, products)


@numba.njit(error_model="numpy", fastmath={"reassoc", "contract"})
def products(coefficients, points, out):
    count = coefficients.shape[1]
    t, d = np.empty((3, count)), np.empty((3, count))
    for i in range(len(points)):
        for a in range(3):
            x = points[i, a]
            t[a, 0], t[a, 1], d[a, 0], d[a, 1] = 1.0, x, 0.0, 1.0
            for n in range(2, count):
                t[a, n] = 2.0 * x * t[a, n - 1] - t[a, n - 2]
                d[a, n] = 2.0 * t[a, n - 1] + 2.0 * x * d[a, n - 1] - d[a, n - 2]
        box = coefficients[i % len(coefficients)]
        u = gx = gy = gz = 0.0
        for j in range(count):
            uj = yj = zj = 0.0
            for k in range(count):
                line, steep = 0.0, 0.0
                for n in range(count):
                    line += box[j, k, n] * t[2, n]
                    steep += box[j, k, n] * d[2, n]
                uj += line * t[1, k]
                yj += line * d[1, k]
                zj += steep * t[1, k]
            u, gx = u + uj * t[0, j], gx + uj * d[0, j]
            gy, gz = gy + yj * t[0, j], gz + zj * t[0, j]
        out[i, 0], out[i, 1], out[i, 2], out[i, 3] = u, gx, gy, gz


def divided(
    kind: Kind, semi_axes: np.ndarray, half: float, bound: float, most: float
) -> Octant | None:
    """Divides an octant until all errors are below a bound; None: `most` MB would not do."""
    good, fits, coefficients = 0, 0, np.zeros(0)
    centres, half = np.full((1, 3), 0.5 * half), 0.5 * half
    while len(centres):
        some = np.sum(((np.abs(centres) + half) / semi_axes) ** 2, axis=1) > 1.0
        centres = centres[some]
        if megabytes(kind, good + len(centres)) > most:
            return None
        places, halves = harmonic._outer_boxes(centres, half, semi_axes)
        coefficients, errors = kind.fit(places, halves)
        fits += len(errors)
        bad = errors > bound
        good += int(np.count_nonzero(~bad))
        centres = (centres[bad][:, None] + half * _OCTANTS).reshape(-1, 3)
        half *= 0.5
    return Octant(good, fits, coefficients)


def megabytes(kind: Kind, boxes: int) -> float:
    """Memory of eight octants with so many boxes each."""
    return 8.0 * 8e-6 * kind.numbers * boxes


def look_up_time(kind: Kind, coefficients: np.ndarray) -> float:
    """Median time in s of a look-up in boxes in turn, at random points."""
    points = np.random.default_rng(0).uniform(-1.0, 1.0, (_LOOK_UPS, 3))
    out, times = np.empty((_LOOK_UPS, 14)), []
    for _ in range(8):
        started = time.perf_counter()
        kind.look_up(coefficients, points, out)
        times.append(time.perf_counter() - started)
    return float(np.median(times[1:])) / _LOOK_UPS


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--bounds", nargs="+", type=float, default=[1e-5, 1e-7, 1e-9])
    parser.add_argument("--degrees", nargs="+", type=int, default=[5, 8, 10])
    parser.add_argument("--most", type=float, default=256.0, help="MB")
    parser.add_argument("--markdown", type=Path, help="also write the table there")
    asked = parser.parse_args()
    body, lines = load_body("kleopatra"), {}
    field = body.gravity_field
    assert isinstance(field, GravityField)
    half = SWITCH * float(np.linalg.norm(body.shape.vertices, axis=1).max())
    kinds = [harmonic_kind(field), *(chebyshev_kind(field, each) for each in asked.degrees)]
    for kind in kinds:
        for bound in sorted(asked.bounds, reverse=True):
            found = divided(kind, body.keep_out_semi_axes, half, bound, asked.most)
            cells = ["–", f"over {asked.most:.0f}", "–", "–"]
            if found is not None:
                cells = [
                    f"{8 * found.boxes:,}",
                    f"{megabytes(kind, found.boxes):.0f}",
                    f"{8e-6 * kind.samples * found.fits:.1f}",
                    f"{1e6 * look_up_time(kind, found.coefficients):.2f}",
                ]
            lines[f"{kind.name}, {bound:.0e}"] = [str(kind.numbers), *cells]
            print(*lines[f"{kind.name}, {bound:.0e}"], flush=True)
    show("tables of gravity about Kleopatra", HEADINGS, lines, asked.markdown)


if __name__ == "__main__":
    main()
