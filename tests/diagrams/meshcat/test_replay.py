"""A replay is one HTML page that needs nothing else and holds the flight that is in the log."""

import re
from pathlib import Path

import numpy as np
import pytest
from meshcat_pages import known, points_told
from pydrake.geometry import Meshcat
from synthetic_log import synthetic_log

from proxops.diagrams.logs.flight_log import FlightLog
from proxops.diagrams.meshcat import replay
from proxops.diagrams.meshcat.camera_views import viewpoints
from proxops.diagrams.meshcat.meshcat_scene import (
    Scene,
    add_returns,
    quiet_meshcat,
)


@pytest.fixture(scope="module")
def log() -> FlightLog:
    return synthetic_log()


@pytest.fixture(scope="module")
def page(log: FlightLog, tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("replay") / "replay.html"
    replay.write_replay(log, path)
    return path.read_text(encoding="utf-8")


@pytest.fixture
def meshcat() -> Meshcat:
    return quiet_meshcat()


@pytest.fixture
def scene(log: FlightLog, meshcat: Meshcat) -> Scene:
    return Scene(meshcat, log.body)


def test_page_needs_no_network(page: str) -> None:
    tags = re.findall(r"<(?:script|link|img|iframe|base|meta)\b[^>]*>", page)
    assert not [tag for tag in tags if re.search(r"https?:|//", tag)]
    assert "@import" not in page
    assert not re.search(r"""src\s*=\s*["']?(https?:)?//""", page)
    assert not re.search(r"""url\(["']?(https?:)?//""", page)


def test_panel_knows_the_flight(log: FlightLog, page: str) -> None:
    told, data = known(page), log.dataset
    np.testing.assert_allclose(told["time"], data["time"])
    speed = (data["state"].values[:, 3:] ** 2).sum(axis=1) ** 0.5
    np.testing.assert_allclose(told["velocity"], speed, atol=6e-4)
    thrust = (data["force"].values[:-1] ** 2).sum(axis=1) ** 0.5
    np.testing.assert_allclose(told["thrust"], [*thrust, 0.0], atol=6e-4)
    assert told["range"][-1] == 0.0
    # The synthetic path keeps outside, by what the figures of merit say it does.
    assert min(told["clearance"]) == pytest.approx(log.summary["min_clearance_m"], abs=50.0)
    decisions = data["decision"].values
    assert told["who"] == [*decisions[:-1], decisions[-2]]


def test_views_fit_body_and_path(log: FlightLog) -> None:
    """Everything lies within the picture's height, of 40 degrees, whatever the view."""
    positions = log.dataset["state"].values[:, :3]
    everything = np.vstack([positions, log.body.shape.vertices])
    for view in viewpoints(log.body, positions).values():
        ahead = (view.target - view.eye) / np.linalg.norm(view.target - view.eye)
        depth = (everything - view.eye) @ ahead
        right = np.cross(ahead, [0.0, 0.0, 1.0])
        up = np.cross(right / np.linalg.norm(right), ahead)
        tangent = np.abs((everything - view.eye) @ up) / depth
        assert depth.min() > 0.0
        assert tangent.max() < np.tan(np.radians(20.0))


def test_names_in_the_log_are_text_not_markup(tmp_path: Path) -> None:
    log = synthetic_log(3, ranges=False)
    attrs = {**log.dataset.attrs, "controller": "<script>alert(1)</script>"}
    replay.write_replay(
        FlightLog(log.dataset.assign_attrs(attrs), log.body), tmp_path / "replay.html"
    )
    page = (tmp_path / "replay.html").read_text(encoding="utf-8")
    assert "<script>alert(1)" not in page
    assert "&lt;script&gt;alert(1)" in page


def test_tube_lies_about_its_points() -> None:
    turn = np.linspace(0.0, 2.0, 30)
    points = np.stack([np.cos(turn), np.sin(turn), 0.3 * turn], axis=1)
    vertices, facets = replay.tube(points)
    near = np.linalg.norm(vertices[:, None] - points, axis=2).min(axis=1)
    np.testing.assert_allclose(near, replay._PATH_RADIUS, rtol=1e-6)
    assert facets.max() == len(vertices) - 1


def test_returns_lie_on_the_body(log: FlightLog, scene: Scene) -> None:
    row = 100
    frame = log.dataset["ranges"].values[row]
    add_returns(scene, "/returns", log.dataset["state"].values[row, :3], frame)
    points = points_told(scene.meshcat, "/returns") * 100e3
    assert len(points) == np.isfinite(frame).sum() > 0
    depth = np.einsum(
        "pfi,fi->pf",
        points[:, None] - log.body.shape.vertices[log.body.shape.facets[:, 0]],
        log.body.shape.normals,
    )
    assert np.abs(depth).min(axis=1).max() < 1.0  # each in the plane of some facet
