"""Light on facets, against closed forms: a plate, a cube, a ball; and Basilisk where it is."""

import numpy as np
import pytest
from one_system import context_of, evaluated
from scipy.spatial.transform import Rotation

from proxops.diagrams.scenario import facets_of, load_spacecraft
from proxops.systems.common import spread_directions
from proxops.systems.gravity import ball
from proxops.systems.rotation import SteadySpin
from proxops.systems.vehicle import (
    Facets,
    Sunlight,
    SunlightConfig,
    light_on_facets,
    light_pressure,
)

AXES = np.concatenate([np.eye(3), -np.eye(3)])


def facets(normals, areas, specular: float, diffuse: float, centres=None) -> Facets:
    count = len(normals)
    middles = np.zeros((count, 3)) if centres is None else np.array(centres, dtype=float)
    shares = np.full(count, specular), np.full(count, diffuse)
    return Facets(middles, np.array(normals, dtype=float), np.array(areas, dtype=float), *shares)


def cube(edge: float, specular: float, diffuse: float) -> Facets:
    return facets(AXES, np.full(6, edge**2), specular, diffuse, 0.5 * edge * AXES)


@pytest.mark.parametrize(
    ("specular", "diffuse", "away", "along"),
    [(0.0, 0.0, 1.0, 0.0), (1.0, 0.0, 0.0, 2.0), (0.0, 1.0, 1.0, 2.0 / 3.0)],
)
def test_a_plate(specular: float, diffuse: float, away: float, along: float) -> None:
    """At 60 degrees: black, a mirror, and white, each by what one knows of it."""
    plate = facets([[0.0, 0.0, 1.0]], [3.0], specular, diffuse, [[0.5, 0.0, 0.2]])
    sun = np.array([np.sin(np.pi / 3.0), 0.0, np.cos(np.pi / 3.0)])
    force, torque = light_on_facets(plate, sun)
    # A mirror pushes along its normal, twice with what falls on it times the cosine.
    normal = along * (np.cos(np.pi / 3.0) if specular else 1.0)
    wanted = -3.0 * 0.5 * (away * sun + normal * np.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(force, wanted, atol=1e-15)
    np.testing.assert_allclose(torque, np.cross([0.5, 0.0, 0.2], wanted), atol=1e-15)
    for dark in (-sun, [1.0, 0.0, 0.0]):
        np.testing.assert_array_equal(light_on_facets(plate, np.array(dark)), np.zeros((2, 3)))


def test_a_cube_about_its_centre() -> None:
    """The force in closed form, and no torque."""
    for sun in spread_directions(50):
        force, torque = light_on_facets(cube(2.0, 0.3, 0.2), sun)
        wanted = -4.0 * (0.7 * np.abs(sun).sum() * sun)
        wanted = wanted - 8.0 * np.sign(sun) * (0.3 * sun**2 + 0.2 / 3.0 * np.abs(sun))
        np.testing.assert_allclose(force, wanted, atol=1e-13)
        np.testing.assert_allclose(torque, 0.0, atol=1e-13)


@pytest.mark.parametrize(("specular", "diffuse"), [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (0.3, 0.4)])
def test_a_ball_of_many_facets_is_a_ball(specular: float, diffuse: float) -> None:
    """pi r^2 (1 + 4/9 diffuse): a mirror and a black ball are pushed alike."""
    shape = ball(2.0)
    corners = shape.vertices[shape.facets]
    spans = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(spans, axis=1)
    many = facets(spans / areas[:, None], areas, specular, diffuse, corners.mean(axis=1))
    wanted = -np.pi * 4.0 * (1.0 + 4.0 / 9.0 * diffuse)
    for sun in spread_directions(5):
        force, torque = light_on_facets(many, sun)
        np.testing.assert_allclose(force, wanted * sun, atol=0.01 * abs(wanted))
        np.testing.assert_allclose(torque, 0.0, atol=0.01)


def test_the_system_turns_with_the_spacecraft() -> None:
    """Force in K and torque in S of a panel beside the centre, and none in the shadow."""
    settings = SunlightConfig(direction=[1.0, 0.0, 0.0], distance_au=1.0)
    panel = facets([[1.0, 0.0, 0.0]], [2.0], 0.0, 0.0, [[0.0, 1.5, 0.0]])
    system = Sunlight(
        settings, ball(100.0), SteadySpin([0.0, 0.0, 0.0]), 50.0, period=10.0, facets=panel
    )
    turn = Rotation.from_euler("z", 60.0, degrees=True)
    attitude = turn.as_quat(scalar_first=True)
    place = np.array([300.0, 0.0, 0.0])
    found = evaluated(system, "acceleration", position=place, attitude=attitude)
    pressure = light_pressure(settings)
    assert pressure == pytest.approx(4.54e-6, rel=1e-3)
    np.testing.assert_allclose(
        found, [-pressure * 2.0 * 0.5 / 50.0, 0.0, 0.0], rtol=1e-3, atol=1e-16
    )
    torque = evaluated(system, "torque", position=place, attitude=attitude)
    force = pressure * turn.inv().apply([-1.0, 0.0, 0.0])
    np.testing.assert_allclose(torque, np.cross([0.0, 1.5, 0.0], force), rtol=1e-12, atol=1e-20)
    behind = context_of(system, position=-place, attitude=attitude)
    behind.SetDiscreteState(system._shadow(behind))
    np.testing.assert_array_equal(system.GetOutputPort("torque").Eval(behind), np.zeros(3))


def test_facets_of_a_model_are_the_faces_of_its_boxes() -> None:
    """Hayabusa2: a bus of 1 by 1.6 by 1.25 m and two panels of 4.23 by 1.4 m."""
    found = facets_of(load_spacecraft("hayabusa2"))
    assert len(found.areas) == 18
    for axis, area in ((0, 1.6 * 1.25 + 2 * 1.4 * 0.03), (2, 1.6 + 2 * 4.23 * 1.4)):
        along = found.normals[:, axis] > 0.99
        assert found.areas[along].sum() == pytest.approx(area)
    np.testing.assert_allclose((found.areas[:, None] * found.normals).sum(axis=0), 0.0, atol=1e-12)
    # Of closed boxes: the sum of centre times normal times area is three times the volume.
    volume = 1.0 * 1.6 * 1.25 + 2.0 * 4.23 * 1.4 * 0.03
    ends = np.einsum("fi,fi,f->", found.centres, found.normals, found.areas)
    assert ends == pytest.approx(3.0 * volume)
    moved = facets_of(load_spacecraft("hayabusa2"), np.array([0.1, 0.0, 0.0]))
    np.testing.assert_allclose(found.centres - moved.centres, [[0.1, 0.0, 0.0]] * 18, atol=1e-12)
