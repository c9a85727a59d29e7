"""Kicks: when, how large, and what they do to a flight."""

import numpy as np
import pytest
from plain_motion import moved
from pydrake.systems.analysis import Simulator
from scipy import stats
from short_flights import Scripted, short_scenario

from proxops.diagrams.flight.simulation import fly
from proxops.diagrams.logs import FlightLog, dense_positions
from proxops.systems import VelocityKicks

# Two kicks in a hundred seconds.
OFTEN = {"kicks": {"velocity_std_m_s": 4.0, "mean_interval_s": 50.0}}
BRIEF = {"arrival__deadline_s": 300.0, "arrival__dwell_s": 100.0}


def changes(kicks: VelocityKicks, steps: int, seed: int = 0) -> np.ndarray:
    """Changes of velocity (steps, 3) in m/s of successive control periods."""
    context = kicks.CreateDefaultContext()
    kicks.set_seed(context, seed)
    port = kicks.GetOutputPort("next_acceleration")
    found = []
    for step in range(steps):
        context.SetTime(kicks.period * step)
        found.append(kicks.period * port.Eval(context))
    return np.array(found)


def test_as_often_and_as_large_as_stated():
    found = changes(VelocityKicks(velocity_std=1.5, mean_interval=80.0), 8000)
    kicked = found.any(axis=1)
    assert stats.binomtest(int(kicked.sum()), 8000, 10.0 / 80.0).pvalue > 1e-3
    assert stats.kstest(found[kicked].ravel() / 1.5, "norm").pvalue > 1e-3
    # The time from one to the next has no memory.
    waits = np.diff(np.flatnonzero(kicked))
    assert waits.mean() == pytest.approx(8.0, abs=4.0 * 8.0 / np.sqrt(waits.size))
    assert waits.std() == pytest.approx(np.sqrt(8.0 * 7.0), rel=0.15)


def test_what_acts_is_held_between_control_steps():
    kicks = VelocityKicks(mean_interval=20.0, seed=2)
    simulator = Simulator(kicks)
    expected = changes(kicks, 20, 2) / 10.0
    assert expected.any(axis=1).sum() > 3
    for step in range(20):
        for time in (10.0 * step + 0.5, 10.0 * step + 9.5):
            simulator.AdvanceTo(time)
            acting = kicks.GetOutputPort("acceleration").Eval(simulator.get_context())
            assert acting == pytest.approx(expected[step], rel=1e-14, abs=0.0)


@pytest.fixture(scope="module")
def kicked() -> FlightLog:
    """Without thrust, kicked several times."""
    return fly(short_scenario(**OFTEN, **BRIEF), Scripted())


def test_velocity_changes_by_the_logged_kick(kicked: FlightLog):
    """Against the same fall without kicks, as far as gravity is the same: to first order."""
    free = fly(short_scenario(**BRIEF), Scripted()).dataset
    data = kicked.dataset
    first = int(np.flatnonzero(data["kick"].values.any(axis=1))[0])
    before = data["state"].values[first] - free["state"].values[first]
    assert np.array_equal(before, np.zeros(6))
    after = (data["state"].values - free["state"].values)[first + 1]
    change = 10.0 * data["kick"].values[first]
    assert np.abs(change).max() > 1.0
    assert after[3:] == pytest.approx(change, rel=5e-3, abs=2e-2)
    assert after[:3] == pytest.approx(5.0 * change, rel=5e-3, abs=0.1)
    assert "kick" not in free
    assert data["kick"].dims == ("time", "axis")
    assert data["kick"].attrs["units"] == "m/s^2"
    # A kick is no force of the thrusters.
    assert not data["force"].values.any()
    assert not data["disturbance"].values.any()


def test_path_between_rows_is_still_a_cubic(kicked: FlightLog):
    """So that clearances and events between rows stay right."""
    data = kicked.dataset
    assert (data["kick"].values.any(axis=1)).sum() >= 3
    times, states = data["time"].values, data["state"].values
    guessed = dense_positions(times, states)
    # Integrated between two rows, in steps of a second.
    field, spin = kicked.body.gravity_field, kicked.body.spin_rate
    for row in np.flatnonzero(data["kick"].values.any(axis=1))[:-1]:
        state, kick = states[row].copy(), data["kick"].values[row]
        for part in range(10):
            assert np.linalg.norm(guessed[10 * row + part] - state[:3]) < 2e-3
            state = moved(field, spin, state, kick, 1.0)
        assert state == pytest.approx(states[row + 1], abs=1e-5)
