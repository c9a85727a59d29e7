"""The mission over a plane: phases, checks, aborts; and that an abort stops as high as it says."""

import numpy as np
import pytest
from even_field import EvenField
from scipy.integrate import solve_ivp

from proxops.systems.gravity import PointMassField
from proxops.systems.hybrid import AgreementGate
from proxops.systems.rotation import SteadySpin
from proxops.systems.touch.descent import DescentGuidance, Site, TouchPhase
from proxops.systems.touch.descent_policy import DescentPolicy
from proxops.systems.touch.mission import (
    AbortReason,
    AwayConfig,
    DescentPilot,
    Memory,
    Mission,
    Seen,
    stopping_distance,
)
from proxops.systems.touch.touch_controller import TouchController, _packed, _unpacked

UP, PULL, MASS, THRUST, PERIOD = np.array([0.0, 0.0, 1.0]), 5e-5, 1400.0, 6.0, 4.0
SURE = np.diag([0.1, 0.1, 0.1, 0.002, 0.002, 0.002]) ** 2


def guidance() -> DescentGuidance:
    """To the ground z = 0, which does not turn."""
    field, spin = EvenField([0.0, 0.0, -PULL]), SteadySpin(np.zeros(3))
    return DescentGuidance(field, spin, MASS, THRUST, Site(np.zeros(3), UP))


def mission(tries: int = 1, pilot: DescentPilot | None = None) -> Mission:
    return Mission(guidance(), PERIOD, tries, pilot=pilot)


def moved(state: np.ndarray, force: np.ndarray, step: float = PERIOD) -> np.ndarray:
    push = force / MASS - PULL * UP
    return np.r_[state[:3] + step * state[3:] + 0.5 * step**2 * push, state[3:] + step * push]


def seen(time: float, state: np.ndarray) -> Seen:
    return Seen(time, state, SURE, frame=True, head=0.0, failed=False)


class Flown:
    """A flight on the true state that the ground touches at height 0, and throws up again."""

    def __init__(self, made: Mission, changes=lambda time, phase: {}, latest: float = 2400.0):
        self.phases, self.memory, self.lowest = [TouchPhase.HOME], Memory(), np.inf
        self.steps: list[tuple[TouchPhase, bool]] = []
        self.back = 0.0
        """Velocity change in m/s of the way home after the touch."""
        state, time = np.r_[15.0, 0.0, 125.0, np.zeros(3)], 0.0
        head = 0.0
        while time < latest:
            extra = {"head": head, **changes(time, self.memory.phase)}
            step = made.step(self.memory, seen(time, state)._replace(**extra))
            self.memory, self.step = step.memory, step
            self.steps.append((self.memory.phase, step.by_policy))
            if self.memory.touched and self.memory.phase is TouchPhase.HOME:
                self.back += PERIOD * float(np.linalg.norm(step.force)) / MASS
            if self.memory.phase is not self.phases[-1]:
                self.phases.append(self.memory.phase)
            state, time, head = moved(state, step.force), time + PERIOD, 0.0
            if state[2] <= 0.0 and state[5] < 0.0:
                state, head = np.r_[state[:2], 0.0, state[3:5], 0.07], 100.0
            self.lowest = min(self.lowest, state[2])
        self.state = state


def test_down_and_home_again() -> None:
    flown = Flown(mission())
    assert flown.phases == [0, 1, 2, 3, 4, 5, 6, 0]
    assert flown.memory.touched
    np.testing.assert_allclose(flown.state[:3], [0.0, 0.0, 125.0], atol=0.3)
    np.testing.assert_allclose(flown.state[3:], 0.0, atol=0.003)
    np.testing.assert_allclose(flown.step.target, np.r_[0.0, 0.0, 125.0, np.zeros(3)])
    # It brakes from 40 cm/s once, and hovers for the rest of the time.
    hovering = PULL * PERIOD * sum(phase is TouchPhase.HOME for phase, _ in flown.steps)
    assert 0.4 < flown.back < 1.05 * 0.4 + hovering


class Learned(DescentPolicy):
    """The program with an error in N along x, in place of a network."""

    def __init__(self, error: float):
        self.program, self.error, self.asked = guidance(), error, 0

    def force(self, elapsed: float, state: np.ndarray, begun: float = 0.0) -> np.ndarray:
        self.asked += 1
        return self.program.force(elapsed, state, begun) + [self.error, 0.0, 0.0]


@pytest.mark.parametrize(
    ("gate", "error", "share"), [(None, 0.01, 1.0), (0.02, 0.01, 0.8), (0.02, 0.03, 0.0)]
)
def test_a_policy_flies_while_it_agrees(gate: float | None, error: float, share: float) -> None:
    """Checked at each fifth step, when the program's force acts."""
    policy = Learned(error)
    compared = None if gate is None else AgreementGate(magnitude=gate, angle=0.0, dead_band=0.0)
    flown = Flown(mission(pilot=DescentPilot(policy, compared, 5)))
    legs = [by for phase, by in flown.steps if TouchPhase.HOME < phase < TouchPhase.TERMINAL]
    assert flown.phases == [0, 1, 2, 3, 4, 5, 6, 0]
    assert np.mean(legs) == pytest.approx(share, abs=0.01)
    assert sum(by for _, by in flown.steps) == sum(legs)
    assert policy.asked == pytest.approx(len(legs) * (0.2 if share == 0.0 else 1.0), abs=2)


def test_a_transit_ends_at_home_and_not_before_it_is_slow() -> None:
    made, memory = mission(), Memory(TouchPhase.TRANSIT)
    home = made.guidance.target(TouchPhase.HOME)
    for off, speed, phase in ((200.0, 0.0, -1), (10.0, 0.5, -1), (10.0, 0.1, 1)):
        state = home + np.r_[off, 0.0, 0.0, 0.0, speed, 0.0]
        step = made.step(memory, seen(0.0, state))
        assert step.memory.phase == phase
        assert step.force.any() == (phase == 1)
        np.testing.assert_array_equal(step.target, made.guidance.target(TouchPhase(max(phase, 0))))
    unknown = made.step(memory, seen(0.0, np.full(6, np.nan)))
    assert unknown.memory.phase is TouchPhase.TRANSIT
    lost = made.step(memory, seen(100.0, home)._replace(frame=False))
    assert lost.memory.phase is TouchPhase.HOME  # It begins no descent without frames.


def test_the_transit_s_controller_is_heard_until_home_is_reached() -> None:
    controller = TouchController(mission(), rays=3, transit=True)
    context = controller.CreateDefaultContext()

    def at(state: np.ndarray) -> tuple[np.ndarray, float]:
        values = {"state": state, "covariance": np.zeros(81), "ranges": np.ones(3)}
        values |= {"head_force": [0.0], "transit_force": [1.0, 2.0, 3.0]}
        for name, value in values.items():
            controller.GetInputPort(name).FixValue(context, value)
        force = controller.GetOutputPort("force").Eval(context)
        flag = controller.GetOutputPort("in_transit").Eval(context)[0]
        update = controller.EvalUniquePeriodicDiscreteUpdate(context)
        context.get_mutable_discrete_state().SetFrom(update)
        return force, flag

    home = np.r_[0.0, 0.0, 125.0, np.zeros(3)]
    force, flag = at(home + np.r_[300.0, np.zeros(5)])
    assert flag == 1.0
    np.testing.assert_array_equal(force, [1.0, 2.0, 3.0])
    force, flag = at(home + np.r_[10.0, np.zeros(5)])
    assert flag == 1.0  # Up to this step.
    assert force.any()
    assert np.abs(force).max() < 1.0
    _, flag = at(home)
    assert flag == 0.0


@pytest.mark.parametrize("since", [600.0, 1348.0])
def test_a_failed_thruster_leads_home_from_any_height(since: float) -> None:
    flown = Flown(mission(tries=3), lambda time, phase: {"failed": time >= since})
    assert flown.memory.reason is AbortReason.THRUSTER
    assert flown.memory.tries == 1  # It does not try again with a thruster less.
    assert flown.lowest > 0.0
    assert flown.state[2] == pytest.approx(125.0, abs=0.3)


def test_it_tries_again_when_frames_come_back() -> None:
    flown = Flown(mission(2), lambda time, phase: {"frame": not 300.0 < time < 360.0}, 3600.0)
    assert flown.memory.reason is AbortReason.FRAMES
    assert flown.memory.tries == 2
    assert flown.memory.touched
    assert flown.phases.count(TouchPhase.AWAY) == 2


def test_what_it_does_not_know_it_reckons() -> None:
    """Without a state from the terminal phase on it comes away all the same."""
    nothing = np.full(6, np.nan)
    flown = Flown(
        mission(), lambda time, phase: {"state": nothing} if phase >= TouchPhase.TERMINAL else {}
    )
    assert flown.memory.reason is AbortReason.NAVIGATION
    assert flown.lowest > 0.0
    assert flown.state[2] == pytest.approx(125.0, abs=1.0)


@pytest.mark.parametrize(
    ("state", "changes", "reason"),
    [
        ([30.0, 0, 60, 0, 0, -0.1], {}, AbortReason.CORRIDOR),
        ([0.0, 0, 60, 0, 0, -0.7], {}, AbortReason.SPEED),
        ([0.0, 0, 70, 0, 0, -0.1], {"covariance": 9.0 * np.eye(6)}, AbortReason.NAVIGATION),
        ([0.0, 0, 60, 0, 0, -0.1], {}, AbortReason.NONE),
        ([0.0, 0, 60, 0, 0, -0.1], {"time": 852.0}, AbortReason.NONE),
        ([6.0, 0, 55, 0, 0, -0.1], {"time": 852.0}, AbortReason.GATE),
        ([0.0, 0, 55, 0.05, 0, -0.1], {"time": 852.0}, AbortReason.GATE),
    ],
)
def test_checks(state: list[float], changes: dict, reason: AbortReason) -> None:
    memory = Memory(TouchPhase.MATCHPOINT, tries=1, frame=800.0, known=True)
    step = mission().step(memory, seen(800.0, np.array(state))._replace(**changes))
    assert step.memory.reason is reason
    if reason is AbortReason.NONE:
        late = changes.get("time", 800.0) > 850.0
        assert step.memory.phase is (TouchPhase.GROUND if late else TouchPhase.MATCHPOINT)
    else:
        assert step.memory.phase is TouchPhase.AWAY
        assert step.force[2] > 0.0


def test_it_waits_at_home_until_it_is_sure() -> None:
    """The velocity is known well enough from the fourth step on."""
    vague = np.diag(np.r_[np.full(3, 0.1), np.full(3, 0.03)]) ** 2
    flown = Flown(
        mission(), lambda time, phase: {"covariance": vague} if time < 16.0 else {}, latest=17.0
    )
    assert flown.memory.begun == 16.0


def test_the_stopping_distance_is_that_of_an_integration() -> None:
    down, pull, braking, delay = 0.13, 5e-5, 0.004, 4.0

    def rates(time: float, y: np.ndarray) -> list[float]:
        return [y[1], pull if time < delay else -braking]

    def stopped(time: float, y: np.ndarray) -> float:
        return y[1] if time > delay else 1.0

    end = solve_ivp(rates, (0.0, 100.0), [0.0, down], events=stopped, max_step=0.1, rtol=1e-9)
    rest = end.y_events[0][0, 0]
    assert stopping_distance(down, pull, braking, delay) == pytest.approx(rest, rel=1e-3)
    assert stopping_distance(-0.1, pull, braking, delay) == 0.0


@pytest.mark.parametrize("seed", range(8))
def test_an_abort_stops_no_lower_than_promised(seed: int) -> None:
    """Of a state within four deviations of what is known, with 10 % less thrust."""
    random, made = np.random.default_rng(seed), mission()
    known = np.r_[random.uniform(-1, 1, 2), random.uniform(2, 60), random.uniform(-0.02, 0.02, 2),
                  random.uniform(-0.2, 0.0)]  # fmt: skip
    promised = made.stopping(known, SURE)
    state = known + 4.0 * np.sqrt(np.diag(SURE)) * [0, 0, -1, 0, 0, -1]
    state, lowest = moved(state, np.zeros(3)), np.inf
    for k in range(60):
        shown = state.copy()
        force = 0.9 * made.guidance.steady_force(
            k * PERIOD, shown, np.array([0.0, 0.0, made.away.speed_m_s])
        )
        for _ in range(40):
            state = moved(state, force, PERIOD / 40.0)
            lowest = min(lowest, state[2])
    assert lowest > promised - 1e-3


def test_the_memory_is_kept_whole() -> None:
    kept = Memory(TouchPhase.AWAY, AbortReason.LATE, 2, True, 1.5, 2.5, True, np.arange(6.0), 3.5)
    again = _unpacked(_packed(kept))
    np.testing.assert_array_equal(again.state, kept.state)
    assert again._replace(state=0) == kept._replace(state=0)
    assert type(again.phase) is TouchPhase


@pytest.mark.parametrize("latitude", [0.0, 40.0, 90.0])
def test_it_parks_in_an_orbit_that_stays(latitude: float) -> None:
    """From rest at home on a body that turns; a free flight in N afterwards, by DOP853."""
    rate, radius, gm = 4e-4, 600.0, 5.0
    up = np.array([np.cos(np.radians(latitude)), 0.0, np.sin(np.radians(latitude))])
    field, spin = PointMassField(gm / 6.6743e-11), SteadySpin([0.0, 0.0, rate])
    made = Mission(
        DescentGuidance(field, spin, MASS, THRUST, Site(250.0 * up, up)),
        PERIOD,
        away=AwayConfig(park_m=radius),
    )
    state = np.r_[375.0 * up, np.zeros(3)]
    step = made.step(Memory(touched=True), seen(0.0, state))
    for time in np.arange(0.0, 4000.0, PERIOD):
        step = made.step(step.memory, seen(time, state))
        fine = 0.1
        for _ in range(round(PERIOD / fine)):
            push = made.guidance.natural_acceleration(state, time) + step.force / MASS
            state = np.r_[state[:3] + fine * state[3:], state[3:] + fine * push]
    assert step.memory.phase is TouchPhase.PARK
    assert not step.force.any()
    np.testing.assert_allclose(step.target[:3], state[:3], atol=1.0)
    inertial = state[3:] + np.cross([0.0, 0.0, rate], state[:3])
    free = solve_ivp(
        lambda _, y: np.r_[y[3:], -gm * y[:3] / np.linalg.norm(y[:3]) ** 3],
        (0.0, 1e5), np.r_[state[:3], inertial], "DOP853", rtol=1e-10, atol=1e-6,
    )  # fmt: skip
    far = np.linalg.norm(free.y[:3], axis=0)
    assert 0.8 * radius < far.min() < far.max() < 1.3 * radius
    # At least 60 degrees to the equator.
    momentum = np.cross(state[:3], inertial)
    assert abs(momentum[2]) < 0.55 * np.linalg.norm(momentum)


def test_it_does_not_park_while_a_descent_is_left() -> None:
    made = mission(tries=2)
    made.away.park_m = 600.0
    home = made.guidance.target(TouchPhase.HOME)
    unsure = seen(0.0, home)._replace(covariance=np.eye(6))
    for tries, phase in ((1, TouchPhase.HOME), (2, TouchPhase.PARK)):
        assert made.step(Memory(tries=tries), unsure).memory.phase is phase
