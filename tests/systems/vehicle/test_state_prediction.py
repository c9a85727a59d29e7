"""The prediction over a short while, and its inverse, against SciPy's integration."""

import numpy as np
import pytest
from plain_motion import moved
from short_flights import kleopatra

from proxops.systems.vehicle import moved_by, predicted_state, unexplained_acceleration

MASS, SPIN = 100.0, 2.0 * np.pi / (5.38528 * 3600.0)
# Moving fast over the surface, by a tip, and far out at rest.
STATES = np.array(
    [
        [20e3, 45e3, 30e3, 30.0, -20.0, 25.0],
        [128e3, 5e3, -10e3, -10.0, 35.0, 5.0],
        [-150e3, 120e3, -90e3, 0.0, 0.0, 0.0],
    ]
)
FORCE = np.array([7.0, -3.0, 5.0])


def integrated(state: np.ndarray, duration: float, push: np.ndarray) -> np.ndarray:
    """The same motion, cross products written out, by an adaptive method of order 8."""
    return moved(kleopatra().gravity_field, SPIN, state, FORCE / MASS + push, duration)


@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("duration", [0.5, 2.0, 10.0, 60.0])
def test_prediction_is_the_motion(state: np.ndarray, duration: float) -> None:
    field = kleopatra().gravity_field
    found = predicted_state(state, FORCE, duration, field, MASS, SPIN)
    expected = integrated(state, duration, np.zeros(3))
    assert found[:3] == pytest.approx(expected[:3], abs=1e-4)
    assert found[3:] == pytest.approx(expected[3:], abs=1e-5)


@pytest.mark.parametrize("state", STATES)
def test_push_is_found_and_added(state: np.ndarray) -> None:
    field, push = kleopatra().gravity_field, np.array([2e-3, -5e-3, 1e-3])
    after = integrated(state, 10.0, push)
    found = unexplained_acceleration(state, after, FORCE, 10.0, field, MASS, SPIN)
    assert found == pytest.approx(push, abs=1e-6)
    without = predicted_state(state, FORCE, 10.0, field, MASS, SPIN)
    moved = without + moved_by(push, 10.0)
    assert moved[:3] == pytest.approx(after[:3], abs=1e-3)
    # Coriolis acceleration of what was added, 2 w p t^2 / 2, is left out.
    assert moved[3:] == pytest.approx(after[3:], abs=3e-4)
