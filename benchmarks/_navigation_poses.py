"""Steps of the navigation without a flight around them: acquisition at poses, and times."""

import time
from dataclasses import dataclass

import numpy as np
from _navigation_flights import random_turn
from scipy.spatial.transform import Rotation

from proxops.diagrams.flight import fly, make_navigation
from proxops.diagrams.scenario import (
    Body,
    Scenario,
    believed,
    filter_tuning,
    load_body,
    load_scenario,
    parse_scenario,
)
from proxops.systems import Lidar, LidarErrors, LidarNavigation, NavigationPhase
from proxops.systems.common import generator

RIGHT, ACQUIRING, WRONG = "right", "acquiring", "wrong"
# A pose is right if its position is within this share of the body's size.
CLOSE = 0.01
FRAMES = 3
# Of this process, so that on a machine that does other things too the figures stand.
CLOCK = time.process_time
# The edge of the cube of poses over that of the transits.
WIDER = 1.15


@dataclass(frozen=True)
class Poses:
    """Some poses of a seed at one body, as text, so that they can be sent to any worker."""

    name: str
    scenario: str
    """YAML of the whole scenario."""
    seed: int
    first: int
    count: int


@dataclass(frozen=True)
class Found:
    """What the navigation found at a pose."""

    index: int
    outcome: str
    position: np.ndarray
    """True position (3,) in m in K."""
    error: float
    """Of the position, over the body's size; NaN if there is none."""
    frames: int
    """Number of frames used."""
    first_s: float
    """Processor time of the first frame's step, in s."""


def pose(scenario: Scenario, body: Body, seed: int, index: int) -> tuple[np.ndarray, np.ndarray]:
    """A position (3,) in m, uniform in the cube outside the body, and R_KS as (w, x, y, z)."""
    random = generator(seed, index)
    half = 0.5 * WIDER * scenario.transit.cube_m
    while True:
        position = random.uniform(-half, half, 3)
        if not body.gravity_field.evaluate(position[None]).inside[0]:
            turn = np.radians(random_turn(seed, index))
            return position, Rotation.from_rotvec(turn).as_quat(scalar_first=True)


def acquire_poses(poses: Poses) -> list[Found]:
    """Acquires each pose from nothing, at rest in K; it ends when the navigation follows."""
    scenario = parse_scenario(poses.scenario)
    body = load_body(scenario.body)
    navigation = make_navigation(scenario, body, filter_tuning(scenario, body))
    geometry = navigation.model.geometry
    period, size = scenario.control_period_s, float(body.shape.extents.max())
    lidar = Lidar(body.shape, LidarErrors(scenario.lidar.noise_std_m), geometry, period)
    times, found = period * np.arange(FRAMES), []
    for index in range(poses.first, poses.first + poses.count):
        position, attitude = pose(scenario, body, poses.seed, index)
        # Noise depends on the time.
        frames = lidar.frames(
            times + index * FRAMES * period,
            np.tile(position, (FRAMES, 1)),
            poses.seed,
            np.tile(attitude, (FRAMES, 1)),
        )
        outcome, error, spans = ACQUIRING, np.nan, []
        for state, phase, span in _steps(navigation, frames, np.zeros((FRAMES, 3)), period):
            spans.append(span)
            if phase == NavigationPhase.FOLLOWING:
                error = float(np.linalg.norm(state[:3] - position)) / size
                outcome = RIGHT if error < CLOSE else WRONG
                break
        found.append(Found(index, outcome, position, error, len(spans), spans[0]))
    return found


def following_times(own: dict[str, str], index: int, seed: int) -> np.ndarray:
    """Processor times (N,) in s of the steps of a flight at which the navigation followed.

    The MPC flies the default scenario with `own` changes. The flight's frames and commands are
    given again to a navigation of its own, twice: the first time it may compile.
    """
    changes = {"transit.seed": seed, "transit.index": index, **own}
    log = fly(load_scenario(None, changes))
    frames = log.dataset["ranges"].values[:-1]
    commands = (log.dataset["force"] - log.dataset["disturbance"]).values[:-1]
    told = np.vstack([np.zeros(3), commands[:-1]])
    period, spans = log.scenario.control_period_s, []
    body = log.body.with_gravity(log.scenario.gravity)
    own = believed(log.scenario)
    navigation = make_navigation(own, body, filter_tuning(own, body))
    for _ in range(2):
        steps = list(_steps(navigation, frames, told, period))
        before = NavigationPhase.ACQUIRING
        spans = []
        for _, phase, span in steps:
            if before == phase == NavigationPhase.FOLLOWING:
                spans.append(span)
            before = phase
    return np.array(spans)


def _steps(navigation: LidarNavigation, frames: np.ndarray, forces: np.ndarray, period: float):
    """Gives state (6,), phase and processor time in s of each step of a navigation from its start.

    Args:
      navigation: in no diagram. frames: (N, planes, rays). forces: (N, 3) in N in S.
      period: of the steps in s.
    """
    context = navigation.CreateDefaultContext()
    ports = [navigation.GetInputPort(name) for name in ("ranges", "commanded_force")]
    state, record = (navigation.GetOutputPort(name) for name in ("state", "record"))
    for k, (frame, force) in enumerate(zip(frames, forces, strict=True)):
        context.SetTime(k * period)
        for port, value in zip(ports, (frame.ravel(), force), strict=True):
            port.FixValue(context, value)
        started = CLOCK()
        now = state.Eval(context)
        span = CLOCK() - started
        yield now, int(record.Eval(context)[4]), span
        memory = navigation.EvalUniquePeriodicDiscreteUpdate(context)
        context.get_mutable_discrete_state().SetFrom(memory)
