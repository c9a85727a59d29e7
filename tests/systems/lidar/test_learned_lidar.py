"""The learned lidar with a network known in closed form: against the ray-caster, and refusals."""

import hashlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ball_lidar import (
    CENTRE,
    ELLIPSOID,
    RADIUS,
    BallNetwork,
    ball_facts,
    ball_shape,
    chord_ends,
    export_ball_bundle,
    write_ball_frame_bundle,
)
from exported_once import change_json, copied
from one_system import evaluated

from proxops.systems import InputError, LearnedLidar, Lidar, LidarErrors, LidarGeometry
from proxops.systems.lidar.lidar_bundle import LidarBundle
from proxops.training.lidar import bundle as bundles
from proxops.training.lidar.bundle import write_bundle

PLACES = np.array([[150e3, 20e3, 10e3], [-90e3, 90e3, -80e3], [0.0, 0.0, 60e3]])


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return export_ball_bundle(tmp_path_factory.mktemp("ball") / "bundle")


def frame(lidar, place, time: float = 0.0) -> np.ndarray:
    return evaluated(lidar, "ranges", time, position=place)


# --- what it reads --------------------------------------------------------------------------------


@pytest.mark.parametrize("place", PLACES)
def test_true_ranges_of_a_ball(bundle: Path, place: np.ndarray):
    lidar = LearnedLidar(bundle, LidarErrors())
    offset = place - CENTRE
    along = lidar.directions @ offset
    room = along**2 - (offset @ offset - RADIUS**2)
    wanted = np.where((room > 0) & (along < 0), -along - np.sqrt(np.maximum(room, 0)), np.inf)
    got = frame(lidar, place)
    clear = np.abs(room) > (0.01 * RADIUS) ** 2  # Not on the very edge, in single precision.
    assert np.isfinite(wanted[clear]).sum() > 20
    assert np.array_equal(np.isfinite(got[clear]), np.isfinite(wanted[clear]))
    seen = clear & np.isfinite(wanted)
    assert got[seen] == pytest.approx(wanted[seen], abs=10.0)


def test_stands_for_the_ray_cast_lidar_with_its_noise(bundle: Path):
    """The same noise on the same rays, since both see as many returns here."""
    real, learned = Lidar(ball_shape(), seed=5), LearnedLidar(bundle, seed=5)
    for port in ("ranges", "point_cloud"):
        assert real.HasOutputPort(port)
        assert learned.HasOutputPort(port)
    place = PLACES[0]
    one, other = frame(real, place, 70.0), frame(learned, place, 70.0)
    assert np.array_equal(np.isfinite(one), np.isfinite(other))
    seen = np.isfinite(one)
    without = frame(LearnedLidar(bundle, LidarErrors()), place)
    assert np.abs(one[seen] - without[seen]).max() > 100.0
    # The mesh of facets lies up to 20 m inside the ball, further at grazing incidence.
    assert np.median(np.abs(one[seen] - other[seen])) < 20.0


def test_frames_are_the_ports_and_repeat_in_any_order(bundle: Path):
    lidar = LearnedLidar(
        bundle, LidarErrors(noise_std=50.0, dropout=0.2, false_returns=0.01), seed=3
    )
    times = np.array([0.0, 10.0, 20.0])
    frames = lidar.frames(times, PLACES, 3)
    assert frames.shape == (3, 12, 360)
    for k in (2, 0, 1):
        port = frame(lidar, PLACES[k], times[k]).astype(np.float32).reshape(12, 360)
        assert np.array_equal(port, frames[k])
    again = LearnedLidar(
        bundle, LidarErrors(noise_std=50.0, dropout=0.2, false_returns=0.01)
    ).frames(times, PLACES, 3)
    assert np.array_equal(frames, again)
    assert not np.array_equal(frames, lidar.frames(times, PLACES, 4))


# --- the paper's kind of network ------------------------------------------------------------------


@pytest.fixture(scope="module")
def frame_bundle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_ball_frame_bundle(tmp_path_factory.mktemp("ball") / "paper_bundle")


@pytest.mark.parametrize("place", PLACES)
def test_a_frame_network_sees_the_ball_as_a_ray_network_does(
    bundle: Path, frame_bundle: Path, place: np.ndarray
):
    """Both are the closed form of the same ball, so their frames agree but for rounding."""
    rays, frames = (
        LearnedLidar(each, LidarErrors(noise_std=0.0)) for each in (bundle, frame_bundle)
    )
    one, other = frame(rays, place), frame(frames, place)
    both = np.isfinite(one) & np.isfinite(other)
    assert both.sum() > 20
    # On the very edge single precision decides.
    assert (np.isfinite(one) != np.isfinite(other)).sum() <= 0.02 * both.sum()
    off = np.abs(one[both] - other[both])
    assert np.median(off) < 1.0
    assert off.max() < 300.0


# --- bundles --------------------------------------------------------------------------------------


def test_export_that_differs_is_refused(
    bundle: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    class Other(BallNetwork):
        def forward(self, chords):
            hit, depth = super().forward(chords)
            return hit, depth * (1.0 + 1e-4)

    exported = (bundle / "model.onnx").read_bytes()
    monkeypatch.setattr(bundles, "onnx_bytes", lambda network, *given: exported)
    with pytest.raises(InputError, match="no bundle is written"):
        write_bundle(tmp_path / "bundle", Other(), ball_facts(), ELLIPSOID, chord_ends())
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"kind": "photograph"}, "no kind 'photograph'"),
        ({"length_unit_m": "km"}, "length_unit_m is not a positive"),
        ({"kind": "ray network"}, "centre_m is not three numbers"),
        ({"rays": 180}, "by its outputs' shapes"),
        ({"planes": -12}, "must be positive"),
        ({"model_sha256": "0" * 64}, "its hash is not the one"),
    ],
)
def test_damaged_bundles_are_refused(
    frame_bundle: Path, tmp_path: Path, changes: dict[str, object], why: str
):
    folder = copied(frame_bundle, tmp_path)
    change_json(folder / "bundle.json", **changes)
    with pytest.raises(InputError, match=why):
        LidarBundle.load(folder)


def test_a_bundle_without_a_network_is_refused(frame_bundle: Path, tmp_path: Path):
    folder = copied(frame_bundle, tmp_path)
    (folder / "model.onnx").write_bytes(b"no network")
    change_json(folder / "bundle.json", model_sha256=hashlib.sha256(b"no network").hexdigest())
    with pytest.raises(InputError, match="is no learned lidar"):
        LidarBundle.load(folder)


@pytest.mark.parametrize(
    ("options", "why"),
    [
        (
            {"geometry": LidarGeometry(planes=6)},
            "12 planes of 360 rays, and the lidar has 6 of 360",
        ),
        ({"shape_sha256": "0" * 64}, "body of another shape"),
        ({"errors": LidarErrors(beam_width=1e-3)}, "leave out beam_width"),
    ],
)
def test_bundle_for_something_else_is_refused(bundle: Path, options: dict[str, Any], why: str):
    with pytest.raises(InputError, match=why):
        LearnedLidar(bundle, **options)
    with pytest.raises(InputError, match="is not the bundle of a learned lidar"):
        LearnedLidar(bundle / "nothing")
