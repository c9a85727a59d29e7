"""A flight that the navigation follows: its truth, its frames, and a navigation for it."""

import functools
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from short_flights import kleopatra

from proxops.systems import LidarNavigation
from proxops.systems.lidar import DEFAULT_GEOMETRY
from proxops.systems.shapes import Polyhedron, ray_caster

MASS, NOISE, PERIOD = 100.0, 50.0, 10.0


ATTITUDE = Rotation.from_rotvec(np.radians([0.6, -0.5, 0.62]))  # 1 degree.


def navigation(**changes: object) -> LidarNavigation:
    body = kleopatra()
    given = {"mass": MASS, "noise_std": NOISE, **changes}
    return LidarNavigation(body.shape, body.gravity_field, body.spin_rate, **given)


class Flight(NamedTuple):
    """Truth, period by period."""

    states: np.ndarray
    """(N, 6)."""
    forces: np.ndarray
    """(N, 3) in S: held over the period that ends at the row; 0 in the first."""
    frames: np.ndarray
    """(N, 4320)."""


@functools.cache
def flight(count: int = 70, start: tuple[float, ...] = (140e3, 70e3, -40e3), seed: int = 1):
    """Thrusts this way and that, with the attitude off by one degree."""
    rng, body = np.random.default_rng(seed), kleopatra()
    w = np.array([0.0, 0.0, body.spin_rate])

    def rates(_time: float, y: np.ndarray, push: np.ndarray) -> np.ndarray:
        pull = body.gravity_field.evaluate(y[None, :3]).acceleration[0]
        turning = -2.0 * np.cross(w, y[3:]) - np.cross(w, np.cross(w, y[:3]))
        return np.concatenate([y[3:], pull + turning + push])

    states, forces = [np.array([*start, -8.0, 12.0, 6.0])], [np.zeros(3)]
    force = np.zeros(3)
    for _ in range(count - 1):
        force = np.clip(0.9 * force + rng.normal(size=3), -7.0, 7.0)
        push = ATTITUDE.apply(force) / MASS
        flown = solve_ivp(rates, (0.0, PERIOD), states[-1], args=(push,), rtol=1e-10, atol=1e-6)
        states.append(flown.y[:, -1])
        forces.append(force)
    frames = np.array([frame(state[:3], seed + 10 * k) for k, state in enumerate(states)])
    return Flight(np.array(states), np.array(forces), frames)


def frame(place: np.ndarray, seed: int, body: Polyhedron | None = None) -> np.ndarray:
    distances, facets, _ = ray_caster(body or kleopatra().shape).first_hits(
        place, ATTITUDE.apply(DEFAULT_GEOMETRY.directions)
    )
    noisy = distances + NOISE * np.random.default_rng(seed).normal(size=distances.size)
    return np.where((facets >= 0) & (noisy < DEFAULT_GEOMETRY.max_range), noisy, np.inf)
