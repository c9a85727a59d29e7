"""The law of a descent against least squares, and that what a network is told has no units."""

import dataclasses

import numpy as np
import pytest
from even_field import EvenField

from proxops.systems.common import InputError
from proxops.systems.policy import DESCENT_INPUTS, DescentNetwork
from proxops.systems.rotation import SteadySpin
from proxops.systems.touch import (
    DescentConfig,
    DescentGuidance,
    DescentPolicy,
    Site,
    TouchPhase,
    descent_inputs,
)

NORMAL = np.array([2.0, -1.0, 2.0]) / 3.0
STATE = np.array([70.0, -25.0, 64.0, 0.01, -0.02, -0.05])
NOTHING = DescentNetwork(
    np.zeros((4, DESCENT_INPUTS)), np.zeros(4), np.zeros((4, 4)), np.zeros(4), np.zeros((3, 4)),
    np.zeros(3),
)  # fmt: skip


def over_a_place(length: float = 1.0, time: float = 1.0, spin: float = 0.0) -> DescentGuidance:
    """Even gravity, not along the normal, in other units of length and time."""
    usual = DescentConfig()
    descent = dataclasses.replace(
        usual,
        **{
            name: value * (length if name.endswith("_m") else time if name.endswith("_s") else 1.0)
            for name, value in dataclasses.asdict(usual).items()
        },
    )
    descent = dataclasses.replace(descent, speed_m_s=usual.speed_m_s * length / time)
    pull = np.array([-3e-5, 1e-5, -4e-5]) * length / time**2
    turning = SteadySpin([0.0, 0.0, spin / time])
    site = Site(length * np.array([1.0, 2.0, 3.0]), NORMAL)
    thrust = 6.0 * length / time**2
    return DescentGuidance(EvenField(pull.tolist()), turning, 1400.0, thrust, site, descent)


def test_the_law_is_that_of_the_least_effort() -> None:
    """Controls of 2,000 intervals by least squares, in the limit of which the law is exact."""
    guidance, duration, n = over_a_place(), 480.0, 2000
    target = guidance.target(TouchPhase.CHECKPOINT)
    given, law = descent_inputs(guidance, STATE, target, duration, 0.0)
    step = duration / n
    late = duration - step * (np.arange(n) + 0.5)
    maps = np.array([step * late, np.full(n, step)])
    pull = guidance.apparent_gravity(STATE[:3], 0.0)
    free = STATE[:3] + duration * STATE[3:] + 0.5 * duration**2 * pull
    wanted = np.array([target[:3] - free, target[3:] - STATE[3:] - duration * pull])
    first = (np.linalg.pinv(maps) @ wanted)[0]
    unit = guidance.descent.speed_m_s / duration
    np.testing.assert_allclose(unit * law @ guidance.axes, first, rtol=1e-3, atol=1e-3 * unit)
    assert given.shape == (DESCENT_INPUTS,)


def test_without_a_network_s_correction_the_law_flies() -> None:
    guidance = over_a_place(spin=3e-4)
    target, duration = guidance.aim(TouchPhase.CHECKPOINT, 20.0)
    _, law = descent_inputs(guidance, STATE, target, duration, 120.0)
    unit = guidance.mass * guidance.descent.speed_m_s / duration
    force = DescentPolicy(guidance, NOTHING).force(20.0, STATE, 100.0)
    np.testing.assert_allclose(force, unit * law @ guidance.axes, rtol=1e-12)
    # It is within a fifth of the program, which holds a force for a tenth of the time.
    planned = guidance.force(20.0, STATE, 100.0)
    assert np.linalg.norm(force - planned) < 0.2 * np.linalg.norm(planned)
    low = np.r_[guidance.site.position + 2.0 * NORMAL, np.zeros(3)]
    np.testing.assert_array_equal(
        DescentPolicy(guidance, NOTHING).force(1000.0, low), guidance.force(1000.0, low)
    )


def test_inputs_have_no_units() -> None:
    rows = []
    for length, time in ((1.0, 1.0), (7.0, 0.3)):
        guidance = over_a_place(length, time, spin=3e-4)
        state = STATE * np.repeat([length, length / time], 3)
        target, duration = guidance.aim(TouchPhase.CHECKPOINT, 20.0 * time)
        rows.append(np.concatenate(descent_inputs(guidance, state, target, duration, 0.0)))
    np.testing.assert_allclose(rows[1], rows[0], rtol=1e-9)


def test_a_damaged_network_is_refused() -> None:
    sound = DescentNetwork(*(array.astype(np.float32) for array in NOTHING))
    np.testing.assert_array_equal(DescentNetwork.from_bytes(sound.to_bytes()).biases_3, 0.0)
    wide = sound._replace(weights_2=np.zeros((4, 5), dtype=np.float32))
    with pytest.raises(InputError, match="weights_2 is not finite float32 numbers of the shape"):
        DescentNetwork.from_bytes(wide.to_bytes())
    with pytest.raises(InputError, match="cannot be read"):
        DescentNetwork.from_bytes(b"no archive")
