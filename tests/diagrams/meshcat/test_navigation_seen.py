"""A replay shows where the navigation believes to be, how sure it is, and what it does."""

from pathlib import Path

import numpy as np
import pytest
from known_navigation import ACQUIRING, AXES, DEVIATIONS, ERROR, LOST, navigated_log
from meshcat_pages import known, messages
from pydrake.geometry import Meshcat
from scipy.spatial.transform import Rotation
from synthetic_log import synthetic_log

from proxops.diagrams.logs import FlightLog
from proxops.diagrams.meshcat import meshcat_scene
from proxops.diagrams.meshcat.meshcat_scene import Scene, quiet_meshcat
from proxops.diagrams.meshcat.navigation_scene import (
    add_navigation,
    exaggeration,
    move_navigation,
    navigation_region,
)
from proxops.diagrams.meshcat.replay import add_flight, write_replay
from proxops.systems.navigation import ReturnUse

UNIT = 100e3


@pytest.fixture(scope="module")
def log() -> FlightLog:
    return navigated_log()


@pytest.fixture
def meshcat() -> Meshcat:
    return quiet_meshcat()


def test_region_is_three_deviations_of_the_covariance(log: FlightLog) -> None:
    region = navigation_region(log.dataset)
    np.testing.assert_array_equal(np.flatnonzero(~region.known), np.arange(ACQUIRING.stop))
    np.testing.assert_allclose(region.errors[50], -ERROR[:3], rtol=1e-5)
    np.testing.assert_allclose(np.sort(region.semi_axes[50]), 3.0 * DEVIATIONS)
    squares = region.axes[50] @ np.diag(region.semi_axes[50] ** 2) @ region.axes[50].T
    np.testing.assert_allclose(
        squares, 9.0 * AXES @ np.diag(DEVIATIONS**2) @ AXES.T, rtol=1e-6, atol=1e-6
    )
    np.testing.assert_allclose(np.linalg.det(region.axes), 1.0)


def test_axes_do_not_spin(log: FlightLog) -> None:
    """Although the order of the deviations changes, and eigenvectors have no sign."""
    count = log.dataset.sizes["time"]
    covariances = log.dataset["navigation_covariance"].values.copy()
    for row in range(count):
        turn = Rotation.from_rotvec([0.0, 0.03 * row, 0.01 * row]).as_matrix()
        deviations = np.array([21.0 + 2.0 * row, 50.0, 100.0])
        covariances[row, :3, :3] = turn @ np.diag(deviations**2) @ turn.T
    columns = log.dataset["navigation_covariance"].copy(data=covariances)
    region = navigation_region(log.dataset.assign(navigation_covariance=columns))
    axes = Rotation.from_matrix(region.axes[ACQUIRING.stop :])
    steps = (axes[1:] * axes[:-1].inv()).magnitude()
    assert np.median(steps) == pytest.approx(np.hypot(0.03, 0.01), rel=0.05)
    assert steps.max() < 0.1


@pytest.mark.parametrize(("size", "times"), [(1.0, 40.0), (1e-2, 4e3), (1e3, 1.0), (0.0, 1e5)])
def test_exaggeration_is_a_round_number(log: FlightLog, size: float, times: float) -> None:
    """300 m are to be 0.12 of the unit of 100 km."""
    region = navigation_region(log.dataset)
    assert exaggeration(region._replace(semi_axes=size * region.semi_axes), UNIT) == times
    nowhere = region._replace(semi_axes=np.full_like(region.semi_axes, np.nan))
    assert exaggeration(nowhere, UNIT) == 1e5


def test_spacecraft_inside_the_region_is_drawn_inside(log: FlightLog, meshcat: Meshcat) -> None:
    """Also where the ellipsoid is drawn smaller, and it has the right place and size."""
    region, position = navigation_region(log.dataset), np.array([160e3, 20e3, -30e3])
    scene = Scene(meshcat, log.body)
    add_navigation(scene)
    inside = np.sum((region.axes[50].T @ region.errors[50] / region.semi_axes[50]) ** 2)
    for times in (10.0, 1e4):
        move_navigation(scene, position, region, 50, times)
        place = pose(meshcat, "/navigation/region")
        packed = meshcat._GetPackedProperty("/navigation/region/ball", "scale")
        drawn = doubles(packed, b"value", 3)
        away = (position / UNIT - place[:3, 3]) @ place[:3, :3]
        factor = min(1.0, 0.4 / (region.semi_axes[50].max() * times / UNIT))
        np.testing.assert_allclose(drawn, factor * times * region.semi_axes[50] / UNIT)
        assert np.sum((away / drawn) ** 2) == pytest.approx(inside, rel=1e-4)


def doubles(packed: bytes, name: bytes, count: int) -> np.ndarray:
    """The numbers of an array in MessagePack: each is float64 after a byte of its own."""
    at = packed.index(b"\xcb", packed.index(name))
    return np.array(
        [np.frombuffer(packed[k + 1 : k + 9], ">f8")[0] for k in at + 9 * np.arange(count)]
    )


def pose(meshcat: Meshcat, name: str) -> np.ndarray:
    """The transform (4, 4) of a path."""
    return doubles(meshcat._GetPackedTransform(name), b"matrix", 16).reshape(4, 4).T


def test_recording_moves_marker_and_region(log: FlightLog, meshcat: Meshcat) -> None:
    add_flight(meshcat, log)
    for name in ("region/ball", "marker/bar_0"):
        assert meshcat.HasPath(f"/navigation/{name}")
    [animation] = [told for told in messages(meshcat.StaticHtml()) if b"set_animation" in told]
    for path in (b"/navigation/region", b"/navigation/marker", b"/navigation/region/ball"):
        assert path in animation
    add_flight(meshcat, synthetic_log(3, ranges=False))
    assert not meshcat.HasPath("/navigation")


def test_panel_tells_of_the_navigation(log: FlightLog, tmp_path: Path) -> None:
    write_replay(log, tmp_path / "replay.html")
    page = (tmp_path / "replay.html").read_text(encoding="utf-8")
    told = known(page)["navigation"]
    after = slice(ACQUIRING.stop, None)
    for name in ("error", "region"):
        assert told[name][ACQUIRING] == [None] * ACQUIRING.stop
    np.testing.assert_allclose(told["error"][after], 130.0, atol=0.01)
    np.testing.assert_allclose(told["region"][after], 300.0, atol=0.01)
    names = [told["phases"][phase] for phase in told["phase"]]
    assert set(names[LOST]) == {"lost"}
    assert names[0] == "acquiring"
    assert names[-1] == "following"
    assert "errors × 40<" in page
    assert 'id="error"' in page


def judged_log() -> FlightLog:
    """A flight's returns: all used, but in odd rows ten are rejected, and one is not used."""
    log = synthetic_log(20)
    use = np.where(np.isfinite(log.dataset["ranges"].values), ReturnUse.USED, ReturnUse.NOT_USED)
    for row in range(1, len(use), 2):
        rays = np.flatnonzero(use[row] == ReturnUse.USED)
        use[row].reshape(-1)[rays[:10]] = ReturnUse.REJECTED
        use[row].reshape(-1)[rays[-1]] = ReturnUse.NOT_USED
    columns = navigated_log(20).dataset.drop_dims(["vertex", "facet"])
    columns = columns[[name for name in columns if str(name).startswith("navigation_")]]
    use_column = (("time", "plane", "ray"), use.astype(np.int8))
    return FlightLog(log.dataset.merge(columns).assign(navigation_return_use=use_column), log.body)


def clouds(meshcat: Meshcat, monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, int]]:
    """The names of the points that a replay adds, and how many there are."""
    added = []

    def noted(scene, name, places, colour, size) -> None:
        added.append((name, len(places)))
        add_points(scene, name, places, colour, size)

    add_points = meshcat_scene._add_points
    monkeypatch.setattr(meshcat_scene, "_add_points", noted)
    add_flight(meshcat, judged_log())
    return added


def test_returns_are_shown_by_their_use(
    meshcat: Meshcat, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    added = dict(clouds(meshcat, monkeypatch))
    returns = np.isfinite(judged_log().dataset["ranges"].values).sum(axis=(1, 2))
    for row, odd in ((4, False), (5, True)):
        counts = [added[f"/lidar/row_{row:04d}/{use.name.lower()}"] for use in ReturnUse]
        used = returns[row] - 11 * odd
        assert counts == [odd, used, 10 * odd]
        assert meshcat.HasPath(f"/lidar/row_{row:04d}/used")
    write_replay(judged_log(), tmp_path / "replay.html")
    page = (tmp_path / "replay.html").read_text(encoding="utf-8")
    for text in ("lidar returns that it used", "rejected", "left alone"):
        assert f"</i> {text}<" in page
