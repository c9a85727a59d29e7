"""Flights in which the expert's command takes effect late: planned for, logged, repeatable."""

from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from plain_motion import moved
from short_flights import kleopatra, short_scenario

from proxops.diagrams.flight import fly, make_simulator, make_transit_diagram
from proxops.diagrams.logs.flight_log import FlightLog
from proxops.diagrams.scenario.scenario import load_scenario
from proxops.systems import DelayedHold, InputError, ModelPredictiveController

SPIN = 2.0 * np.pi / (5.38528 * 3600.0)
DELAYS = [2.0, 10.0]


@cache
def delayed_flight(delay: float) -> FlightLog:
    near = {"transit__start_m": [160e3, 6.8e3, 0.0], "log_ranges": False}
    return fly(short_scenario(mpc__solve_delay_s=delay, arrival__dwell_s=100.0, **near))


@cache
def long_transit(index: int, delay: float) -> dict[str, Any]:
    """The summary of a transit of the default scenario."""
    return fly(load_scenario(None, {"transit.index": index, "mpc.solve_delay_s": delay})).summary


def applied_pieces(log: FlightLog, delay: float) -> list[tuple[float, float, np.ndarray]]:
    """(from, to, force) as the log's documentation has it, cut at every row and at the end."""
    times, forces = log.dataset["time"].values, log.dataset["force"].values
    cuts = np.unique(np.concatenate([times, times + delay]))
    cuts = cuts[cuts <= times[-1]]
    pieces = []
    for start, end in pairwise(cuts):
        row = np.searchsorted(times + delay, 0.5 * (start + end)) - 1
        pieces.append((start, end, forces[row] if row >= 0 else np.zeros(3)))
    return pieces


@pytest.mark.slow
@pytest.mark.parametrize("delay", DELAYS)
def test_a_long_transit_arrives(delay: float) -> None:
    """Blocked by the body; at no more than 1 % more than without a delay."""
    flown = [long_transit(1, seconds) for seconds in (0.0, delay)]
    assert flown[1]["success"]
    assert flown[1]["terminal_position_error_m"] <= 10.0
    assert flown[1]["delta_v_m_s"] <= 1.01 * flown[0]["delta_v_m_s"]


@pytest.mark.parametrize("delay", DELAYS)
def test_logged_forces_give_the_states(delay: float) -> None:
    """Row k's force acts from `force_delay_s` after its time on: integrated by SciPy."""
    log = delayed_flight(delay)
    assert log.dataset.attrs["force_delay_s"] == delay
    times, states = log.dataset["time"].values, log.dataset["state"].values
    state = states[0]
    for start, end, force in applied_pieces(log, delay):
        state = moved(kleopatra().gravity_field, SPIN, state, force / 100.0, end - start)
        row = np.flatnonzero(times == end)
        if row.size:
            error = state - states[row[0]]
            assert np.linalg.norm(error[:3]) < 0.1, end
            assert np.linalg.norm(error[3:]) < 1e-3, end


@pytest.mark.parametrize("delay", DELAYS)
def test_delta_v_is_that_of_what_acted(delay: float) -> None:
    log = delayed_flight(delay)
    arrival = log.summary["arrival_time_s"]
    before = after = 0.0
    for start, end, force in applied_pieces(log, delay):
        split = min(max(arrival, start), end)
        before += np.abs(force).sum() / 100.0 * (split - start)
        after += np.abs(force).sum() / 100.0 * (end - split)
    assert log.summary["delta_v_m_s"] == pytest.approx(before, rel=1e-12)
    assert log.summary["hold_delta_v_m_s"] == pytest.approx(after, rel=1e-12)


@pytest.mark.parametrize("delay", DELAYS)
def test_plans_begin_where_the_flight_is_by_then(delay: float) -> None:
    """Without the prediction they would begin up to some 100 m off."""
    scenario = short_scenario(mpc__solve_delay_s=delay)
    diagram = make_transit_diagram(scenario, body=kleopatra())
    simulator = make_simulator(diagram, scenario)
    controller = diagram.GetSubsystemByName("controller")
    craft, hold = diagram.GetSubsystemByName("spacecraft"), diagram.GetSubsystemByName("hold")
    assert isinstance(hold, DelayedHold)

    def now(system, port: str):
        context = system.GetMyContextFromRoot(simulator.get_context())
        return system.GetOutputPort(port).Eval(context)

    moved = []
    for step in range(1, 60, 2):
        simulator.AdvanceTo(10.0 * step)  # Updates at this time are yet to come.
        plan, state = now(controller, "plan"), now(craft, "state")
        simulator.AdvanceTo(10.0 * step + delay)
        then = now(craft, "state")
        assert plan.states[0, :3] == pytest.approx(then[:3], abs=0.01)
        assert plan.states[0, 3:] == pytest.approx(then[3:], abs=1e-3)
        moved.append(np.linalg.norm(then[:3] - state[:3]))
        simulator.AdvanceTo(10.0 * step + delay + 1e-3)
        assert now(hold, "y").tolist() == np.clip(plan.forces[0], -7.0, 7.0).tolist()
    assert max(moved) > 8.0 * delay


@pytest.mark.parametrize(
    ("delay", "complaint"),
    [
        (-1.0, "must not be negative"),
        (10.5, "must be from 0 to control_period_s"),
    ],
)
def test_senseless_delay_refused(delay: float, complaint: str) -> None:
    with pytest.raises(InputError, match=f"mpc.solve_delay_s {complaint}"):
        load_scenario(None, {"mpc.solve_delay_s": delay})
    program = make_transit_diagram(short_scenario()).GetSubsystemByName("controller")
    assert isinstance(program, ModelPredictiveController)
    with pytest.raises(InputError, match="delay must be from 0 to its period"):
        ModelPredictiveController(program.program, 10.0, delay=delay)
