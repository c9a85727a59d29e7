"""Sunlight against closed forms, another ray caster, and point masses in longer precision."""

import math

import numpy as np
import pytest
import trimesh
from one_system import context_of, evaluated
from pydrake.systems.analysis import Simulator
from scipy.spatial.transform import Rotation
from short_flights import kleopatra
from trimesh.ray.ray_triangle import RayMeshIntersector

from proxops.systems import Sunlight
from proxops.systems.common.errors import InputError
from proxops.systems.rotation import SpinModel, SteadySpin, TorqueFreeSpin
from proxops.systems.vehicle.sunlight import (
    SunlightConfig,
    greatest_sunlight,
    in_shadow,
    light_acceleration,
    solar_tide,
    sun_direction,
)

AU = 149_597_870_700.0
STILL = SteadySpin([0.0, 0.0, 0.0])
# Of the orbit of the Earth.
YEAR = 365.25


def sunlight(
    settings: SunlightConfig, spin: SpinModel = STILL, mass: float | None = 100.0, **given
) -> Sunlight:
    return Sunlight(settings, kleopatra().shape, spin, mass, **given)


def test_pressure_at_the_earth() -> None:
    """4.54e-6 N/m^2 on what takes up all light, and as textbooks say how it depends on the rest."""
    absorber = SunlightConfig(distance_au=1.0, reflectivity=1.0)
    assert light_acceleration(absorber, 1.0) == pytest.approx(4.54e-6, rel=1e-4)
    other = SunlightConfig(distance_au=2.5, area_m2=12.0, reflectivity=1.5)
    ratio = light_acceleration(other, 600.0) / light_acceleration(absorber, 1.0)
    assert ratio == pytest.approx(12.0 * 1.5 / (600.0 * 6.25))


def test_the_sun_stands_still_or_goes_round() -> None:
    still = SunlightConfig(direction=[0.0, 30.0, -40.0])
    for time in (0.0, 1e6):
        assert sun_direction(time, still) == pytest.approx((0.0, 0.6, -0.8))
    # Seen from a body that goes round counterclockwise, the Sun does so, too.
    turning = SunlightConfig(direction=[2.0, 0.0, 0.0], orbit_pole=[0.0, 0.0, 0.1], year_days=YEAR)
    for part in np.linspace(0.0, 1.0, 9):
        body = -np.array([math.cos(2.0 * math.pi * part), math.sin(2.0 * math.pi * part), 0.0])
        found = sun_direction(part * YEAR * 86400.0, turning)
        np.testing.assert_allclose(found, -body, atol=1e-12)


def test_the_direction_in_k_goes_round_with_the_spin() -> None:
    rate = [1e-4, -2e-4, 3e-4]
    system = sunlight(SunlightConfig(direction=[1.0, 2.0, -2.0]), SteadySpin(rate))
    back = Rotation.from_rotvec(-4000.0 * np.array(rate))
    found = evaluated(system, "direction", 4000.0, position=[3e5, 0.0, 0.0])
    np.testing.assert_allclose(found, back.apply([1.0, 2.0, -2.0]) / 3.0, atol=1e-12)
    # What rests in N moves by -w x s in K, also if the body tumbles.
    spin = TorqueFreeSpin(np.diag([1.0, 2.0, 2.5]), np.array(rate))
    system, time, step = sunlight(SunlightConfig(), spin), 7000.0, 1.0
    before, now, after = (np.array(system.direction(time + k * step)) for k in (-1.0, 0.0, 1.0))
    change = -np.cross(spin.angular_velocity(time), now)
    np.testing.assert_allclose((after - before) / (2.0 * step), change, atol=1e-10)


@pytest.mark.parametrize("direction", [[1.0, 0.0, 0.0], [-0.3, 0.8, 0.5], [0.1, 0.2, -1.0]])
def test_shadow_against_another_ray_caster(direction: list[float]) -> None:
    """At 300 places: all round Kleopatra, and behind it up to 1,000 km away."""
    shape, random = kleopatra().shape, np.random.default_rng(5)
    sun = np.array(direction) / np.linalg.norm(direction)
    places = random.normal(size=(300, 3))
    places *= 130e3 / np.linalg.norm(places, axis=1)[:, None]
    # Those far away lie in a narrow tube, a good part of which is dark.
    places[100:] -= (places[100:] @ sun)[:, None] * sun
    places[100:] *= 0.5
    places[100:] -= random.uniform(120e3, 1e6, (200, 1)) * sun
    suns = np.tile(sun, (300, 1))
    mesh = trimesh.Trimesh(shape.vertices, shape.facets, process=False)
    expected = RayMeshIntersector(mesh).intersects_any(places, suns)
    found = in_shadow(shape, places, suns)
    np.testing.assert_array_equal(found, expected)
    assert 60 < found.sum() < 240
    # Towards the Sun there is no shadow.
    assert not in_shadow(shape, 2e5 * suns[:1], suns[:1]).any()


def test_tide_against_point_masses() -> None:
    """The Sun's pull at the spacecraft less that at the body, with 64 bits of mantissa."""
    random, exact = np.random.default_rng(6), np.longdouble
    for _ in range(20):
        sun = random.normal(size=3)
        sun = (sun / np.linalg.norm(sun)).astype(exact)
        sun /= np.sqrt((sun**2).sum())
        arm, distance = 2e5 * random.normal(size=3), random.uniform(0.5, 5.0)
        far = exact(distance) * exact(AU) * sun
        ways = np.stack([far - arm.astype(exact), far])
        pulls = exact(1.3271244e20) * ways / np.sqrt((ways**2).sum(axis=1))[:, None] ** 3
        expected = (pulls[0] - pulls[1]).astype(float)
        x, y, z = sun.astype(float).tolist()
        found = solar_tide((arm[0], arm[1], arm[2]), (x, y, z), distance)
        np.testing.assert_allclose(found, expected, atol=1e-5 * np.abs(expected).max())


def test_acceleration_is_that_of_light_and_tide() -> None:
    """Light pushes away from the Sun; the tide counts from the body's true centre of mass."""
    settings, place = SunlightConfig(direction=[0.0, 1.0, 0.0]), [0.0, 2e5, 1e5]
    found = evaluated(
        sunlight(settings, axis_point=(0.0, 5e4, 0.0)), "acceleration", position=place
    )
    tide = np.array(solar_tide((0.0, 1.5e5, 1e5), (0.0, 1.0, 0.0), 2.79))
    light = light_acceleration(settings, 100.0)
    np.testing.assert_allclose(found, tide - [0.0, light, 0.0], rtol=1e-12)
    # On the line to the Sun the tide is 2 GM r / d^3 towards it.
    found = evaluated(sunlight(settings), "acceleration", position=[0.0, 2e5, 0.0])
    rate = 1.3271244e20 / (2.79 * AU) ** 3
    assert found[1] == pytest.approx(2.0 * rate * 2e5 - light)
    assert np.linalg.norm(found) < greatest_sunlight(settings, 100.0, 2e5)
    # Half of the mass is burnt.
    burnt = evaluated(sunlight(settings, mass=None), "acceleration", position=place, mass=[50.0])
    tide = np.array(solar_tide((0.0, 2e5, 1e5), (0.0, 1.0, 0.0), 2.79))
    np.testing.assert_allclose(burnt, tide - [0.0, 2.0 * light, 0.0], rtol=1e-12)


def test_the_shadow_is_found_at_control_steps() -> None:
    """Behind the body there is no light, from the first step on; between steps nothing changes."""
    system = sunlight(SunlightConfig(), period=10.0)
    simulator = Simulator(system, context_of(system, position=[-2e5, 0.0, 0.0]))
    simulator.Initialize()
    simulator.AdvanceTo(5.0)
    context = simulator.get_mutable_context()
    port = system.GetOutputPort("acceleration")
    tide = solar_tide((-2e5, 0.0, 0.0), (1.0, 0.0, 0.0), 2.79)
    np.testing.assert_array_equal(port.Eval(context), tide)
    system.GetInputPort("position").FixValue(context, np.array([2e5, 0.0, 0.0]))
    assert port.Eval(context)[0] > 0.0
    simulator.AdvanceTo(10.5)
    assert port.Eval(context)[0] < 0.0


def test_senseless_masses_are_refused() -> None:
    for mass in (0.0, -1.0, math.nan):
        with pytest.raises(InputError, match="mass"):
            sunlight(SunlightConfig(), mass=mass)
    with pytest.raises(InputError, match="period"):
        sunlight(SunlightConfig(), period=0.0)
