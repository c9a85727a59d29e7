"""Compares polyhedral gravity and its table with ESA's polyhedral-gravity and with Basilisk.

All evaluate the same mesh (Kleopatra, 4,000 facets) at the same points in one process; times are
medians of many calls, ours and the peers' in turn. Both peers come with the extra `bench`:

    python benchmarks/gravity.py
"""

import argparse
import os

os.environ.setdefault("OMP_NUM_THREADS", "2")

import statistics
import time
import tracemalloc
from collections.abc import Callable

import numpy as np
import trimesh
from _kept import keep
from _peers import basilisk_model, esa_model
from _tables import Shown

from proxops.diagrams.scenario import load_body
from proxops.systems import GravityField, Polyhedron, TabulatedField
from proxops.systems.common import one_thread, threads_to_use


def medians(calls: dict[str, Callable], rounds: int) -> dict[str, float]:
    """Median time in s of each call, in turns of ten calls each, the first of which is not counted.

    A call that comes after another package's finds its tables out of the processor's cache.
    """
    times: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(rounds):
        for name, call in calls.items():
            call()
            for _ in range(9):
                started = time.perf_counter()
                call()
                times[name].append(time.perf_counter() - started)
    return {name: statistics.median(values) for name, values in times.items()}


def difference(ours: np.ndarray, theirs: np.ndarray) -> float:
    """Greatest relative difference of vectors (N, 3)."""
    apart = np.linalg.norm(ours - theirs, axis=1)
    return float((apart / np.linalg.norm(theirs, axis=1)).max())


def one_point(field: GravityField, name: str, table_axes: np.ndarray | None = None) -> None:
    peer, basilisk = esa_model(field), basilisk_model(field)
    random = np.random.default_rng(1)
    directions = random.normal(size=(100, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    points = directions * random.uniform(1.3, 3.0, (100, 1)) * field.shape.extents.max() / 2
    ours = field.evaluate(points).acceleration
    theirs = np.array([peer(point, False)[1] for point in points])
    column = [point.reshape(3, 1).tolist() for point in points]
    others = np.array([basilisk.computeField(point) for point in column]).reshape(-1, 3)
    point = points[:1]
    calls: dict[str, Callable] = {
        "ours": lambda: field.evaluate(point),
        "esa": lambda: peer(point[0], False),
        "basilisk": lambda: basilisk.computeField(column[0]),
    }
    rows = [
        ("polyhedral-gravity: all three", "esa", theirs),
        ("Basilisk: acceleration", "basilisk", others),
    ]
    if table_axes is not None:
        tabulated = TabulatedField(field, table_axes)
        calls["table"] = lambda: tabulated.evaluate(point)
        rows.insert(0, ("our table: all three", "table", tabulated.evaluate(points).acceleration))
    found = medians(calls, rounds=50)
    lines = {"ours: all three": [f"{1e6 * found['ours']:.1f}", "1", ""]}
    for label, key, values in rows:
        ratio = found[key] / found["ours"]
        agreement = f"{difference(ours, values):.1e}"
        lines[label] = [f"{1e6 * found[key]:.1f}", f"{ratio:.3g} x", agreement]
    title = f"{name}, {len(field.shape.facets)} facets, one point, one thread"
    Shown(title, ("time (µs)", "over ours", "difference, at most"), lines).show()
    if table_axes is not None:
        keep(
            {
                "gravity of 4,000 facets at a point, with gradient (µs)": 1e6 * found["ours"],
                "the same from the table (µs)": 1e6 * found["table"],
                "gravity: polyhedral-gravity over ours": found["esa"] / found["ours"],
                "gravity: Basilisk, acceleration alone, over ours": found["basilisk"]
                / found["ours"],
            }
        )


def batches(field: GravityField, semi_axes: np.ndarray) -> None:
    random = np.random.default_rng(2)
    points = random.uniform(-170e3, 170e3, (20_000, 3))
    outside = points[np.linalg.norm(points / semi_axes, axis=1) > 1.0]
    tabulated = TabulatedField(field, semi_axes)
    looked_up = medians({"table": lambda: tabulated.evaluate(outside)}, rounds=1)["table"]
    times = {}
    most = threads_to_use()
    peer = esa_model(field)
    times[most] = medians({"ours": lambda: field.evaluate(points)}, rounds=1)["ours"]
    with one_thread():
        times[1] = medians({"ours": lambda: field.evaluate(points)}, rounds=1)["ours"]
    few = points[:500]
    other = medians({"esa": lambda: peer(few, True)}, rounds=1)["esa"] / len(few)
    lines = {
        str(threads): [f"{1e6 * seconds / len(points):.1f}", f"{times[1] / seconds:.2f} x"]
        for threads, seconds in times.items()
    }
    lines["1: our table, outside"] = [f"{1e6 * looked_up / len(outside):.2f}", ""]
    lines[f"{most}: polyhedral-gravity"] = [f"{1e6 * other:.1f}", ""]
    title = f"{len(points)} points in the cube, a point, by threads"
    Shown(title, ("time (µs)", "better than one thread"), lines).show()
    keep(
        {
            "gravity of one in a batch, with gradient (µs)": 1e6 * times[1] / len(points),
            "the same from the table, outside (µs)": 1e6 * looked_up / len(outside),
        }
    )
    tracemalloc.start()
    field.evaluate(points)
    peak = tracemalloc.get_traced_memory()[1]
    print(f"memory of a batch: {peak / len(points):.0f} bytes a point at the peak")


def main() -> None:
    argparse.ArgumentParser(description=__doc__.splitlines()[0]).parse_args()
    body = load_body("kleopatra")
    one_point(body.exact_field, "Kleopatra", body.keep_out_semi_axes)
    # Convex, so that Basilisk's mass, a sum of absolute volumes, is right.
    ball = trimesh.creation.icosphere(subdivisions=4)
    convex = Polyhedron(ball.vertices * [1e5, 6e4, 5e4], ball.faces, "ellipsoid")
    one_point(GravityField(convex, density=3000.0), "An ellipsoid")
    batches(body.exact_field, body.keep_out_semi_axes)


if __name__ == "__main__":
    main()
