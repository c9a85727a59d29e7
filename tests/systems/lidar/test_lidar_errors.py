"""Each of the lidar's options alone, all of them together, and the rays they are cast with."""

import dataclasses as dc
from typing import Any

import numpy as np
import pytest
import trimesh
from numpy.typing import ArrayLike
from one_system import context_of, evaluated
from scipy import stats

from proxops.systems import Lidar, LidarGeometry, Polyhedron, RayCaster, ray_directions
from proxops.systems.lidar.lidar_errors import LidarErrors, TrueLidarConfig, false_ranges

POSITION = np.array([10e3, 30e3, 25e3])
ALL: dict[str, Any] = {
    "bias": 120.0,
    "scale_error": 2e-3,
    "max_incidence": 1.2,
    "dropout": 0.2,
    "false_returns": 0.05,
}


@pytest.fixture(scope="module")
def room() -> Polyhedron:
    """A cube of 20 km about the origin: from within, every ray returns."""
    return Polyhedron.from_trimesh(trimesh.creation.box([20e3, 20e3, 20e3]), "m")


def frame(lidar: Lidar, position: ArrayLike = POSITION, step: int = 0, seed: int = 0) -> np.ndarray:
    """One frame through the port (planes * rays,)."""
    return evaluated(lidar, "ranges", 10.0 * step, seed, position=position)


# --- each option alone ----------------------------------------------------------------------------


def test_noise_is_the_first_stream_of_seed_and_step(kleopatra: Polyhedron) -> None:
    exact, noisy = frame(Lidar(kleopatra, LidarErrors())), frame(Lidar(kleopatra), step=4, seed=9)
    hit = np.isfinite(exact)
    bits = np.random.Philox(key=[9, 4])
    noise = 50.0 * np.random.Generator(bits).standard_normal(hit.sum())
    assert np.array_equal(noisy[hit], exact[hit] + noise)


@pytest.mark.parametrize("degrees", [10.0, 30.0, 45.0, 54.0])
def test_grazing_returns_are_lost_on_flat_walls(room: Polyhedron, degrees: float) -> None:
    lidar = Lidar(room, LidarErrors(max_incidence=np.radians(degrees)))
    # On the wall that a ray meets first, its angle to the normal is its least to any axis.
    incidence = np.degrees(np.arccos(np.abs(ray_directions()).max(axis=1)))
    found = np.isfinite(frame(lidar, np.zeros(3)))
    clear = np.abs(incidence - degrees) > 1e-6
    assert np.array_equal(found[clear], incidence[clear] < degrees)
    assert 0 < found.sum() < len(found)


def test_grazing_returns_are_lost_on_a_ball() -> None:
    ball = trimesh.creation.icosphere(subdivisions=5, radius=50e3)
    shape = Polyhedron.from_trimesh(ball, "m")
    lidar = Lidar(
        shape, LidarErrors(max_incidence=np.radians(60.0)), LidarGeometry(planes=4, rays=3600)
    )
    found = np.isfinite(frame(lidar, [-100e3, 0.0, 0.0]))
    cosine = ray_directions(4, 3600)[:, 0]
    # Law of sines: sin(incidence) = distance / radius * sin(angle from the centre).
    sine = np.where(cosine > 0.0, 2.0 * np.sqrt(1.0 - np.minimum(cosine, 1.0) ** 2), np.inf)
    incidence = np.degrees(np.arcsin(np.minimum(sine, 1.0)))
    assert found[(sine < 1.0) & (incidence < 58.5)].all()  # Facets of 1.1 degrees.
    assert not found[incidence > 61.5].any()


def test_dropout_by_chance(room: Polyhedron) -> None:
    lidar = Lidar(room, LidarErrors(dropout=0.3))
    frames = np.array([frame(lidar, np.zeros(3), step) for step in range(20)])
    exact = frame(Lidar(room, LidarErrors()), np.zeros(3))
    lost = np.isinf(frames)
    assert np.array_equal(frames[~lost], np.broadcast_to(exact, frames.shape)[~lost])
    assert lost.mean() == pytest.approx(0.3, abs=4.0 * np.sqrt(0.21 / lost.size))
    # White over rays and over steps.
    for pairs in (lost[:, 1:] & lost[:, :-1], lost[1:] & lost[:-1]):
        assert pairs.mean() == pytest.approx(0.09, abs=5.0 * np.sqrt(0.0819 / pairs.size))
    assert np.isinf(frame(Lidar(room, LidarErrors(noise_std=50.0, dropout=1.0)), np.zeros(3))).all()


def test_false_returns_by_chance(room: Polyhedron) -> None:
    lidar = Lidar(room, LidarErrors(false_returns=0.04), LidarGeometry(max_range=200e3))
    frames = np.array([frame(lidar, [600e3, 0.0, 0.0], step) for step in range(40)])
    false = np.isfinite(frames)
    assert false.mean() == pytest.approx(0.04, abs=4.0 * np.sqrt(0.0384 / false.size))
    assert stats.kstest(frames[false] / 200e3, "uniform").pvalue > 1e-3
    # Isolated: a neighbour's chance is no greater for it.
    assert (false[:, 1:] & false[:, :-1]).mean() == pytest.approx(0.0016, abs=6e-4)
    assert np.array_equal(frames[3], false_ranges(4320, 0.04, 200e3, 0, 3))


def test_whole_frames_are_lost_by_chance(kleopatra: Polyhedron) -> None:
    """Those that are not lost are as they were, to the last bit."""
    few, times = LidarGeometry(2, 60), 10.0 * np.arange(800)
    places = np.tile(POSITION, (800, 1))
    options: dict[str, Any] = {"dropout": 0.2, "false_returns": 0.05}
    kept = Lidar(kleopatra, LidarErrors(50.0, **options), few).frames(times, places, 3)
    lossy = Lidar(kleopatra, LidarErrors(50.0, frame_loss=0.1, **options), few)
    frames = lossy.frames(times, places, 3)
    lost: np.ndarray = np.all(np.isinf(frames), axis=(1, 2))
    assert np.array_equal(frames[~lost], kept[~lost])
    assert np.isfinite(kept).any(axis=(1, 2)).all()
    assert lost.mean() == pytest.approx(0.1, abs=4.0 * np.sqrt(0.09 / 800))
    assert (lost[1:] & lost[:-1]).mean() == pytest.approx(0.01, abs=4.0 * np.sqrt(0.0099 / 800))
    other = np.isinf(lossy.frames(times[:200], places[:200], 4)).all(axis=(1, 2))
    assert not np.array_equal(other, lost[:200])
    assert np.isinf(frame(Lidar(kleopatra, LidarErrors(false_returns=1.0, frame_loss=1.0)))).all()


def test_an_outage_loses_the_frames_of_its_steps(kleopatra: Polyhedron) -> None:
    few, times = LidarGeometry(2, 60), 10.0 * np.arange(8)
    places, whole = np.tile(POSITION, (8, 1)), LidarErrors(50.0, false_returns=0.05)
    kept = Lidar(kleopatra, whole, few).frames(times, places, 3)
    frames = Lidar(kleopatra, dc.replace(whole, outage=(2, 5)), few).frames(times, places, 3)
    assert np.isinf(frames[2:5]).all()
    assert np.array_equal(np.delete(frames, [2, 3, 4], 0), np.delete(kept, [2, 3, 4], 0))
    assert TrueLidarConfig(outage_steps=3, outage_from_step=2).errors(50.0).outage == (2, 5)


@pytest.mark.parametrize(("planes", "rays"), [(1, 1), (3, 7), (24, 720)])
def test_geometry(room: Polyhedron, planes: int, rays: int) -> None:
    lidar = Lidar(room, LidarErrors(), LidarGeometry(planes=planes, rays=rays))
    assert lidar.GetOutputPort("ranges").size() == planes * rays
    a, b = np.pi / planes * (planes // 2), 2.0 * np.pi / rays * (rays // 3)
    direction = np.array([np.cos(b) * np.cos(a), np.cos(b) * np.sin(a), np.sin(b)])
    found = frame(lidar, np.zeros(3)).reshape(planes, rays)[planes // 2, rays // 3]
    assert found == pytest.approx(10e3 / np.abs(direction).max(), abs=0.02)
    frames = lidar.frames(np.zeros(2), np.zeros((2, 3)), seed=0)
    assert frames.shape == (2, planes, rays)


# --- all of them, and their randomness ------------------------------------------------------------


@pytest.mark.parametrize("option", ALL)
def test_one_option_leaves_the_numbers_of_the_others(kleopatra: Polyhedron, option: str) -> None:
    """With every option but one, and with all: where both read, they differ by its effect only."""
    rest = {key: value for key, value in ALL.items() if key != option}
    without = frame(Lidar(kleopatra, LidarErrors(50.0, **rest)))
    everything = frame(Lidar(kleopatra, LidarErrors(50.0, **ALL)))
    if option == "bias":
        both = np.isfinite(without)
        change = everything[both] - without[both]
        # What a false return hides is not biased, or is where the bias takes it behind that.
        assert (np.isclose(change, 120.0) | ((change >= 0.0) & (change < 120.0))).all()
        assert np.isclose(change, 120.0).mean() > 0.7
    elif option == "scale_error":
        factor = everything[np.isfinite(without)] / without[np.isfinite(without)] - 1.0
        assert ((np.abs(factor) < 1e-12) | (np.abs(factor - 2e-3) < 5e-5)).all()
    elif option == "false_returns":
        false = false_ranges(4320, 0.05, 350e3, 0, 0)
        assert np.array_equal(everything, np.minimum(without, false))
    else:  # A lost return bares at most the false one behind it.
        changed = everything != without
        assert changed.any()
        assert (everything[changed] > without[changed]).all()


def test_all_is_a_pure_function_of_seed_and_step(kleopatra: Polyhedron) -> None:
    lidar = Lidar(kleopatra, LidarErrors(50.0, **ALL), seed=5)
    context = context_of(lidar, 70.0, position=POSITION)
    ranges = lidar.GetOutputPort("ranges")
    first = ranges.Eval(context).copy()
    context.SetTime(80.0)
    assert not np.array_equal(first, ranges.Eval(context))
    context.SetTime(70.0)
    assert np.array_equal(first, ranges.Eval(context.Clone()))
    lidar.set_seed(context, 6)
    assert not np.array_equal(first, ranges.Eval(context))
    again = lidar.frames(np.array([70.0]), POSITION[None], seed=5)
    assert np.array_equal(again[0].ravel(), first.astype(np.float32))


# --- the rays -------------------------------------------------------------------------------------


def test_hits_name_the_facet_met(kleopatra: Polyhedron) -> None:
    directions = ray_directions()
    hits = RayCaster(kleopatra).fan(directions).hits(POSITION[None])
    assert len(hits.rays) > 500
    points = POSITION + hits.distances[:, None] * directions[hits.rays]
    corner = kleopatra.vertices[kleopatra.facets[hits.facets, 0]]
    height = np.einsum("ki,ki->k", points - corner, kleopatra.normals[hits.facets])
    assert np.abs(height).max() < 0.05
    assert (np.einsum("ki,ki->k", directions[hits.rays], kleopatra.normals[hits.facets]) < 0).all()
