"""The first steps of navigation, in which it knows little, around bodies of several forms."""

import functools

import numpy as np
import pytest
from plain_motion import moved
from posed_frames import BODIES, body, measured, model, poses
from scipy.spatial.transform import Rotation

from proxops.systems import ExpectedErrors, GravityField
from proxops.systems.navigation import Estimate
from proxops.systems.navigation.motion import Motion, Push
from proxops.systems.navigation.navigator import Navigator

STEPS, SEED, MASS = 6, 3000, 100.0
NOTHING = Push.along_axes(np.zeros(3))
FALSE = {"false_returns": 0.2, "dropout": 0.1}


@functools.cache
def field(name: str) -> GravityField:
    return GravityField(body(name), density=2500.0)


class World:
    """A body that turns, and a spacecraft that coasts past it about as fast as in a low orbit."""

    def __init__(self, name: str):
        size = float(body(name).extents.max())
        self.name, self.field = name, field(name)
        self.orbit = float(np.sqrt(6.6743e-11 * self.field.mass / size))
        self.spin, self.period = 0.3 * self.orbit / size, 0.01 * size / self.orbit
        expected = ExpectedErrors()
        motion = Motion(self.field, body(name).extents, self.spin, MASS, expected)
        self.navigator = Navigator(model(name), motion, expected, self.orbit, self.period, 0)

    def after(self, state: np.ndarray) -> np.ndarray:
        """The state (6,) a period later."""
        return moved(self.field, self.spin, state, np.zeros(3), self.period)


def off(now: Estimate, state: np.ndarray, turn: Rotation) -> float:
    """The greatest error of position, velocity and attitude, in standard deviations."""
    rotation = (Rotation.from_matrix(now.rotation) * turn.inv()).as_rotvec()
    wrong = np.concatenate([now.state - state, rotation])
    return float(np.max(np.abs(wrong) / np.sqrt(np.diag(now.covariance)[:9])))


def first_steps(name: str, indices: list[int], **errors: float) -> tuple[float, float]:
    """The share of steps with a state, and the greatest error in deviations."""
    world, following, worst = World(name), [], 0.0
    places = poses(name, max(indices) + 1, SEED)
    for index in indices:
        place, turn = places[index]
        velocity = 0.5 * world.orbit * np.random.default_rng(index).normal(size=3)
        state, memory = np.concatenate([place, velocity]), world.navigator.start()
        for k in range(STEPS):
            frame = measured(name, (state[:3], turn), SEED + 10 * index + k, **errors)
            step = world.navigator.step(memory, frame, NOTHING, world.period * k)
            memory = step.memory
            following.append(step.now is not None)
            if step.now is not None:
                worst = max(worst, off(step.now, state, turn))
            state = world.after(state)
    return float(np.mean(following)), worst


@pytest.mark.parametrize(
    ("indices", "most", "share"),
    [([10, 11], 6.0, 0.8), pytest.param([*range(12)], 6.5, 0.95, marks=pytest.mark.slow)],
)
@pytest.mark.parametrize("errors", [{}, FALSE])
@pytest.mark.parametrize("name", BODIES)
def test_no_confident_lie(
    name: str, errors: dict, indices: list[int], most: float, share: float
) -> None:
    """The second frame says what the velocity is; it is not to believe false returns then."""
    following, worst = first_steps(name, indices, **errors)
    assert worst < most
    assert following > share
