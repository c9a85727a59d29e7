"""A replay is one HTML page that needs nothing else and holds the flight that is in the log."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest
from contact_binary import contact_binary
from meshcat_pages import known, points_told
from pydrake.geometry import Meshcat
from synthetic_log import synthetic_log

from proxops.diagrams.logs.flight_log import FlightLog
from proxops.diagrams.logs.legend import REASONS
from proxops.diagrams.meshcat import replay
from proxops.diagrams.meshcat.camera_views import viewpoints
from proxops.diagrams.meshcat.meshcat_scene import (
    Scene,
    add_body,
    add_keep_out,
    add_returns,
    quiet_meshcat,
)
from proxops.diagrams.scenario import AssuranceConfig, dump_scenario
from proxops.diagrams.scenario.body import Body, BodyConfig
from proxops.systems.assurance import AssuranceBounds, InterventionReason
from proxops.systems.shapes.polyhedron import Polyhedron


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


def body_of_extent(extent: float) -> Body:
    """A contact binary, its keep-out ellipsoid half its size again."""
    mesh = contact_binary(extent, 2)
    shape = Polyhedron(np.array(mesh.vertices), np.array(mesh.faces), "binary")
    axes = [float(0.75 * extent)] * 3
    config = BodyConfig(
        name="binary", mass_kg=1e3 * shape.volume, rotation_period_h=9.0, keep_out_semi_axes_m=axes
    )
    return Body(config, shape.recentred())


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


def test_strip_shows_each_stretch(page: str) -> None:
    """200 s by the MPC, 400 s by the policy, of 4800 s, and so on."""
    (strip,) = re.findall(r"linear-gradient\(to right, ([^)]*)\)", page)
    pieces = [piece.split() for piece in strip.split(", ")]
    assert len(pieces) == 16
    assert [colour for colour, _, _ in pieces] == 8 * [pieces[0][0], pieces[1][0]]
    ends = [float(end.rstrip("%")) for _, _, end in pieces]
    np.testing.assert_allclose(
        ends, sorted([*range(0, 48, 6), *range(2, 50, 6), 48])[1:] / np.array(0.48), atol=0.01
    )


def test_filter_has_a_colour_of_its_own(log: FlightLog, tmp_path: Path) -> None:
    """The page marks where runtime assurance changed the command by more than 0.001 N."""
    changes = np.zeros(len(log.dataset["time"]))
    changes[100:140], changes[200:240] = 0.5, 0.0005
    filtered = FlightLog(log.dataset.assign(intervention=("time", changes)), log.body)
    replay.write_replay(filtered, tmp_path / "replay.html")
    page = (tmp_path / "replay.html").read_text(encoding="utf-8")
    told = known(page)
    names = [told["names"][str(who)][0] for who in told["who"]]
    assert set(names[100:140]) == {"safety filter"}
    assert "safety filter" not in names[:100] + names[140:]
    assert len({colour for _, colour in told["names"].values()}) == 3
    assert "flown by safety filter" in page


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


COLOURS = [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]


def test_each_change_of_colour_begins_a_piece(scene: Scene) -> None:
    positions = np.arange(2000)[:, None] * [300.0, 200.0, 0.0] + [0.0, 0.0, 1e5]
    decisions = (np.arange(2000) // 77) % 3
    colours = [COLOURS[code] for code in decisions.tolist()]
    ends = {row for _, row in replay.add_path(scene, positions, colours)}
    assert ends >= set(np.flatnonzero(np.diff(decisions)) + 1)
    assert max(ends) == 1999
    assert len(ends) <= replay.PATH_PIECES + 2000 // 77 + 1


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


@pytest.mark.parametrize(
    ("extent", "unit"),
    [(218.9e3, 100e3), (500.0, 200.0), (1.0, 0.5)],
)
def test_unit_follows_from_the_body(meshcat: Meshcat, extent: float, unit: float) -> None:
    scene = Scene(meshcat, body_of_extent(extent))
    assert scene.unit == unit
    add_body(scene)
    add_keep_out(scene)
    vertices = points_told(meshcat, "/body")
    np.testing.assert_allclose(np.ptp(vertices[:, 0]), extent / unit, rtol=1e-5)
    keep_out = points_told(meshcat, "/keep_out/surface")
    np.testing.assert_allclose(np.abs(keep_out).max(), 0.75 * extent / unit, rtol=1e-5)


def test_a_second_flight_replaces_the_first(meshcat: Meshcat) -> None:
    replay.add_flight(meshcat, synthetic_log(100, ranges=False))
    replay.add_flight(meshcat, synthetic_log(3, ranges=False))
    assert meshcat.HasPath("/path/piece_000")
    assert not meshcat.HasPath("/path/piece_050")


@pytest.mark.parametrize("steps", [0, 1, 2])
def test_flights_that_end_at_once(tmp_path: Path, steps: int) -> None:
    replay.write_replay(synthetic_log(steps), tmp_path / "replay.html")
    assert (tmp_path / "replay.html").stat().st_size > 2e6
