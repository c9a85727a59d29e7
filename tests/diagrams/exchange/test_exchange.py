"""Logs in other formats, read by the packages of those formats."""

import base64
import functools
import json
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from oem import OrbitEphemerisMessage
from short_flights import BRIEF, on_lidar
from typer.testing import CliRunner

from proxops.cli.main import app
from proxops.diagrams.exchange import write_mcap, write_oem
from proxops.diagrams.flight import fly
from proxops.diagrams.logs import FlightLog


@functools.cache
def log() -> FlightLog:
    return fly(on_lidar(**BRIEF), "mpc")


def messages(path: Path) -> dict[str, list[tuple[float, str, dict]]]:
    """Time in s, schema and content of the messages of each topic."""
    found: dict[str, list] = {}
    with path.open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            assert schema is not None
            row = 1e-9 * message.log_time, schema.name, json.loads(message.data)
            found.setdefault(channel.topic, []).append(row)
    return found


def test_mcap_has_the_poses(tmp_path: Path) -> None:
    write_mcap(log(), tmp_path / "flight.mcap")
    data, rows = log().dataset, messages(tmp_path / "flight.mcap")["/tf"]
    assert [time for time, _, _ in rows] == pytest.approx(data["time"].values.tolist())
    poses: dict[str, dict] = {}
    for k, (time, schema, content) in enumerate(rows):
        assert schema == "foxglove.FrameTransforms"
        poses = {pose["child_frame_id"]: pose for pose in content["transforms"]}
        position = [poses["S"]["translation"][axis] for axis in "xyz"]
        assert position == data["state"].values[k, :3].tolist()
        stamp = poses["S"]["timestamp"]
        assert stamp["sec"] + 1e-9 * stamp["nsec"] == pytest.approx(time)
        # With an attitude that is exact, S has the axes of K.
        assert poses["S"]["rotation"] == {"w": 1.0, "x": 0.0, "y": 0.0, "z": 0.0}
    believed = [poses["S_believed"]["translation"][axis] for axis in "xyz"]
    assert believed == data["navigation_state"].values[-1, :3].tolist()


def test_mcap_has_the_returns_and_the_body(tmp_path: Path) -> None:
    """Points of the cloud lie on the mesh, but for the noise of 50 m along flat rays."""
    write_mcap(log(), tmp_path / "flight.mcap")
    found = messages(tmp_path / "flight.mcap")
    _, schema, cloud = found["/lidar"][2]
    assert (schema, cloud["frame_id"], cloud["point_stride"]) == ("foxglove.PointCloud", "S", 12)
    points = np.frombuffer(base64.b64decode(cloud["data"]), dtype="<f4").reshape(-1, 3)
    ranges = log().dataset["ranges"].values[2]
    assert len(points) == np.isfinite(ranges).sum() > 0
    lengths = np.linalg.norm(points, axis=1)
    np.testing.assert_allclose(np.sort(lengths), np.sort(ranges[np.isfinite(ranges)]), rtol=1e-5)
    ((_, schema, scene),) = found["/body"]
    assert schema == "foxglove.SceneUpdate"
    (mesh,) = scene["entities"][0]["triangles"]
    shape = log().body.shape
    corners = np.array([[point[axis] for axis in "xyz"] for point in mesh["points"]])
    np.testing.assert_array_equal(corners, shape.vertices)
    np.testing.assert_array_equal(np.reshape(mesh["indices"], (-1, 3)), shape.facets)
    world = log().dataset["state"].values[2, :3] + points
    away = [np.linalg.norm(corners - point, axis=1).min() for point in world]
    assert np.median(away) < 2e3  # About as long as an edge.


def test_oem_is_the_inertial_motion(tmp_path: Path) -> None:
    """Its velocity is the derivative of its position, which turns with the body."""
    write_oem(log(), tmp_path / "flight.oem", "2031-05-01T00:00:00")
    message = OrbitEphemerisMessage.open(tmp_path / "flight.oem")
    (segment,) = message.segments
    assert segment.metadata["CENTER_NAME"] == "KLEOPATRA"
    assert segment.metadata["TIME_SYSTEM"] == "TDB"
    states = list(segment)
    assert states[0].epoch.isot.startswith("2031-05-01T00:00:00.000")
    times = np.array([(state.epoch - states[0].epoch).sec for state in states])
    data = log().dataset
    np.testing.assert_allclose(times, data["time"].values, atol=1e-3)
    position = 1e3 * np.array([state.position for state in states])
    velocity = 1e3 * np.array([state.velocity for state in states])
    np.testing.assert_allclose(position[0], data["state"].values[0, :3], rtol=1e-12)
    np.testing.assert_allclose(position[-1], data["position_inertial"].values[-1], rtol=1e-12)
    # Over a step of 10 s the acceleration is nearly constant.
    steps = np.diff(times)[:, None]
    np.testing.assert_allclose(
        np.diff(position, axis=0) / steps, 0.5 * (velocity[1:] + velocity[:-1]), atol=1e-3
    )
    # At rest over the body, it goes round with it.
    spin = log().body.spin_rate
    assert np.linalg.norm(velocity[0]) == pytest.approx(spin * 160e3, rel=1e-9)


def test_both_by_the_command(tmp_path: Path) -> None:
    log().to_netcdf(tmp_path / "flight.nc")
    files = {"--mcap": tmp_path / "new" / "flight.mcap", "--oem": tmp_path / "flight.oem"}
    options = [str(part) for pair in files.items() for part in pair]
    found = CliRunner().invoke(app, ["replay", str(tmp_path / "flight.nc"), *options])
    assert found.exit_code == 0, found.output
    assert all(file.stat().st_size > 1000 for file in files.values())
