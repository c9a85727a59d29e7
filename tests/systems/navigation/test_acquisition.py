"""Finding the pose from one frame: right, or none, at bodies of several forms."""

import numpy as np
import pytest
import trimesh
from posed_frames import BODIES, STD, body, measured, model, poses
from scipy.spatial.transform import Rotation
from short_flights import kleopatra

from proxops.systems import Lidar, Polyhedron
from proxops.systems.navigation.acquisition import Acquired, acquire


def outcome(name: str, pose: tuple[np.ndarray, Rotation], frame: np.ndarray) -> str:
    found = acquire(model(name), frame, np.eye(3), STD)
    if found is None:
        return "none"
    return "right" if right(name, pose, found) else "wrong"


def right(name: str, pose: tuple[np.ndarray, Rotation], found: Acquired) -> bool:
    place, turn = pose
    size = float(body(name).extents.max())
    off = (Rotation.from_matrix(found.rotation) * turn.inv()).magnitude()
    return bool(np.linalg.norm(found.position - place) < 0.01 * size and off < 3.0 * STD)


def outcomes(name: str, count: int, seed: int, **errors: float) -> dict[str, int]:
    found = [
        outcome(name, pose, measured(name, pose, seed + k, **errors))
        for k, pose in enumerate(poses(name, count, seed))
    ]
    return {each: found.count(each) for each in ("right", "none", "wrong")}


def check(found: dict[str, int], at_least: float, wrong: float = 0.0) -> None:
    """Right in so many, and hardly ever wrong."""
    assert found["wrong"] <= wrong * sum(found.values()), found
    assert found["right"] >= at_least * sum(found.values()), found


# --- right or none --------------------------------------------------------------------------------


def test_around_kleopatra() -> None:
    check(outcomes("kleopatra", 40, 100), 0.97)


@pytest.mark.parametrize(
    ("count", "seed", "at_least", "wrong"),
    [(8, 200, 0.85, 0.0), pytest.param(150, 2000, 0.93, 0.02, marks=pytest.mark.slow)],
)
@pytest.mark.parametrize("name", BODIES)
def test_false_returns_and_dropout(
    name: str, count: int, seed: int, at_least: float, wrong: float
) -> None:
    check(outcomes(name, count, seed, false_returns=0.2, dropout=0.1), at_least, wrong)


def test_the_attitude_as_known_turns_everything() -> None:
    """S need not be close to K, if only its attitude is known."""
    known = Rotation.from_rotvec([0.9, -0.4, 1.3])
    place, turn = poses("kleopatra", 1, 6)[0]
    pose = place, turn * known
    frame = measured("kleopatra", pose, 6)
    found = acquire(model("kleopatra"), frame, known.as_matrix(), STD)
    assert found is not None
    assert right("kleopatra", pose, found)


# --- none -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["kleopatra", "lumpy ball"])
@pytest.mark.parametrize("share", [0.0, 0.05, 1.0])
def test_nothing_is_found_where_nothing_is(name: str, share: float) -> None:
    """Frames of no returns, of few, and of false ones alone."""
    rng, modelled = np.random.default_rng(1), model(name)
    for _ in range(3):
        frame = modelled.geometry.max_range * rng.uniform(0.0, 1.0, modelled.geometry.size)
        frame[rng.uniform(size=frame.size) >= share] = np.inf
        assert acquire(modelled, frame, np.eye(3), STD) is None


def test_another_body_is_not_taken_for_this_one() -> None:
    """Frames of a body twice as thick, or of a ball."""
    shape = kleopatra().shape
    thick = Polyhedron(shape.vertices * [0.6, 1.5, 1.5], shape.facets)
    ball = trimesh.creation.icosphere(4, radius=60e3)
    for other in (thick, Polyhedron.from_trimesh(ball, "m")):
        for place, _ in poses("kleopatra", 4, 9):
            returns = Lidar(other).true_returns(1.3 * place)
            frame = np.full(4320, np.inf)
            frame[returns.rays] = returns.distances
            assert acquire(model("kleopatra"), frame, np.eye(3), STD) is None
