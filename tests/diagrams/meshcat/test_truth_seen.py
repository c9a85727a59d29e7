"""Where the true world differs from the believed one, scenes, pages and plots show both."""

import re
import typing
from pathlib import Path

import numpy as np
import pytest
from contact_binary import contact_binary
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import StepPatch
from meshcat_pages import points_told
from pydrake.geometry import Meshcat
from pydrake.math import RigidTransform
from scipy.spatial.transform import Rotation
from short_flights import BRIEF, kleopatra, short_scenario

from proxops.diagrams.flight.simulation import fly
from proxops.diagrams.logs.flight_log import FlightLog
from proxops.diagrams.meshcat.meshcat_scene import Scene, move_axes
from proxops.diagrams.meshcat.replay import add_flight, write_replay
from proxops.diagrams.plots import draw_body, plot_truth
from proxops.diagrams.plots.outlines import outline
from proxops.diagrams.scenario import TruthConfig, spin_axes
from proxops.diagrams.scenario.true_body import make_true_body
from proxops.systems.common.errors import InputError
from proxops.systems.rotation import TorqueFreeSpin
from proxops.systems.shapes.polyhedron import Polyhedron

UNIT = 100e3
TRUTH = {
    "truth__density_contrast": 0.1,
    "truth__size": 1.02,
    "truth__pole_deg": [3.0, -2.0],
    "truth__attitude__constant_deg": [0.3, -0.4, 0.0],
    "truth__thrusters__scale": [0.9, 1.0, 1.1],
    "truth__specific_impulse_s": 220.0,
}


@pytest.fixture(scope="module")
def log() -> FlightLog:
    """A flight in a world that differs in all that is shown."""
    return fly(short_scenario(**TRUTH, **BRIEF), "pd", body=kleopatra())


@pytest.fixture
def ax() -> Axes:
    return Figure().subplots()


def drawn(ax: Axes, number: int) -> np.ndarray:
    """The points (N, 2) of a line of the axes."""
    return np.array(ax.lines[number].get_xydata())


# --- in three dimensions --------------------------------------------------------------------------


def test_the_true_body_is_solid_and_the_map_is_a_net(log: FlightLog, meshcat: Meshcat) -> None:
    add_flight(meshcat, log)
    solid = UNIT * points_told(meshcat, "/body")
    np.testing.assert_allclose(solid, 1.02 * kleopatra().shape.vertices, atol=0.1)
    net = np.unique((UNIT * points_told(meshcat, "/map")).round(), axis=0)
    np.testing.assert_allclose(net, np.unique(kleopatra().shape.vertices.round(), axis=0), atol=1.0)


# --- on the page ----------------------------------------------------------------------------------


def written(log: FlightLog, tmp_path: Path) -> str:
    write_replay(log, tmp_path / "replay.html")
    return (tmp_path / "replay.html").read_text(encoding="utf-8")


def test_panel_lists_what_differs(log: FlightLog, tmp_path: Path) -> None:
    page = written(log, tmp_path)
    listed = re.findall(r"<tr><td>(.*?)</td><td>(.*?)</td></tr>", page)
    assert listed == [
        ("truth.density_contrast", "0.1"),
        ("truth.size", "1.02"),
        ("truth.pole_deg", "(3, -2)"),
        ("truth.attitude.constant_deg", "(0.3, -0.4, 0)"),
        ("truth.thrusters.scale", "(0.9, 1, 1.1)"),
        ("truth.specific_impulse_s", "220"),
    ]
    legend = page[page.index('id="legend"') :]
    for text in ("map, over the true body", "believed spin axis", "true spin axis"):
        assert text in legend


def test_damaged_true_mesh_is_refused_as_the_log_is_read(log: FlightLog, tmp_path: Path) -> None:
    data = log.dataset.copy(deep=True)
    data["true_vertices"][7, 1] = np.nan
    FlightLog(data, log.body).to_netcdf(tmp_path / "flight.nc")
    with pytest.raises(InputError, match=r"flight\.nc is damaged: .*vertex 7"):
        FlightLog.load(tmp_path / "flight.nc")


# --- on paper -------------------------------------------------------------------------------------


def side(p: np.ndarray, q: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Positive (N, M) for points (N, 2) on the left of the lines from p to q (M, 2)."""
    way, to = q - p, points[:, None] - p
    return way[:, 0] * to[..., 1] - way[:, 1] * to[..., 0]


@pytest.mark.parametrize("plane", [(0, 1), (0, 2), (1, 2)])
@pytest.mark.parametrize("name", ["kleopatra", "binary"])
def test_outline_parts_what_is_covered_from_what_is_not(name: str, plane: tuple[int, int]) -> None:
    """A straight way between two points crosses it an odd number of times if, and only if, the
    projections of the facets cover one of them alone."""
    shape = kleopatra().shape
    if name == "binary":
        mesh = contact_binary(1.0, 2)
        turn = Rotation.from_rotvec([0.5, 0.8, -0.3])
        shape = Polyhedron(turn.apply(mesh.vertices), np.array(mesh.faces), "binary")
    low, high = shape.vertices.min(axis=0), shape.vertices.max(axis=0)
    points = np.random.default_rng(3).uniform(low, high, (600, 3))[:, plane]
    a, b, c = shape.vertices[shape.facets][:, :, plane].transpose(1, 0, 2)
    sides = np.stack([side(*line, points) for line in ((a, b), (b, c), (c, a))])
    sign = np.sign(sides).sum(axis=0)
    covered = np.asarray((np.abs(sign) == 3.0).any(axis=-1))

    chains = outline(shape, *plane)
    begin = np.concatenate([chain[:-1] for chain in chains])
    end = np.concatenate([chain[1:] for chain in chains])
    here, there = points[::2], points[1::2]
    apart = np.sign(side(begin, end, here)) != np.sign(side(begin, end, there))
    across = np.sign(side(here, there, begin)) != np.sign(side(here, there, end))
    odd = (apart & across.T).sum(axis=1) % 2 == 1
    changes = covered[::2] != covered[1::2]
    assert 30 < changes.sum() < 270
    # Where one edge goes behind another, half a part of an edge may be missing.
    assert (odd != changes).mean() <= 0.03


def test_plot_shows_truth_and_map(log: FlightLog, ax: Axes) -> None:
    draw_body(ax, log.body, "xz", log.true_body)
    [silhouette] = [each for each in ax.collections if isinstance(each, PolyCollection)]
    corners = np.concatenate([path.vertices for path in silhouette.get_paths()])
    extents = log.body.shape.extents[[0, 2]] / 1e3
    np.testing.assert_allclose(np.ptp(corners, axis=0), 1.02 * extents)
    dashed = np.concatenate(
        [line.get_xydata() for line in ax.lines if line.get_linestyle() == "--"]
    )
    np.testing.assert_allclose(np.ptp(dashed, axis=0), extents)
    believed, true = (np.array(line.get_xydata()) for line in ax.lines[-2:])
    assert not believed[:, 0].any()
    slope = np.diff(true[:, 0]) / np.diff(true[:, 1])
    np.testing.assert_allclose(slope, log.true_body.spin.rate[0] / log.true_body.spin.rate[2])


def test_true_attitude_mass_and_thrust(log: FlightLog) -> None:
    attitude, mass, thrust = plot_truth(log).axes
    w, x, y, z = log.dataset["attitude"].values.T
    angles = Rotation.from_quat(np.stack([x, y, z, w], axis=1)).magnitude()
    np.testing.assert_allclose(drawn(attitude, 0)[:, 1], np.degrees(angles), rtol=1e-6)
    np.testing.assert_allclose(drawn(mass, 0)[:, 1], log.dataset["mass"].values)
    np.testing.assert_allclose(drawn(mass, 1)[:, 1], 100.0)
    # By the factors of the scenario.
    force = log.dataset["force"].values[:-1]
    for axis, share in enumerate((-0.1, 0.0, 0.1)):
        steps = thrust.patches[axis]
        assert isinstance(steps, StepPatch)
        np.testing.assert_allclose(steps.get_data()[0], share * force[:, axis], atol=1e-12)


def test_the_axis_of_a_tumbling_body_goes_where_it_turns_about() -> None:
    """About the true centre of mass; the axis of a steady spin stays."""
    truth = TruthConfig(tumbles=True, density_contrast=0.1)
    true_body = make_true_body(kleopatra(), truth)
    assert isinstance(true_body.spin, TorqueFreeSpin)
    moved: dict[str, RigidTransform] = {}

    class Noted:
        def SetTransform(self, path, pose, time):  # noqa: N802
            moved[path] = pose
            assert time == 2.0

    scene = Scene(typing.cast(typing.Any, Noted()), kleopatra(), true_body)
    move_axes(scene, 20e3, 2.0)
    (pose,) = moved.values()
    _, before = spin_axes(kleopatra(), true_body) or (None, None)
    assert before is not None
    after = np.array([pose @ end for end in before / scene.unit]) * scene.unit
    way, wanted = np.diff(after, axis=0)[0], true_body.spin.angular_velocity(20e3)
    np.testing.assert_allclose(way / np.linalg.norm(way), wanted / np.linalg.norm(wanted))
    np.testing.assert_allclose(after.mean(axis=0), true_body.axis_point, atol=1e-6)
