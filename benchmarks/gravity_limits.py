"""Counts the operations of the exact gravity kernel and compares its time with this core's limits.

The counts follow from the kernel's loops and the mesh's vertices, facets and edges. The rates are
measured on this machine, by loops as simple as can be that numba compiles in the same way: fused
multiply-adds on registers, divisions, square roots, sums that read the tables, and gathering by
index. `docs/method/gravity_limits.md` says what follows. Run it on a machine that does nothing
else:

    python benchmarks/gravity_limits.py
"""

import argparse
import math
import time
from collections.abc import Callable

import numba
import numpy as np
from rich.console import Console
from rich.table import Table

from proxops.diagrams.scenario import load_body
from proxops.systems.gravity._polyhedral_kernel import ROWS
from proxops.systems.shapes import Polyhedron

# Additions, multiplications, fused multiply-adds, comparisons and selections of doubles in the
# kernel's loops, without divisions and square roots.
_VERTEX = 3 + 3  # _distances: differences, squares.
_FACET = 3 + 4 + 2 + 11  # _half_angle: squares, height, product, denominator.
_FACET += 1 + 1 + 4 + 3 + 4  # _half_angle: numerator, square, polynomial, arctangent, tests.
_FACET += 3 + 5 + 4 + 1  # _sum_units.
_EDGE = 1 + 1 + 4 + 3 + 1  # _half_edge: sum, square, polynomial, logarithm, test.
_EDGE += 9  # _sum_units.
_UNIT = 5 + 5  # _sum_units: which parts are near.
_CALLS, _ROUNDS = 200, 60


@numba.njit(fastmath={"contract"}, error_model="numpy", forceinline=True)
def _eight(x, factor):
    x = (((x * factor + 0.5) * factor + 0.25) * factor + 0.75) * factor + 0.125
    return (((x * factor + 0.5) * factor + 0.25) * factor + 0.75) * factor + 0.125


@numba.njit(fastmath={"contract"}, error_model="numpy")
def _multiply_add(values, factor, repeats):
    for _ in range(repeats):
        for i in range(values.size):
            x = _eight(_eight(values[i], factor), factor)
            values[i] = _eight(_eight(x, factor), factor)


@numba.njit(error_model="numpy")
def _divide(values, factor, repeats):
    for _ in range(repeats):
        for i in range(values.size):
            values[i] = factor / values[i]


@numba.njit(error_model="numpy")
def _root(values, factor, repeats):
    for _ in range(repeats):
        for i in range(values.size):
            values[i] = math.sqrt(factor * values[i])


@numba.njit(fastmath=True, error_model="numpy")
def _read(values, factor, repeats):
    total = 0.0
    for _ in range(repeats):
        for i in range(values.size):
            total += values[i]
        values[0] += factor
    return total


@numba.njit(error_model="numpy")
def _gather(values, index, found, repeats):
    for k in range(repeats):
        for i in range(index.size):
            found[i] = values[index[i]]
        values[k % values.size] += 1.0
    return found[0]


def _least(call: Callable[[], object], rounds: int = _ROUNDS) -> float:
    """The least processor time in s of a call, of many."""
    call()
    times = []
    for _ in range(rounds):
        started = time.process_time()
        call()
        times.append(time.process_time() - started)
    return min(times)


def rates(shape: Polyhedron) -> dict[str, float]:
    """Time in s of one operation on one double, at this core's full speed, by name."""
    small = np.full(2048, 1.5)
    tables = np.ones(ROWS * (len(shape.facets) // 2))
    index = np.ascontiguousarray(shape.facets.T.astype(np.uint32)).ravel()
    values, found = np.ones(len(shape.vertices)), np.empty(index.size)
    return {
        "arithmetic": _least(lambda: _multiply_add(small, 0.5, 300)) / (2048 * 32 * 300),
        "division": _least(lambda: _divide(small, 2.0, 1000)) / (2048 * 1000),
        "square root": _least(lambda: _root(small, 1.5, 1000)) / (2048 * 1000),
        "double read from a table": _least(lambda: _read(tables, 1e-9, 40)) / (tables.size * 40),
        "distance gathered": _least(lambda: _gather(values, index, found, 100))
        / (index.size * 100),
    }


def counts(shape: Polyhedron) -> dict[str, int]:
    """Number of operations of one point, by name."""
    vertices, facets = len(shape.vertices), len(shape.facets)
    edges, units = 3 * facets // 2, facets // 2
    return {
        "arithmetic": _VERTEX * vertices + _FACET * facets + _EDGE * edges + _UNIT * units,
        "division": facets + edges,
        "square root": vertices,
        "double read from a table": ROWS * units,
        "distance gathered": 3 * facets,
    }


def main() -> None:
    argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0]).parse_args()
    field = load_body("kleopatra").exact_field
    point = np.array([[120e3, 60e3, 20e3]])
    ours = _least(lambda: [field.columns(point) for _ in range(_CALLS)]) / _CALLS
    whole = _least(lambda: [field.evaluate(point) for _ in range(_CALLS)]) / _CALLS
    none = _least(lambda: [field.columns(point[:0]) for _ in range(_CALLS)]) / _CALLS
    number, each = counts(field.shape), rates(field.shape)
    table = Table(title=f"one point, {len(field.shape.facets)} facets, one core")
    for heading in ("", "number", "each (ns)", "least time (µs)"):
        table.add_column(heading, justify="left" if not heading else "right")
    for name, count in number.items():
        cost = 1e6 * count * each[name]
        table.add_row(name, f"{count:,}", f"{1e9 * each[name]:.3f}", f"{cost:.1f}")
    least = {name: number[name] * each[name] for name in number}
    one_after_the_other = sum(least.values())
    for label, seconds in (
        ("longest of them: all else at the same time", max(least.values())),
        ("sum: nothing at the same time", one_after_the_other),
        ("the kernel", ours - none),
        ("`evaluate`, with Python around it", whole),
    ):
        table.add_row(label, "", "", f"{1e6 * seconds:.1f}")
    Console().print(table)


if __name__ == "__main__":
    main()
