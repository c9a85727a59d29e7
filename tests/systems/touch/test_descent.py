"""The way down against closed forms, and flown at Bennu by an integration of its own."""

import numpy as np
import pytest
from even_field import EvenField
from scipy.integrate import solve_ivp

from proxops.diagrams.scenario import load_body
from proxops.systems.common import InputError
from proxops.systems.rotation import SteadySpin
from proxops.systems.touch.descent import (
    INTERVALS,
    DescentConfig,
    DescentGuidance,
    Site,
    TouchPhase,
)

UP = np.array([0.0, 0.0, 1.0])


def over_a_plane(pull: float = 0.0, thrust: float = 6.0, **changes: float) -> DescentGuidance:
    """Over the ground z = 0 that does not turn."""
    return DescentGuidance(
        EvenField([0.0, 0.0, -pull]),
        SteadySpin([0.0, 0.0, 0.0]),
        1400.0,
        thrust,
        Site(np.zeros(3), UP),
        DescentConfig(**changes),
    )


@pytest.mark.parametrize("pull", [0.0, 5e-5])
def test_the_least_effort_of_a_double_integrator(pull: float) -> None:
    """Its forces are those of the least squares, with constant gravity in them."""
    guidance = over_a_plane(pull)
    start, target = np.array([3.0, -2, 60.0, 0, 0.01, 0]), np.array([0.0, 0, 20.0, 0, 0, -0.1])
    duration, n = 500.0, INTERVALS
    force, states = guidance.plan(start, target, duration, 0.0)
    step = duration / n
    late = duration - step * (np.arange(n) + 0.5)
    maps = np.array([step * late, np.full(n, step)])
    gravity = np.array([0.0, 0.0, -pull])
    for axis in range(3):
        free = start[axis] + start[3 + axis] * duration + 0.5 * gravity[axis] * duration**2
        wanted = target[[axis, 3 + axis]] - [free, start[3 + axis] + gravity[axis] * duration]
        controls = np.linalg.pinv(maps) @ wanted
        assert force[axis] == pytest.approx(1400.0 * controls[0], abs=1e-6)
    np.testing.assert_allclose(states[-1], target, atol=1e-6)


def test_the_corridor_and_the_speed_bind() -> None:
    """From near its edge, on the way out of it, the plan keeps to both limits."""
    guidance = over_a_plane(slowing_s=200.0)
    edge = np.tan(np.radians(20.0)) * 100.0 + 2.0
    start, target = np.array([0.9 * edge, 0, 100.0, 0.1, 0, 0]), guidance.target(TouchPhase.GROUND)
    _, states = guidance.plan(start, target, 700.0, 0.0)
    heights, aside = states[:, 2], np.linalg.norm(states[:, :2], axis=1)
    room = np.tan(np.radians(20.0)) * heights + 2.0 - aside
    spare = 0.13 + heights / 200.0 + states[:, 5]
    assert room.min() > -1e-6
    assert spare.min() > -1e-6
    loose = over_a_plane(slowing_s=1.0, cone_deg=89.0)
    _, free = loose.plan(start, target, 700.0, 0.0)
    freely = np.tan(np.radians(20.0)) * free[:, 2] + 2.0 - np.linalg.norm(free[:, :2], axis=1)
    assert freely.min() < 0.0


def test_too_little_time_is_flown_with_all_thrust() -> None:
    guidance = over_a_plane(thrust=0.01)
    start = np.r_[guidance.home, np.zeros(3)]
    force, states = guidance.plan(start, guidance.target(TouchPhase.CHECKPOINT), 100.0, 0.0)
    assert force[2] == pytest.approx(-0.01, rel=1e-3)
    assert states[-1, 2] == pytest.approx(125.0 - 0.5 * 0.01 / 1400.0 * 100.0**2, abs=0.01)


def test_heights_must_fall() -> None:
    with pytest.raises(InputError, match="must fall"):
        over_a_plane(checkpoint_m=50.0)


def test_legs() -> None:
    guidance = over_a_plane()
    high, low = np.r_[0.0, 0, 30.0, 0, 0, 0], np.r_[0.0, 0, 4.0, 0, 0, 0]
    assert [guidance.leg(t, high) for t in (0.0, 500.0, 849.0, 850.0, 1400.0)] == [1, 2, 2, 3, 4]
    assert guidance.leg(900.0, low) is TouchPhase.TERMINAL
    # On the speed of contact the force is the weight.
    down = np.r_[0.0, 0, 4.0, 0, 0, -0.1]
    np.testing.assert_allclose(over_a_plane(5e-5).force(900.0, down), [0, 0, 0.07], atol=1e-12)


def test_what_exceeds_the_thrust_keeps_its_direction() -> None:
    """Away from the ground, slowly aside: braked in one straight push, and no more aside."""
    guidance = over_a_plane(5e-5)
    state = np.array([0.0, 0.0, 2.0, 0.03, 0.0, -0.1])
    force = guidance.steady_force(0.0, state, np.array([0.0, 0.0, 0.4]))
    assert force[2] == pytest.approx(6.0)
    wanted = np.array([-0.03, 0.0, 0.5]) / 10.0 + [0.0, 0.0, 5e-5]
    np.testing.assert_allclose(force / 6.0, wanted / wanted[2], rtol=1e-12)


def test_bennu() -> None:
    """From 15 m aside of home: 5 cm and 0.2 cm/s at contact, by scipy's integration in N."""
    body = load_body("bennu")
    facet = 700
    normal = body.shape.normals[facet]
    place = body.shape.vertices[body.shape.facets[facet]].mean(axis=0) + 3.0 * normal
    guidance = DescentGuidance(body.exact_field, body.spin, 1400.0, 6.0, Site(place, normal))
    rate = body.spin.rate

    def moved(state: np.ndarray, force: np.ndarray, step: float) -> np.ndarray:
        """In N, whose axes are those of K at the beginning of the step."""

        def turn(time: float) -> np.ndarray:
            angle = rate[2] * time
            c, s = np.cos(angle), np.sin(angle)
            return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])

        def rates(time: float, y: np.ndarray) -> np.ndarray:
            back = turn(time)
            pull = body.exact_field.evaluate((back.T @ y[:3])[None]).acceleration[0]
            return np.r_[y[3:], back @ (pull + force / 1400.0)]

        start = np.r_[state[:3], state[3:] + np.cross(rate, state[:3])]
        end = solve_ivp(rates, (0.0, step), start, method="RK45", rtol=1e-8, atol=1e-8).y[:, -1]
        back = turn(step).T
        position = back @ end[:3]
        return np.r_[position, back @ end[3:] - np.cross(rate, position)]

    aside = np.cross(normal, UP)
    state = np.r_[guidance.home + 15.0 * aside / np.linalg.norm(aside), np.zeros(3)]
    time, room, off = 0.0, np.inf, np.inf
    while (height := guidance.height(state)) > 0.0:
        step = 2.0 if height < 7.0 else 20.0
        state = moved(state, guidance.force(time, state), step)
        time += step
        height = guidance.height(state)
        off = np.linalg.norm(state[:3] - place - height * normal)
        room = min(room, np.tan(np.radians(20.0)) * height + 2.0 - off)
    assert time == pytest.approx(guidance.duration, abs=10.0)
    down = state[3:] @ normal
    assert off < 0.1
    assert down == pytest.approx(-0.1, abs=0.002)
    assert np.linalg.norm(state[3:] - down * normal) < 0.002
    assert room > 0.0
