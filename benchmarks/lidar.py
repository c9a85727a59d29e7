"""Compares lidar frames with trimesh's Embree on the same rays, in one process, on one core.

The mesh is Kleopatra's, with 4,320 rays a frame and positions in the 340 km cube outside the
keep-out ellipsoid; times are medians, ours and the peer's in turn. Frames of turned rays and of
beams with a width are compared with plain ones in the same way. Embree comes with the extra
`bench`:

    python benchmarks/lidar.py [--poses 300]
"""

import argparse
import os
import statistics
import time
import tracemalloc
from collections.abc import Callable, Iterable

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[name] = "1"

import numpy as np
from _kept import keep
from _tables import Shown
from trimesh.ray.ray_pyembree import RayMeshIntersector

from proxops.diagrams.scenario import Body, load_body
from proxops.systems import Lidar, LidarErrors, ray_directions
from proxops.systems.common import rotation_matrix
from proxops.systems.shapes import RayCaster, ray_caster

KEEP_OUT_MARGIN = 8e3
WIDTHS = (0.0, 1e-3, 5e-3)


def poses_outside(body: Body, count: int) -> np.ndarray:
    """Positions (count, 3) in m in K, as transits start from."""
    poses = np.random.default_rng(3).uniform(-170e3, 170e3, (4 * count, 3))
    axes = body.keep_out_semi_axes + KEEP_OUT_MARGIN
    return poses[np.linalg.norm(poses / axes, axis=1) > 1.0][:count]


def medians(calls: dict[str, Callable], arguments: Iterable[tuple]) -> dict[str, float]:
    """Median time in s of each call over the arguments, in turn."""
    times: dict[str, list[float]] = {name: [] for name in calls}
    for given in arguments:
        for name, call in calls.items():
            started = time.perf_counter()
            call(*given)
            times[name].append(time.perf_counter() - started)
    return {name: statistics.median(values) for name, values in times.items()}


def single_frames(body: Body, poses: np.ndarray) -> None:
    """One frame at a time: each call at every pose, in turn; medians over the poses."""
    directions = ray_directions()
    mesh = body.shape.to_trimesh()
    peer, caster = RayMeshIntersector(mesh), ray_caster(body.shape)
    fan = caster.fan(directions)
    lidar = Lidar(body.shape)
    context = lidar.CreateDefaultContext()
    port = lidar.GetInputPort("position")
    output = lidar.GetOutputPort("ranges")

    def through_port(pose: np.ndarray) -> None:
        port.FixValue(context, pose)
        output.Eval(context)

    def locations(pose: np.ndarray) -> np.ndarray:
        origins = np.broadcast_to(pose, directions.shape)
        points, rays, _ = peer.intersects_location(origins, directions, multiple_hits=False)
        ranges = np.full(len(directions), np.inf)
        ranges[rays] = np.linalg.norm(points - pose, axis=1)
        return ranges

    def first(pose: np.ndarray) -> None:
        peer.intersects_first(np.broadcast_to(pose, directions.shape), directions)

    calls: dict[str, Callable] = {
        "ours: RayFan.frames, ranges": lambda pose: fan.frames(pose[None]),
        "ours: Lidar's port, with noise": through_port,
        "ours: RayCaster.distances, any rays": lambda pose: caster.distances(
            np.broadcast_to(pose, directions.shape), directions
        ),
        "trimesh: intersects_location, ranges": locations,
        "trimesh: intersects_first, facets only": first,
    }
    found, apart = medians(calls, zip(poses)), 0.0
    for pose in poses:
        theirs, ours = locations(pose), fan.frames(pose[None])[0]
        both = np.isfinite(theirs) & np.isfinite(ours)
        apart = max(apart, float(np.abs(theirs[both] - ours[both]).max(initial=0.0)))
    best = found["ours: RayFan.frames, ranges"]
    lines = {
        name: [f"{1e3 * time:.3f}", f"{len(directions) / time / 1e6:.1f}", f"{time / best:.1f} x"]
        for name, time in found.items()
    }
    title = f"one frame of {len(directions)} rays, median of {len(poses)} poses"
    Shown(title, ("time (ms)", "M rays/s", "over RayFan"), lines).show()
    print(f"ranges differ from trimesh's by at most {apart:.3f} m")
    theirs = found["trimesh: intersects_location, ranges"]
    port = found["ours: Lidar's port, with noise"]
    keep(
        {
            "a lidar frame of 4,320 rays (ms)": 1e3 * best,
            "the same through the port, with noise (ms)": 1e3 * port,
            "a lidar frame: trimesh's Embree over ours": theirs / best,
        }
    )


def turned_and_wide(body: Body) -> None:
    """Frames with an attitude and with beams against plain ones, in turn, at 200 poses."""
    random = np.random.default_rng(4)
    poses = random.normal(size=(200, 3))
    poses *= random.uniform(100e3, 200e3, (200, 1)) / np.linalg.norm(poses, axis=1, keepdims=True)
    attitude = np.array([[0.99, 0.1, -0.05, 0.02]])
    lidars = {width: Lidar(body.shape, LidarErrors(50.0, beam_width=width)) for width in WIDTHS}
    fan, now = ray_caster(body.shape).fan(ray_directions()), np.zeros(1)
    rotation = rotation_matrix(attitude[0])
    calls: dict[str, Callable] = {
        "RayFan.hits": lambda pose: fan.hits(pose, rotation),
        "Lidar.frames": lambda pose: lidars[0.0].frames(now, pose, 0),
        "Lidar.frames, with an attitude": lambda pose: lidars[0.0].frames(now, pose, 0, attitude),
        "Lidar.frames, beams of 1 mrad": lambda pose: lidars[1e-3].frames(now, pose, 0),
        "Lidar.frames, beams of 5 mrad": lambda pose: lidars[5e-3].frames(now, pose, 0),
    }
    medians(calls, [(poses[:1],)])  # Compiles.
    found = medians(calls, 5 * [(pose[None],) for pose in poses])
    lines = {
        name: [f"{1e3 * time:.3f}", f"{time / found[name.split(',')[0]]:.2f} x"]
        for name, time in found.items()
    }
    title = f"one frame, median over {len(poses)} poses 100 to 200 km out"
    Shown(title, ("time (ms)", "over plain"), lines).show()


def batches(body: Body, poses: np.ndarray) -> None:
    """All poses at once; the peer gets every ray's origin and direction, as it needs them."""
    directions = ray_directions()
    fan = RayCaster(body.shape).fan(directions)
    peer = RayMeshIntersector(body.shape.to_trimesh())
    few = poses[:50]
    origins = np.repeat(few, len(directions), axis=0)
    rays = np.tile(directions, (len(few), 1))
    lidar, times = Lidar(body.shape), 10.0 * np.arange(len(poses))
    calls: dict[str, Callable] = {
        "ours: RayFan.frames": lambda: fan.frames(poses),
        "ours: Lidar.frames, with noise": lambda: lidar.frames(times, poses, 0),
        "trimesh: intersects_location": lambda: peer.intersects_location(
            origins, rays, multiple_hits=False
        ),
        "trimesh: intersects_first": lambda: peer.intersects_first(origins, rays),
    }
    frame = {
        name: time / len(few if name.startswith("trimesh") else poses)
        for name, time in medians(calls, 5 * [()]).items()
    }
    best = frame["ours: RayFan.frames"]
    lines = {
        name: [f"{1e-6 * len(directions) / time:.1f}", f"{time / best:.1f} x"]
        for name, time in frame.items()
    }
    title = f"batches: {len(poses)} poses (trimesh: {len(few)}), one core"
    Shown(title, ("M rays/s", "over ours"), lines).show()
    tracemalloc.start()
    frames = fan.frames(poses)
    beside = tracemalloc.get_traced_memory()[1] - frames.nbytes
    print(f"memory beside the frames at the peak: {beside / 2**20:.1f} MiB")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--poses", type=int, default=300)
    body = load_body("kleopatra")
    poses = poses_outside(body, parser.parse_args().poses)
    single_frames(body, poses)
    turned_and_wide(body)
    batches(body, poses)


if __name__ == "__main__":
    main()
