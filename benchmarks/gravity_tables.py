"""Compares ways to make the table of gravity: harmonics and Chebyshev polynomials of some degrees.

In one eighth of the octree about Kleopatra; memory, evaluations and time are times eight:

    python benchmarks/gravity_tables.py
"""

import argparse
import time
from collections.abc import Callable

import numpy as np
from numpy.polynomial import chebyshev
from rich.console import Console
from rich.table import Table

from proxops.diagrams.scenario import load_body
from proxops.systems.gravity import _harmonic_boxes as harmonics

BOUND = 1e-9
# Half the edge of the octree's cube, in greatest semi-axes.
REACH = 10.0

Fit = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""The greatest relative error (N,) of boxes with centres (N, 3) and half edges (N,)."""


def boxes_needed(fit: Fit, semi_axes: np.ndarray) -> int:
    """Number of boxes in one octant."""
    half = 0.5 * REACH * semi_axes.max()
    centres, count = np.full((1, 3), half), 0
    while len(centres):
        half *= 0.5
        octants = half * (2.0 * np.array(list(np.ndindex(2, 2, 2))) - 1.0)
        cells = (centres[:, None] + octants).reshape(-1, 3)
        cells = cells[np.sum(((np.abs(cells) + half) / semi_axes) ** 2, axis=1) > 1.0]
        good = fit(*harmonics._outer_boxes(cells, half, semi_axes)) <= 0.5 * BOUND
        count += np.count_nonzero(good)
        centres = cells[~good]
    return count


def harmonic_fit(evaluate: harmonics.Evaluate, degree: int) -> Fit:
    harmonics.DEGREE = degree
    harmonics._inverse.cache_clear()
    return lambda places, halves: harmonics._fit(evaluate, places, halves)[1]


def chebyshev_fit(evaluate: harmonics.Evaluate, degree: int) -> Fit:
    """Interpolates the potential at Chebyshev nodes; acceleration is its gradient."""
    nodes = np.cos(np.pi * (np.arange(degree + 1) + 0.5) / (degree + 1))
    grid = np.stack(np.meshgrid(nodes, nodes, nodes, indexing="ij"), axis=-1).reshape(-1, 3)
    inverse = np.linalg.inv(chebyshev.chebvander(nodes, degree))
    checks = harmonics._checks()
    values = np.array([chebyshev.chebvander(checks[:, k], degree) for k in range(3)])
    derive = chebyshev.chebder(np.eye(degree + 1))
    slopes = np.array(
        [chebyshev.chebvander(checks[:, k], degree - 1) @ derive for k in range(3)]
    )  # fmt: skip

    def fit(places: np.ndarray, halves: np.ndarray) -> np.ndarray:
        errors = []
        for place, half in zip(places, halves, strict=True):  # One at a time: they are large.
            cube = evaluate(place + half * grid)[:, 0].reshape((degree + 1,) * 3)
            cube = np.einsum("ai,bj,ck,ijk->abc", inverse, inverse, inverse, cube, optimize=True)
            want = evaluate(place + half * checks)
            found = [values] + [values.copy() for _ in range(3)]
            for k in range(3):
                found[k + 1][k] = slopes[k] / half
            have = np.array(
                [np.einsum("na,nb,nc,abc->n", *each, cube, optimize=True) for each in found]
            )
            off = np.linalg.norm(have[1:].T - want[:, 1:4], axis=1)
            pull = off / np.linalg.norm(want[:, 1:4], axis=1)
            errors.append(max(np.abs(have[0] / want[:, 0] - 1.0).max(), pull.max()))
        return np.array(errors)

    return fit


def main() -> None:
    argparse.ArgumentParser(description=__doc__.splitlines()[0]).parse_args()
    body = load_body("kleopatra")
    evaluated = 0

    def evaluate(points: np.ndarray) -> np.ndarray:
        nonlocal evaluated
        evaluated += len(points)
        return body.exact_field.columns(points)

    table = Table(title=f"Kleopatra, relative error below {BOUND:g}")
    for heading in ("", "degree", "numbers a box", "boxes", "MB", "evaluations", "CPU time (s)"):
        table.add_column(heading, justify="left" if not heading else "right")
    for name, make, degrees, numbers in (
        ("solid harmonics", harmonic_fit, (12, 16, 20), lambda p: 2 * harmonics.entries(p)),
        ("Chebyshev", chebyshev_fit, (10, 12), lambda p: (p + 1) ** 3),
    ):
        for degree in degrees:
            evaluated, started = 0, time.process_time()
            boxes = 8 * boxes_needed(make(evaluate, degree), body.keep_out_semi_axes)
            seconds = 8.0 * (time.process_time() - started)
            size = 8e-6 * boxes * numbers(degree)
            table.add_row(
                name, str(degree), str(numbers(degree)), str(boxes), f"{size:.0f}",
                f"{8e-6 * evaluated:.2f} M", f"{seconds:.0f}",
            )  # fmt: skip
    Console().print(table)


if __name__ == "__main__":
    main()
