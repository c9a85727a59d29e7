"""The navigation as a system, and step by step along flights that scipy integrates."""

import functools
from pathlib import Path

import numpy as np
import pytest
from navigated_flight import ATTITUDE, MASS, NOISE, PERIOD, Flight, flight, frame, navigation
from one_system import context_of
from pydrake.systems.analysis import Simulator
from scipy.spatial.transform import Rotation
from short_flights import BRIEF, kleopatra, on_lidar

from proxops.diagrams.flight import fly
from proxops.diagrams.logs import FlightLog
from proxops.systems import ExpectedErrors, LidarNavigation, NavigationPhase
from proxops.systems.lidar import DEFAULT_GEOMETRY
from proxops.systems.navigation import Estimate, MapError, ReturnUse
from proxops.systems.navigation.frame_model import FrameModel
from proxops.systems.navigation.motion import Motion, Push
from proxops.systems.navigation.navigator import Navigator, Step
from proxops.systems.shapes import displaced
from proxops.systems.vehicle import ThrusterErrors, thrust_given

ACQUIRING, FOLLOWING, LOST = NavigationPhase
NOTHING = Push.along_axes(np.zeros(3))


# --- step by step ---------------------------------------------------------------------------------


@functools.cache
def navigator(delay: int = 0) -> Navigator:
    body, expected = kleopatra(), ExpectedErrors()
    model = FrameModel(body.shape, DEFAULT_GEOMETRY, NOISE, MapError(body.shape))
    motion = Motion(body.gravity_field, body.shape.extents, body.spin_rate, MASS, expected)
    return Navigator(model, motion, expected, 30.0, PERIOD, delay)


def follow(flown: Flight, frames: np.ndarray, delay: int = 0) -> list[Step]:
    """All steps with these frames, the n-th of which arrives at the n-th time."""
    made, steps = navigator(delay), []
    memory = made.start()
    for k, (force, ranges) in enumerate(zip(flown.forces, frames, strict=True)):
        steps.append(made.step(memory, ranges, Push.along_axes(force), PERIOD * k))
        memory = steps[-1].memory
    return steps


def off(now: Estimate | None, state: np.ndarray) -> tuple[float, float, float]:
    """Errors of position in m, of velocity in m/s and of the attitude in degrees."""
    assert now is not None
    turn = Rotation.from_matrix(now.rotation) * ATTITUDE.inv()
    place, speed = now.state[:3] - state[:3], now.state[3:] - state[3:]
    return (
        float(np.linalg.norm(place)), float(np.linalg.norm(speed)),
        float(np.degrees(turn.magnitude())),
    )  # fmt: skip


def is_close(now: Estimate | None, state: np.ndarray) -> bool:
    place, speed, turn = off(now, state)
    return place < 20.0 and speed < 0.1 and turn < 0.02


def inside(now: Estimate | None, state: np.ndarray) -> bool:
    assert now is not None
    sigma = np.sqrt(np.diag(now.covariance)[:6])
    return bool((np.abs(now.state - state) < 6.0 * sigma).all())


def phases(steps: list[Step]) -> list[NavigationPhase]:
    return [step.memory.phase for step in steps]


def test_follows_from_the_first_frame() -> None:
    flown = flight()
    steps = follow(flown, flown.frames)
    assert set(phases(steps)) == {FOLLOWING}
    for step, state in zip(steps, flown.states, strict=True):
        assert inside(step.now, state)
    errors = np.array([off(s.now, y) for s, y in zip(steps[20:], flown.states[20:], strict=True)])
    assert (np.median(errors, axis=0) < [8.0, 0.03, 0.005]).all()
    # It knows the attitude of a degree to a thousandth after all.
    assert off(steps[0].now, flown.states[0])[2] < 0.1


def test_it_is_as_certain_as_it_is_good() -> None:
    """NEES of position and velocity in all steps of a flight, and the innovations."""
    flown = flight()
    steps = follow(flown, flown.frames)
    values = []
    for step, state in zip(steps[1:], flown.states[1:], strict=True):
        assert step.now is not None
        wrong = step.now.state - state
        values.append(wrong @ np.linalg.solve(step.now.covariance[:6, :6], wrong))
    # Errors of neighbouring steps are alike, so one flight says this much and no more.
    assert 2.0 < np.mean(values) < 14.0
    nis = [step.correction.nis for step in steps[1:] if step.correction]
    assert np.mean(nis) == pytest.approx(1.0, abs=0.1)


def test_what_is_too_little_for_the_thrusters_is_not_expected() -> None:
    """It moves as under what the thrusters of the true world would give."""
    flown, command = flight(), np.array([0.19, 0.21, -0.1])
    given = np.array(thrust_given(command.tolist(), ThrusterErrors(least_impulse=2.0), PERIOD, 0.0))
    begun = navigator().step(navigator().start(), flown.frames[0], NOTHING, 0.0).memory

    def state_after(force: np.ndarray, least_impulse: float) -> np.ndarray:
        system = navigation(ExpectedErrors(least_impulse_n_s=least_impulse))
        context = context_of(system, PERIOD, ranges=flown.frames[1], commanded_force=force)
        context.SetDiscreteState(system._packed(begun))
        return system.GetOutputPort("state").Eval(context)

    found, right, wrong = (
        state_after(*each) for each in ((command, 2.0), (given, 0.0), (command, 0.0))
    )
    np.testing.assert_array_equal(found, right)
    assert (found != wrong).any()


def test_five_minutes_without_frames() -> None:
    """They are predicted through: it goes on following, less and less certain."""
    flown = flight()
    frames = flown.frames.copy()
    frames[30:60] = np.inf
    steps = follow(flown, frames)
    assert set(phases(steps)) == {FOLLOWING}
    assert all(step.correction is None for step in steps[30:60])
    for step, state in zip(steps[30:], flown.states[30:], strict=True):
        assert inside(step.now, state)
    place, speed, _ = off(steps[59].now, flown.states[59])
    assert place < 60.0
    assert speed < 0.2
    sigma = [np.sqrt(np.trace(s.now.covariance[:3, :3])) for s in steps[29:61] if s.now]
    assert sigma[30] > 1.3 * sigma[0]
    assert sigma[31] < sigma[30]
    assert is_close(steps[-1].now, flown.states[-1])


def test_late_frames_of_known_age() -> None:
    flown = flight()
    late = np.vstack([np.full((1, flown.frames.shape[1]), np.inf), flown.frames[:-1]])
    steps = follow(flown, late, delay=1)
    assert phases(steps)[:3] == [ACQUIRING, FOLLOWING, FOLLOWING]
    for step, state in zip(steps[30:], flown.states[30:], strict=True):
        assert is_close(step.now, state)
        assert inside(step.now, state)
    # Not told, it is where it was a step ago.
    untold = follow(flown, late)
    assert off(untold[-1].now, flown.states[-1])[0] > 50.0


def test_false_returns_and_dropout() -> None:
    flown, rng = flight(), np.random.default_rng(4)
    frames = flown.frames.copy()
    frames[rng.uniform(size=frames.shape) < 0.1] = np.inf
    false = rng.uniform(0.0, DEFAULT_GEOMETRY.max_range, frames.shape)
    false[rng.uniform(size=frames.shape) >= 0.2] = np.inf
    steps = follow(flown, np.minimum(frames, false))
    assert phases(steps)[2:] == [FOLLOWING] * 68
    # Not once does it take false returns for true ones, although it knows little at first.
    for step, state in zip(steps, flown.states, strict=True):
        assert step.now is None or inside(step.now, state)
    assert is_close(steps[30].now, flown.states[30])
    assert is_close(steps[-1].now, flown.states[-1])
    rejected = [step.correction.rejected for step in steps[30:] if step.correction]
    assert np.mean(rejected) > 4.0


ELSEWHERE = np.array([-120e3, 60e3, 90e3])


@pytest.mark.parametrize("wrong", [2, 6])
def test_frames_from_somewhere_else(wrong: int) -> None:
    """One or two are not used. More are believed, or it is lost; then it is found again."""
    flown = flight()
    frames = flown.frames.copy()
    for k in range(40, 40 + wrong):
        frames[k] = frame(ELSEWHERE, k)
    steps = follow(flown, frames)
    for step, state in zip(steps[40 : 40 + min(wrong, 2)], flown.states[40:], strict=False):
        assert step.memory.phase == FOLLOWING
        assert step.correction is None
        assert is_close(step.now, state)
    for step in steps[42 : 40 + wrong]:
        there = step.now is not None and np.linalg.norm(step.now.state[:3] - ELSEWHERE) < 100.0
        assert step.memory.phase == LOST or there
    assert is_close(steps[-1].now, flown.states[-1])
    assert phases(steps)[-10:] == [FOLLOWING] * 10


def test_lost_says_nothing_and_finds_itself() -> None:
    """Frames that fit no pose: of random returns, for a minute."""
    flown, rng = flight(), np.random.default_rng(8)
    frames = flown.frames.copy()
    size = frames[40:46].shape
    frames[40:46] = DEFAULT_GEOMETRY.max_range * rng.uniform(size=size)
    steps = follow(flown, frames)
    assert phases(steps)[40:46] == [FOLLOWING] * 2 + [LOST] * 4
    assert all(step.now is None for step in steps[42:46])
    # It was right all the time, so that the next frame fits.
    assert phases(steps)[46:] == [FOLLOWING] * 24
    assert is_close(steps[46].now, flown.states[46])


def test_a_map_that_is_wrong_as_told() -> None:
    """The error of the map is the same from frame to frame, and the covariance knows it."""
    flown, body, rms = flight(), kleopatra(), 400.0
    true = displaced(body.shape, rms, 15e3, 5)
    expected = ExpectedErrors(surface_rms_m=rms)
    model = FrameModel(body.shape, DEFAULT_GEOMETRY, NOISE, MapError(body.shape, rms, 15e3))
    motion = Motion(body.gravity_field, body.shape.extents, body.spin_rate, MASS, expected)
    made = Navigator(model, motion, expected, 30.0, PERIOD, 0)
    memory, sigma = made.start(), np.inf
    for k, state in enumerate(flown.states[:40]):
        ranges = frame(state[:3], 500 + k, body=true)
        step = made.step(memory, ranges, Push.along_axes(flown.forces[k]), PERIOD * k)
        memory = step.memory
        assert memory.phase == FOLLOWING
        assert inside(step.now, state)
        assert step.now is not None
        sigma = float(np.sqrt(np.trace(step.now.covariance[:3, :3])))
    # As many frames of noise alone would leave a hundredth of this.
    assert 0.2 * rms < sigma < 5.0 * rms


# --- the system -----------------------------------------------------------------------------------


def seen(system: LidarNavigation, context) -> dict[str, np.ndarray]:
    names = ("state", "attitude", "covariance", "record")
    return {name: system.GetOutputPort(name).Eval(context).copy() for name in names}


def test_false_returns_are_rejected_and_others_used() -> None:
    """A return that is twice as far as the surface is false."""
    system, flown = navigation(), flight()
    memory = system._navigator.step(system._navigator.start(), flown.frames[0], NOTHING, 0.0).memory
    ranges = flown.frames[1].copy()
    returned = np.flatnonzero(np.isfinite(ranges))
    false = returned[::7]
    ranges[false] *= 2.0
    context = context_of(system, PERIOD, ranges=ranges, commanded_force=flown.forces[1])
    context.SetDiscreteState(system._packed(memory))
    found = system.GetOutputPort("return_use").Eval(context)
    record = system.GetOutputPort("record").Eval(context)
    used, rejected = (np.flatnonzero(found == use) for use in (ReturnUse.USED, ReturnUse.REJECTED))
    assert set(rejected) <= set(false)
    assert rejected.size > 0.5 * false.size
    assert set(used) <= set(returned) - set(false)
    assert used.size > 0.5 * returned.size
    assert (used.size, rejected.size) == (record[1], record[2])


def through_ports(system: LidarNavigation, flown: Flight, count: int) -> list[dict]:
    """What the system gives with these frames, as Drake updates it."""
    first = context_of(system, ranges=flown.frames[0], commanded_force=flown.forces[0])
    simulator = Simulator(system, first)
    context, found = simulator.get_mutable_context(), []
    simulator.Initialize()
    for k in range(1, count):
        simulator.AdvanceTo(PERIOD * k - 1.0)
        system.GetInputPort("ranges").FixValue(context, flown.frames[k])
        system.GetInputPort("commanded_force").FixValue(context, flown.forces[k])
        simulator.AdvanceTo(PERIOD * k)
        found.append(seen(system, context))
    return found


@pytest.mark.parametrize("delay", [0, 2])
def test_the_system_is_the_navigator(delay: int) -> None:
    """What it remembers goes through the Context, and nothing is lost on the way."""
    flown, system = flight(), navigation(delay=delay)
    frames = np.vstack([np.full((delay, 4320), np.inf), flown.frames])[: len(flown.frames)]
    late = flown._replace(frames=frames)
    found = through_ports(system, late, 12)
    memory = system._navigator.start()
    for k in range(12):
        push = Push.along_axes(flown.forces[k])
        step = system._navigator.step(memory, frames[k], push, PERIOD * k)
        memory = step.memory
        if k and step.now is not None:
            np.testing.assert_array_equal(found[k - 1]["state"], step.now.state)
            np.testing.assert_array_equal(
                found[k - 1]["covariance"], step.now.covariance[:9, :9].ravel()
            )
            assert found[k - 1]["record"][4] == step.memory.phase
    assert memory.estimate is not None


# --- in a flight ----------------------------------------------------------------------------------


def test_the_log_says_what_became_of_each_return(tmp_path: Path) -> None:
    """The counts were recorded by themselves."""
    changes = {"truth__lidar__false_returns": 0.1, "mpc__solve_delay_s": 3.0}
    changes |= {"truth__attitude__constant_deg": np.degrees(ATTITUDE.as_rotvec()).tolist()}
    data = fly(on_lidar(**BRIEF, **changes), body=kleopatra()).dataset
    use = data["navigation_return_use"].values
    rows = slice(0, -1)  # The flight may end between two steps.
    for kind, name in ((ReturnUse.USED, "returns"), (ReturnUse.REJECTED, "rejected")):
        recorded = data[f"navigation_{name}"].values[rows]
        np.testing.assert_array_equal((use == kind).sum(axis=(1, 2))[rows], recorded)
    assert not use[~np.isfinite(data["ranges"].values)].any()
    assert (use == ReturnUse.USED).sum() > 100
    path = tmp_path / "flight.nc"
    FlightLog(data, kleopatra()).to_netcdf(path)
    kept = FlightLog.load(path).dataset["navigation_return_use"]
    np.testing.assert_array_equal(kept, use)
    assert kept.attrs["flag_meanings"] == "not_used used rejected"
