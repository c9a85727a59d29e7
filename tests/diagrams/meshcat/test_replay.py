"""A replay is one HTML page that needs nothing else and holds the flight that is in the log."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest
from meshcat_pages import known, points_told
from pydrake.geometry import Meshcat
from synthetic_log import synthetic_log

from proxops.diagrams.logs.flight_log import FlightLog
from proxops.diagrams.logs.legend import REASONS
from proxops.diagrams.meshcat import replay
from proxops.diagrams.meshcat.camera_views import viewpoints
from proxops.diagrams.meshcat.meshcat_scene import (
    Scene,
    add_returns,
    quiet_meshcat,
)
from proxops.diagrams.scenario import AssuranceConfig, dump_scenario
from proxops.systems.assurance import AssuranceBounds, InterventionReason


@pytest.fixture(scope="module")
def log() -> FlightLog:
    return synthetic_log()


@pytest.fixture(scope="module")
def page(log: FlightLog, tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("replay") / "replay.html"
    replay.write_replay(log, path)
    return path.read_text(encoding="utf-8")


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


def test_filter_tells_margin_reason_and_bounds(log: FlightLog, tmp_path: Path) -> None:
    count = len(log.dataset["time"])
    margins = np.linspace(3e3, 1e3, count)
    margins[100:140], margins[:5], margins[200:210] = -50.0, np.nan, -np.inf
    reasons = np.zeros(count)
    reasons[100:140] = InterventionReason.KEEP_OUT
    reasons[200:210] = InterventionReason.BACKUP
    columns = {
        "intervention": np.where(reasons > 0.0, 1.0, 0.0),
        "intervention_reason": reasons,
        "assurance_margin": margins,
    }
    config = AssuranceConfig(bounds=AssuranceBounds(thrust=0.05, acceleration_m_s2=3e-3))
    scenario = dump_scenario(dataclasses.replace(log.scenario, assurance=config))
    dataset = log.dataset.assign({name: ("time", values) for name, values in columns.items()})
    filtered = FlightLog(dataset.assign_attrs(scenario=scenario), log.body)
    replay.write_replay(filtered, tmp_path / "replay.html")
    page = (tmp_path / "replay.html").read_text(encoding="utf-8")
    told = known(page)["assurance"]
    words = [told["reasons"][str(reason)][0] for reason in told["reason"]]
    assert words[99:101] == ["passes", REASONS[InterventionReason.KEEP_OUT].name]
    assert told["margin"][0] is None
    assert told["margin"][200] == "-inf"
    assert "allows for: thrust 0.05, acceleration 0.003 m/s^2, 4σ of the navigation<" in page
    # The curve is above the line of zero where the margin is positive, and below elsewhere.
    (zero,) = re.findall(r'd="M0 ([\d.]+)H1000"', page)
    (points,) = re.findall(r'polyline points="([^"]*)"', page)
    heights = np.array([float(point.split(",")[1]) for point in points.split()])
    assert len(heights) == count - 5
    np.testing.assert_array_equal(heights < float(zero), margins[5:] > 0.0)
    spans = re.findall(r'<rect x="([\d.]+)" width="([\d.]+)"', page)
    expected = 1e3 / (count - 1) * np.array([[100.0, 40.0], [200.0, 10.0]])
    np.testing.assert_allclose(np.array(spans, dtype=float), expected, atol=0.06)


def test_views_fit_body_and_path(log: FlightLog) -> None:
    """Everything lies within the picture's height, of 40 degrees, whatever the view."""
    positions = log.dataset["state"].values[:, :3]
    everything = np.vstack([positions, log.body.shape.vertices])
    for view in viewpoints(Scene(quiet_meshcat(), log.body), positions).values():
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
    rays = log.scenario.lidar_geometry.directions
    add_returns(scene, "/returns", log.dataset["state"].values[row, :3], frame, rays)
    points = points_told(scene.meshcat, "/returns") * 100e3
    assert len(points) == np.isfinite(frame).sum() > 0
    depth = np.einsum(
        "pfi,fi->pf",
        points[:, None] - log.body.shape.vertices[log.body.shape.facets[:, 0]],
        log.body.shape.normals,
    )
    assert np.abs(depth).min(axis=1).max() < 1.0  # each in the plane of some facet
