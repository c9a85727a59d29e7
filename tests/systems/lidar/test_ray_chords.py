"""Chords of rays through an ellipsoid, against geometry done otherwise."""

import numpy as np
import pytest

from proxops.systems import ray_directions
from proxops.systems.lidar.ray_chords import ChordFan

CENTRE, AXES = np.array([3e3, -5e3, 2e3]), np.array([120e3, 60e3, 50e3])
PLACES = np.array([[170e3, 20e3, -30e3], [-90e3, 150e3, 60e3], [0.0, 0.0, 300e3]])


def levels(points: np.ndarray) -> np.ndarray:
    return np.linalg.norm((points - CENTRE) / AXES, axis=-1)


def test_ends_lie_on_the_ray_and_on_the_ellipsoid():
    directions = ray_directions()
    chords = ChordFan(CENTRE, AXES, directions).chords(PLACES)
    assert len(chords.rays) > 500
    assert chords.ends.dtype == np.float32
    for end, way in (
        (chords.ends[:, :3], chords.starts),
        (chords.ends[:, 3:], chords.starts + chords.lengths),
    ):
        points = PLACES[chords.places] + way[:, None] * directions[chords.rays]
        assert (points - CENTRE) / AXES == pytest.approx(end, abs=1e-6)
        assert levels(points) == pytest.approx(np.ones(len(points)), abs=1e-9)
    assert (chords.starts > 0.0).all()
    assert (chords.lengths > 0.0).all()


def test_which_rays_pass_through_by_walking_along_them():
    directions = ray_directions(5, 40)
    chords = ChordFan(CENTRE, AXES, directions).chords(PLACES)
    ways = np.linspace(0.0, 500e3, 20001)
    for k, place in enumerate(PLACES):
        least = np.array([levels(place + ways[:, None] * d).min() for d in directions])
        passing = set(chords.rays[chords.places == k].tolist())
        assert {int(r) for r in np.flatnonzero(least < 1.0)} <= passing
        assert not passing & {int(r) for r in np.flatnonzero(least > 1.0 + 1e-6)}


def test_from_inside_every_ray_has_a_chord_that_begins_there():
    place = np.array([[50e3, 10e3, -10e3]])
    directions = ray_directions()
    chords = ChordFan(CENTRE, AXES, directions).chords(place)
    assert chords.rays.tolist() == list(range(len(directions)))
    assert not chords.starts.any()
    entry = np.broadcast_to((place - CENTRE) / AXES, (len(directions), 3))
    assert chords.ends[:, :3] == pytest.approx(entry, abs=1e-6)
