"""Moons on Kepler's ellipses, against an integration of the two-body problem, and their tide."""

import dataclasses as dc

import numpy as np
import pytest
from one_system import evaluated
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from proxops.systems.gravity import (
    GRAVITATIONAL_CONSTANT,
    MoonConfig,
    Moons,
    greatest_tide,
    later,
    moon_position,
    tide_of,
    tides,
)
from proxops.systems.rotation import SteadySpin

STILL = SteadySpin(np.zeros(3))
ALEXHELIOS = MoonConfig(
    mass_kg=1.2e15, semi_major_axis_m=655e3, period_s=2.455 * 86400.0, eccentricity=0.3,
    inclination_deg=20.0, node_deg=40.0, pericentre_deg=-70.0, mean_anomaly_deg=100.0,
)  # fmt: skip


@pytest.mark.parametrize("eccentricity", [0.0, 0.3, 0.95])
def test_an_orbit_is_that_of_two_bodies(eccentricity):
    """From the pericentre on, whose place and speed are in closed form, in rotated axes."""
    moon = dc.replace(ALEXHELIOS, eccentricity=eccentricity, mean_anomaly_deg=0.0)
    a = moon.semi_major_axis_m
    mu = a**3 * (2.0 * np.pi / moon.period_s) ** 2
    speed = np.sqrt(mu / a * (1.0 + eccentricity) / (1.0 - eccentricity))
    turn = Rotation.from_euler("ZXZ", [40.0, 20.0, -70.0], degrees=True)
    start = np.concatenate(
        [turn.apply([a * (1.0 - eccentricity), 0.0, 0.0]), turn.apply([0.0, speed, 0.0])]
    )

    def rate(_, y):
        return np.concatenate([y[3:], -mu * y[:3] / np.linalg.norm(y[:3]) ** 3])

    for time in (0.0, 3e4, 1.7 * moon.period_s):
        path = solve_ivp(rate, (0.0, time), start, "DOP853", rtol=1e-13, atol=1e-6)
        np.testing.assert_allclose(moon_position(moon, time, STILL), path.y[:3, -1], atol=1e-6 * a)


def test_it_goes_round_in_n_while_k_turns():
    spin, time = SteadySpin([1e-5, 0.0, 3e-4]), 5e3
    turn = Rotation.from_rotvec(time * spin.rate)
    seen, still = (moon_position(ALEXHELIOS, time, each) for each in (spin, STILL))
    np.testing.assert_allclose(turn.apply(seen), still, rtol=1e-12)


def test_the_tide_is_a_difference_of_two_pulls():
    """In extended precision; and by the system, of all moons."""
    position, time = np.array([150e3, -20e3, 40e3]), 2e4
    moons, total = [ALEXHELIOS, MoonConfig(5.8e14, 1e3, 499e3, 1.63 * 86400.0)], np.zeros(3)
    for moon in moons:
        place = moon_position(moon, time, STILL).astype(np.longdouble)
        away = place - position
        pull = away / np.sum(away**2) ** 1.5 - place / np.sum(place**2) ** 1.5
        wanted = np.array(GRAVITATIONAL_CONSTANT * moon.mass_kg * pull, dtype=float)
        np.testing.assert_allclose(tide_of(moon.mass_kg, np.array(place, float), position), wanted)
        total += wanted
    found = evaluated(Moons(moons, 0.0), "acceleration", time, position=position)
    np.testing.assert_allclose(found, total, rtol=1e-10)


def test_tides_at_many_times_are_along_the_axes_of_n():
    moons = [ALEXHELIOS, MoonConfig(5.8e14, 1e3, 499e3, 1.63 * 86400.0)]
    times = np.array([0.0, 3e4, 7e5])
    positions = np.array([[150e3, -20e3, 40e3], [1e5, 1e5, 0.0], [-2e5, 0.0, 9e4]])
    spin = SteadySpin([1e-5, 0.0, 3e-4])
    for time, position, found in zip(times, positions, tides(moons, times, positions), strict=True):
        turn = Rotation.from_rotvec(time * spin.rate)
        seen = turn.inv().apply(position)
        wanted = evaluated(Moons(moons, spin), "acceleration", float(time), position=seen)
        np.testing.assert_allclose(found, turn.apply(wanted), rtol=1e-9)


@pytest.mark.parametrize("inclination", [20.0, 0.0, 160.0])
def test_a_moon_that_is_told_later_by_other_axes_goes_the_same_way(inclination):
    moon, time = dc.replace(ALEXHELIOS, inclination_deg=inclination), 1.3e5
    axes = Rotation.from_rotvec([0.0, 0.0, 2.0] if inclination == 0.0 else [0.4, -0.3, 2.0])
    after = later(moon, time, axes.as_matrix())
    for more in (0.0, 5e4, 3e5):
        np.testing.assert_allclose(
            axes.apply(moon_position(after, more, STILL)),
            moon_position(moon, time + more, STILL),
            atol=1e-6 * moon.semi_major_axis_m,
        )


def test_the_bound_of_a_tide_holds():
    random = np.random.default_rng(1)
    worst = 0.0
    for _ in range(1000):
        place = random.normal(size=3)
        place *= 280e3 / np.linalg.norm(place)
        moon = moon_position(ALEXHELIOS, random.uniform(0.0, ALEXHELIOS.period_s), STILL)
        worst = max(worst, float(np.linalg.norm(tide_of(ALEXHELIOS.mass_kg, moon, place))))
    bound = greatest_tide([ALEXHELIOS], 280e3)
    assert 0.5 * bound < worst < bound
    assert greatest_tide([ALEXHELIOS], 500e3) == np.inf
    assert greatest_tide([], 1e9) == 0.0


def test_the_bound_of_a_tide_outside_an_ellipsoid_that_holds_the_orbit():
    """At the places of the ellipsoid that are nearest to the moon, and others around them."""
    moon = MoonConfig(2.7e9, 97.0, 1146.0, 4.1e4, 0.028)
    axes, far = np.array([1360.0, 1360.0, 600.0]), 2720.0
    bound, worst = greatest_tide([moon], far, [1360.0 - 1146.0 * 1.028]), 0.0
    for angle in np.linspace(0.0, 2.0 * np.pi, 100):
        for rise in np.linspace(-1.5, 1.5, 21):
            way = [np.cos(rise) * np.cos(angle), np.cos(rise) * np.sin(angle), np.sin(rise)]
            for time in (0.0, 2.05e4):
                tide = tide_of(moon.mass_kg, moon_position(moon, time, STILL), axes * way)
                worst = max(worst, float(np.linalg.norm(tide)))
    assert 0.8 * bound < worst < bound
