"""Writes a flight log as MCAP: poses, the body, point clouds and numbers, for Foxglove and others.

Messages are JSON in Foxglove's own schemas (https://docs.foxglove.dev/docs/sdk/schemas), so that
its panels know them. Lengths are in metres, times count from the start of the flight.
"""

from __future__ import annotations

import base64
import json
import typing
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import xarray as xr

from proxops.diagrams.logs import FlightLog
from proxops.systems.common import needed, write_whole

# Names of frames: body-fixed, the spacecraft's, and where the navigation believes it to be.
_BODY, _CRAFT, _BELIEVED = "K", "S", "S_believed"
_FLOAT32 = 7
_STILL = (1.0, 0.0, 0.0, 0.0)
# The pose of what is given in its frame as it is.
_IN_PLACE = {
    "position": {"x": 0.0, "y": 0.0, "z": 0.0},
    "orientation": {"w": 1.0, "x": 0.0, "y": 0.0, "z": 0.0},
}
# Most numbers in a message; the frames of the lidar have a topic of their own.
_MOST = 16
Message = dict[str, typing.Any]


def write_mcap(log: FlightLog, path: str | Path) -> None:
    """Writes a log as an MCAP file, whole or not at all.

    Topics: `/tf` (foxglove.FrameTransforms) has the poses of S and S_believed in K; `/body`
    (foxglove.SceneUpdate) the body's mesh; `/lidar` (foxglove.PointCloud) the returns in S, if the
    log has frames; `/flight` every other variable of the log with at most 16 numbers a
    row, by its name, with null for what is not finite.

    Args:
      log: of a flight. path: of the file.

    Raises:
      InputError: the package mcap is not installed, or the file cannot be written.
    """
    writers = needed("mcap.writer", "exchange")
    data = log.dataset
    times = np.round(1e9 * data["time"].values).astype(np.int64)
    channels = [
        ("/body", "foxglove.SceneUpdate", _body(log)),
        ("/tf", "foxglove.FrameTransforms", _poses(data)),
        ("/flight", "proxops.Flight", _numbers(data)),
    ]
    if "ranges" in data:
        channels.append(("/lidar", "foxglove.PointCloud", _clouds(log)))

    def write(file: Path) -> None:
        with file.open("wb") as stream:
            writer = writers.Writer(stream)
            writer.start(profile="", library="proxops")
            for topic, schema, messages in channels:
                number = writer.register_schema(schema, "jsonschema", b'{"type": "object"}')
                channel = writer.register_channel(topic, "json", number)
                for time, message in zip(times.tolist(), messages, strict=False):
                    text = json.dumps(message, allow_nan=False).encode()
                    writer.add_message(channel, log_time=time, publish_time=time, data=text)
            writer.finish()

    write_whole(Path(path), write)


def _body(log: FlightLog) -> Iterator[Message]:
    """The true body's mesh, once, at the start."""
    shape = log.true_body.shape
    mesh = {
        "pose": _IN_PLACE,
        "points": [_vector(vertex) for vertex in shape.vertices],
        "indices": shape.facets.ravel().tolist(),
        "color": {"r": 0.6, "g": 0.6, "b": 0.6, "a": 1.0},
        "colors": [],
    }
    entity = {
        "timestamp": _stamp(0.0),
        "frame_id": _BODY,
        "id": "body",
        "lifetime": _stamp(0.0),
        "frame_locked": True,
        "metadata": [],
        "triangles": [mesh],
    }
    yield {"deletions": [], "entities": [entity]}


def _poses(data: xr.Dataset) -> Iterator[Message]:
    """Poses of the spacecraft, and where it is believed to be, one message a row."""
    kinds = [(_CRAFT, "state", "attitude"), (_BELIEVED, "navigation_state", "navigation_attitude")]
    kinds = [(frame, data[state].values, _attitudes(data, turn)) for frame, state, turn in kinds
             if state in data]  # fmt: skip
    for row, time in enumerate(data["time"].values):
        yield {
            "transforms": [
                {
                    "timestamp": _stamp(time),
                    "parent_frame_id": _BODY,
                    "child_frame_id": frame,
                    "translation": _vector(states[row]),
                    "rotation": _quaternion(turns[row]),
                }
                for frame, states, turns in kinds
                if np.isfinite(states[row]).all() and np.isfinite(turns[row]).all()
            ]
        }


def _attitudes(data: xr.Dataset, name: str) -> np.ndarray:
    """Unit quaternions (N, 4), w first; the identity if the log has none of the name."""
    return data[name].values if name in data else np.tile(_STILL, (data.sizes["time"], 1))


def _clouds(log: FlightLog) -> Iterator[Message]:
    """The returns of each frame, in S."""
    data = log.dataset
    ranges = data["ranges"].values
    directions = log.scenario.lidar_geometry.directions.reshape(*ranges.shape[1:], 3)
    fields = [{"name": name, "offset": 4 * k, "type": _FLOAT32} for k, name in enumerate("xyz")]
    for time, frame in zip(data["time"].values, ranges, strict=True):
        hits = np.isfinite(frame)
        points = (frame[hits, None] * directions[hits]).astype("<f4")
        yield {
            "timestamp": _stamp(time),
            "frame_id": _CRAFT,
            "pose": _IN_PLACE,
            "point_stride": 12,
            "fields": fields,
            "data": base64.b64encode(points.tobytes()).decode(),
        }


def _numbers(data: xr.Dataset) -> Iterator[Message]:
    """All small variables that have a value in each row, and the error of the navigation."""
    names = [
        str(name)
        for name, values in data.data_vars.items()
        if values.dims[:1] == ("time",) and values[0].size <= _MOST and values.dtype.kind in "fiub"
    ]
    values = {name: data[name].values.astype(np.float64) for name in names}
    if "navigation_state" in data:
        off = data["navigation_state"].values[:, :3] - data["state"].values[:, :3]
        values["navigation_position_error"] = np.linalg.norm(off, axis=1)
    for row, time in enumerate(data["time"].values):
        yield {"time": float(time)} | {name: _finite(of[row]) for name, of in values.items()}


def _finite(value: np.ndarray) -> typing.Any:
    """A number or nested lists of numbers, with null for what is not finite."""
    if np.ndim(value):
        return [_finite(part) for part in value]
    return float(value) if np.isfinite(value) else None


def _stamp(time: float) -> dict[str, int]:
    nanoseconds = round(1e9 * float(time))
    return {"sec": nanoseconds // 10**9, "nsec": nanoseconds % 10**9}


def _vector(values: typing.Any) -> dict[str, float]:
    return dict(zip("xyz", (float(value) for value in values[:3]), strict=True))


def _quaternion(values: typing.Any) -> dict[str, float]:
    return dict(zip("wxyz", (float(value) for value in values), strict=True))
