"""The least time to the keep-out, compared with flights with every thruster at its limit.

Eq. 28 of docs/method/equations.md.
"""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from short_flights import kleopatra

from proxops.systems import PointMassField
from proxops.systems.hybrid.reach_time import ReachModel, greatest_gravity
from proxops.systems.shapes.ellipsoid import clearances

MASS, LIMIT, STEP = 100.0, 7.0, 10.0
AXES = np.array([140e3, 70e3, 65e3])


@pytest.fixture(scope="module")
def model() -> ReachModel:
    body = kleopatra()
    return ReachModel.of(body.gravity_field, body.keep_out_semi_axes, body.spin_rate, LIMIT / MASS)


def reached(model: ReachModel, field, starts: np.ndarray, forces, steps: int) -> np.ndarray:
    """Steps (N,) after which flights (N, 6) were inside, or `steps` + 1: classical Runge-Kutta.

    Args:
      forces: of the step's number and the states (N, 6), gives forces (N, 3) in N.
    """
    spin, count = model.spin, 2
    h = STEP / count

    def rates(states: np.ndarray, force: np.ndarray) -> np.ndarray:
        pull = field.evaluate(states[:, :3]).acceleration + force / MASS
        x, y, _, vx, vy, _ = states.T
        pull = pull + np.stack(
            [2 * spin * vy + spin**2 * x, -2 * spin * vx + spin**2 * y, 0 * x], axis=1
        )
        return np.hstack([states[:, 3:], pull])

    states, found = starts.copy(), np.full(len(starts), steps + 1)
    for step in range(steps):
        force = forces(step, states)
        for _ in range(count):
            a = rates(states, force)
            b = rates(states + h / 2 * a, force)
            c = rates(states + h / 2 * b, force)
            d = rates(states + h * c, force)
            states = states + h / 6 * (a + 2 * b + 2 * c + d)
            inside = clearances(model.semi_axes, states[:, :3]) <= 0.0
            found = np.where(inside & (found > steps), step, found)
    return found


def random_starts(count: int, seed: int) -> np.ndarray:
    """0 to 60 km above the ellipsoid, moving up to 30 m/s per axis."""
    random = np.random.default_rng(seed)
    ways = random.normal(size=(count, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    heights = 60e3 * random.random((count, 1)) ** 2 + 100.0
    speeds = random.uniform(-30.0, 30.0, (count, 3)) * random.random((count, 1))
    return np.hstack([ways * (AXES + heights), speeds])


def inward(states: np.ndarray) -> np.ndarray:
    """Full thrust, per axis, towards the ellipsoid."""
    return -LIMIT * np.sign(states[:, :3] / AXES**2)


@pytest.mark.slow
def test_no_thrust_reaches_the_ellipsoid_sooner(model: ReachModel) -> None:
    """Random bang-bang, thrust straight in, and thrust in held from the start."""
    starts, longest = random_starts(50, 3), 40
    safe = np.array([model.steps_out_of_reach(start, STEP, longest) for start in starts])
    assert len(set(safe)) > 12
    random = np.random.default_rng(4)
    field = kleopatra().gravity_field
    flights = {
        "bang-bang": lambda step, states: LIMIT * random.choice([-1.0, 1.0], (len(states), 3)),
        "in": lambda step, states: inward(states),
        "in, as at first": lambda step, states: inward(starts),
        "coasting": lambda step, states: np.zeros((len(states), 3)),
    }
    soonest = np.full(len(starts), longest + 1)
    for name, forces in flights.items():
        found = reached(model, field, starts, forces, longest)
        assert (found >= safe).all(), name
        soonest = np.minimum(soonest, found)
    # It is no empty promise: of those that can be reached, the bound has most of the time.
    hit = (soonest <= longest) & (soonest > 5)
    assert hit.sum() > 10
    assert np.median(safe[hit] / soonest[hit]) > 0.75


@pytest.mark.parametrize(("height", "speed"), [(5e3, 0.0), (40e3, 0.0), (40e3, 20.0)])
def test_straight_down_without_gravity_or_spin(height: float, speed: float) -> None:
    """Along an axis, from rest and with a speed: the times of constant acceleration."""
    model = ReachModel.of(PointMassField(1e-3), AXES, 0.0, 0.07)
    state = np.array([0.0, 0.0, AXES[2] + height, 0.0, 0.0, -speed])
    time = (-speed + np.sqrt(speed**2 + 2 * 0.07 * height)) / 0.07
    # Between steps it allows for the speed that any thrust could give.
    assert time / STEP - 3.0 <= model.steps_out_of_reach(state, STEP, 200) <= time / STEP
    # Pushed in for t and then out, it turns at the ellipsoid:
    # speed t + a t^2 / 2 + (speed + a t)^2 / (2 a) = height
    time = (-speed + np.sqrt(0.5 * speed**2 + 0.07 * height)) / 0.07
    assert model.steps_out_of_reach(state, STEP, 200, stopping=True) == int(time / STEP)


def test_too_fast_to_stop() -> None:
    model = ReachModel.of(PointMassField(1e-3), AXES, 0.0, 0.07)
    fast = np.array([0.0, 0.0, AXES[2] + 5e3, 0.0, 0.0, -30.0])  # 6.4 km to stop.
    assert model.steps_out_of_reach(fast, STEP, 200, stopping=True) == 0
    assert model.steps_out_of_reach(fast, STEP, 200) > 10


@pytest.mark.slow
def test_straight_out_thrust_stops_what_was_pushed_in(model: ReachModel) -> None:
    """Pushed in for as long as there is room, then out: hardly any flight touches the ellipsoid."""
    starts = random_starts(60, 5)
    steps = [model.steps_out_of_reach(start, STEP, 60, stopping=True) for start in starts]
    kept = np.array(steps) > 0
    starts, steps = starts[kept], np.array(steps)[kept]
    assert len(set(steps)) > 10
    field = kleopatra().gravity_field

    def flown(until: np.ndarray) -> np.ndarray:
        def forces(step: int, states: np.ndarray) -> np.ndarray:
            return np.where((step < until)[:, None], inward(states), -inward(states))

        return reached(model, field, starts, forces, 250) <= 250

    assert not flown(steps).any()
    # And the room is not much greater than it has to be.
    assert flown(2 * steps).mean() > 0.5


class Stronger:
    """A field that is stronger by a share, and also pushes inwards along each axis."""

    def __init__(self, field, share: float, push: float):
        self.field, self.share, self.push = field, share, push

    def evaluate(self, points: np.ndarray):
        found = self.field.evaluate(points)
        pull = (1.0 + self.share) * found.acceleration - self.push * np.sign(points)
        return found._replace(acceleration=pull)


@pytest.mark.slow
def test_room_to_stop_holds_for_all_that_is_declared() -> None:
    """Pushed in by the strongest thrust, then out by the weakest, from a state that is off."""
    body, share, other = kleopatra(), 0.1, 2e-3
    strong, weak = 1.05 * LIMIT / MASS, 0.9 * LIMIT / MASS
    model = ReachModel.of(body.gravity_field, AXES, body.spin_rate, strong, weak, share, other)
    starts = random_starts(60, 5)
    steps = np.array(
        [model.steps_out_of_reach(start, STEP, 60, 300.0, 0.5, stopping=True) for start in starts]
    )
    starts, steps = starts[steps > 0], steps[steps > 0]
    assert len(set(steps)) > 5
    normals = starts[:, :3] / AXES**2
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    off = starts - np.hstack([300.0 * normals, 0.5 * normals])

    def forces(step: int, states: np.ndarray) -> np.ndarray:
        return np.where((step < steps)[:, None], 1.05 * inward(states), -0.9 * inward(states))

    worst = Stronger(body.gravity_field, share, other)
    assert not (reached(model, worst, off, forces, 250) <= 250).any()


@given(st.integers(0, 10**6), st.floats(0.0, 3e3), st.floats(0.0, 3.0))
def test_errors_shorten_it(seed: int, position_error: float, velocity_error: float) -> None:
    """The answer holds for every state within the errors."""
    model = ReachModel(AXES, 3.2e-4, 0.07, np.array([0.0]), np.array([0.04]), 0.07)
    [state] = random_starts(1, seed)
    way = np.random.default_rng(seed).normal(size=(2, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    off = state + np.concatenate([position_error * way[0], velocity_error * way[1]])
    known = model.steps_out_of_reach(state, STEP, 100)
    unsure = model.steps_out_of_reach(state, STEP, 100, position_error, velocity_error)
    assert unsure <= known
    assert unsure <= model.steps_out_of_reach(off, STEP, 100) + 1


def test_gravity_bounds_hold_everywhere_outside() -> None:
    field = kleopatra().gravity_field
    heights = np.array([0.0, 10e3, 40e3])
    bounds = greatest_gravity(field, AXES, heights)
    random = np.random.default_rng(7)
    ways = random.normal(size=(4000, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    # Most of them just above the surface, where gravity is greatest.
    points = ways * (AXES + 80e3 * random.random((len(ways), 1)) ** 6)
    pulls = np.linalg.norm(field.evaluate(points).acceleration, axis=1)
    above = clearances(AXES, points)
    for height, bound in zip(heights, bounds, strict=True):
        greatest = pulls[above >= height].max()
        assert greatest <= bound
        assert bound < 1.25 * greatest
