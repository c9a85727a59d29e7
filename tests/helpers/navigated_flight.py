"""A flight that the navigation follows: its truth, its frames, and a navigation for it."""

import functools
from typing import NamedTuple

import numpy as np
from plain_motion import moved
from scipy.spatial.transform import Rotation
from short_flights import kleopatra

from proxops.systems import ExpectedErrors, LidarFrames, LidarNavigation
from proxops.systems.lidar import DEFAULT_GEOMETRY
from proxops.systems.shapes import Polyhedron, ray_caster

MASS, NOISE, PERIOD = 100.0, 50.0, 10.0


ATTITUDE = Rotation.from_rotvec(np.radians([0.6, -0.5, 0.62]))  # 1 degree.


def navigation(expected: ExpectedErrors | None = None, delay: int = 0) -> LidarNavigation:
    body, frames = kleopatra(), LidarFrames(NOISE, delay=delay)
    return LidarNavigation(body.shape, body.gravity_field, body.spin_rate, MASS, frames, expected)


class Flight(NamedTuple):
    """Truth, period by period."""

    states: np.ndarray
    """(N, 6)."""
    forces: np.ndarray
    """(N, 3) in S: held over the period that ends at the row; 0 in the first."""
    frames: np.ndarray
    """(N, 4320)."""


@functools.cache
def flight(count: int = 70, start: tuple[float, ...] = (140e3, 70e3, -40e3)):
    """Thrusts this way and that, with the attitude off by one degree."""
    rng, body = np.random.default_rng(1), kleopatra()
    states, forces = [np.array([*start, -8.0, 12.0, 6.0])], [np.zeros(3)]
    force = np.zeros(3)
    for _ in range(count - 1):
        force = np.clip(0.9 * force + rng.normal(size=3), -7.0, 7.0)
        push = ATTITUDE.apply(force) / MASS
        states.append(moved(body.gravity_field, body.spin_rate, states[-1], push, PERIOD))
        forces.append(force)
    frames = np.array([frame(state[:3], 1 + 10 * k) for k, state in enumerate(states)])
    return Flight(np.array(states), np.array(forces), frames)


def frame(place: np.ndarray, seed: int, body: Polyhedron | None = None) -> np.ndarray:
    distances, facets, _ = ray_caster(body or kleopatra().shape).first_hits(
        place, ATTITUDE.apply(DEFAULT_GEOMETRY.directions)
    )
    noisy = distances + NOISE * np.random.default_rng(seed).normal(size=distances.size)
    return np.where((facets >= 0) & (noisy < DEFAULT_GEOMETRY.max_range), noisy, np.inf)
