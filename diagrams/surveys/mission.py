"""`run_mission`: a survey, and then a transit or touch-and-go that begins where it ends."""

from __future__ import annotations

import copy
import dataclasses as dc
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from proxops.diagrams.flight import fly
from proxops.diagrams.logs import FlightLog, with_survey
from proxops.diagrams.scenario import (
    Body,
    MissionConfig,
    PointMassConfig,
    RigidBodyConfig,
    Scenario,
    TouchAndGoConfig,
    check_arm,
    draw_transit,
    dump_changes,
    load_body,
    load_scenario,
)
from proxops.diagrams.surveys.survey_files import Surveyed, true_attitude, write_text
from proxops.diagrams.surveys.survey_flight import around_of
from proxops.diagrams.surveys.survey_run import run_survey
from proxops.systems.common import InputError, Progress, part_of, silent
from proxops.systems.mapping import HIGHEST
from proxops.systems.vehicle import STANDARD_GRAVITY, SunlightConfig, sun_direction

# Of the whole, what the survey takes.
_SURVEY = 0.7


class MissionFlown(NamedTuple):
    """What a mission gave."""

    surveyed: Surveyed
    log: FlightLog
    """Of all: the survey, the transit, and the touch and the way home, if any."""


def run_mission(
    scenario: Scenario,
    body: Body,
    folder: Path,
    controller: str = "hybrid",
    progress: Progress = silent,
) -> MissionFlown:
    """Flies a mission: what the survey found is all that the flight after it knows.

    A survey's flight that the folder has already, of the same scenario, is not flown again.

    Args:
      scenario: with a mission as its task. body: as believed; of its mesh, only the extents count.
      folder: takes the survey's files, and `flight.yaml`, the scenario of the flight after it.
      controller: flies the transit; see `named_controller`.
      progress: is called with the share done.

    Raises:
      InputError: the survey cannot be flown or saw too little; no place of its map can be touched,
        or flown to; or the folder cannot be written.
    """
    surveyed, after = begin_mission(scenario, body, folder, part_of(progress, 0.0, _SURVEY))
    log = fly(after, controller, progress=part_of(progress, _SURVEY, 1.0))
    return MissionFlown(surveyed, whole_log(surveyed, log))


def whole_log(surveyed: Surveyed, log: FlightLog) -> FlightLog:
    """The log of a mission, of its survey's flight and of the flight after it."""
    flight, turn = surveyed.flight, surveyed.placed.turn
    positions = flight.states[:, :3] @ turn.T + surveyed.placed.shift
    attitudes = Rotation.from_matrix(turn) * Rotation.from_quat(flight.attitudes, scalar_first=True)
    row = np.searchsorted(flight.times, flight.returns.times)[flight.returns.frames]
    columns = {
        "survey_time": flight.times - flight.times[-1],
        "survey_state": np.hstack([positions, flight.states[:, 3:] @ turn.T]),
        "survey_attitude": attitudes.as_quat(canonical=True, scalar_first=True),
        "survey_force": flight.forces,
        "survey_frame": row.astype(np.int32),
        "survey_ray": flight.rays.astype(np.int32),
        "survey_range": flight.returns.ranges,
    }
    return with_survey(log, columns)


def begin_mission(
    scenario: Scenario, body: Body, folder: Path, progress: Progress = silent
) -> tuple[Surveyed, Scenario]:
    """Flies the survey of a mission; gives what it found, and the scenario of the flight after it.

    Args, raises: see `run_mission`.
    """
    surveying, visiting = parts_of(scenario)
    _check_speed(surveying, body)
    _check_touch(visiting)
    task, mission = visiting.task, scenario.task
    assert isinstance(mission, MissionConfig)
    if "park" in mission.phases:
        assert isinstance(task, TouchAndGoConfig)
        radius = task.away.park_m or around_of(surveying, body).radius
        visiting = dc.replace(
            visiting, task=dc.replace(task, away=dc.replace(task.away, park_m=radius))
        )
    surveyed = run_survey(surveying, body, folder, progress, visiting)
    after, path = onward(surveyed), folder / "flight.yaml"
    if not isinstance(after.task, TouchAndGoConfig):
        transit = after.transit
        drawn = draw_transit(transit.seed, transit.index, after, load_body(folder / "body.yaml"))
        transit.goal_m = drawn.goal.tolist()
    write_text(path, f"# After the survey: to a place on its map.\n{dump_changes(after)}")
    return surveyed, load_scenario(path)


def parts_of(scenario: Scenario) -> tuple[Scenario, Scenario]:
    """The scenarios of a mission's survey, which flies a point, and of what comes after it."""
    mission, craft = scenario.task, scenario.spacecraft
    if not isinstance(mission, MissionConfig):
        raise InputError("the scenario's task is no mission: set task: !Mission {}")
    touches = "touch_and_go" in mission.phases
    if touches and not scenario.is_rigid:
        raise InputError(
            "a mission ends with a touch, by a spacecraft of some size: set spacecraft: "
            "!RigidBody {}, or task.phases: [survey, transit]"
        )
    point = PointMassConfig(craft.mass_kg, craft.thrust_limit_n, craft.speed_limit_m_s)
    impulse = scenario.true_specific_impulse_s
    truth = dc.replace(scenario.truth, specific_impulse_s=impulse)
    survey = dc.replace(scenario, task=mission.survey, spacecraft=point, truth=truth)
    after = dc.replace(mission.touch, transit=True) if touches else Scenario().task
    return survey, dc.replace(scenario, task=after)


def _check_speed(surveying: Scenario, body: Body) -> None:
    """Refuses a survey that may end faster than a transit may begin, in the frame that turns."""
    around, limit = around_of(surveying, body), surveying.spacecraft.speed_limit_m_s
    fastest = HIGHEST * around.radius * abs(around.rate) + math.sqrt(around.gm / around.radius)
    if fastest > limit:
        raise InputError(
            f"after its survey the spacecraft may move by {fastest:.3g} m/s over the ground that "
            f"turns below it, and spacecraft.speed_limit_m_s is {limit:g}: set it higher"
        )


def _check_touch(visiting: Scenario) -> None:
    """Refuses a touch that no map permits."""
    task, craft, margin = visiting.task, visiting.spacecraft, visiting.mpc.keep_out_margin_m
    if not isinstance(task, TouchAndGoConfig):
        return
    assert isinstance(craft, RigidBodyConfig)
    check_arm(craft, task)
    # The place is within the keep-out ellipsoid.
    if margin > task.arm_m + task.descent.home_m:
        raise InputError(
            f"mpc.keep_out_margin_m, {margin:g} m, keeps the transit from home, "
            f"{task.descent.home_m:g} m above the place (task.touch.descent.home_m): set it lower"
        )


def onward(surveyed: Surveyed) -> Scenario:
    """The scenario of visits, begun where and as the survey ended: time 0 is the survey's end."""
    flight, placed = surveyed.flight, surveyed.placed
    world, found = flight.world, surveyed.found.survey
    scenario, time = copy.deepcopy(surveyed.visit), float(flight.returns.times[-1])
    scenario.transit.start_m = (placed.turn @ flight.states[-1, :3] + placed.shift).tolist()
    scenario.transit.start_velocity_m_s = (placed.turn @ flight.states[-1, 3:]).tolist()
    attitude = true_attitude(world, time) @ placed.turn.T
    believed = found.body_attitudes(np.array([time]))[0] @ surveyed.made.rotation.T
    ahead = Rotation.from_matrix(attitude.T @ believed).as_rotvec()
    # About the other axes it is the pole's error, which is among the truth.
    scenario.truth.phase_deg = math.degrees(ahead[2])
    drawn = world.scenario
    left, impulse = 1.0, drawn.truth.specific_impulse_s
    if impulse is not None:
        left = math.exp(-flight.delta_v / (STANDARD_GRAVITY * impulse))
    scenario.spacecraft.mass_kg = left * drawn.spacecraft.mass_kg
    scenario.lidar.noise_std_m = drawn.lidar.noise_std_m
    # The lidar that saw the body from the survey's orbit goes on seeing it from there.
    scenario.lidar.max_range_m = max(scenario.lidar.max_range_m, drawn.lidar.max_range_m)
    if scenario.sunlight is not None:
        scenario.sunlight = _later(scenario.sunlight, time, attitude)
    return scenario


def _later(sunlight: SunlightConfig, time: float, attitude: np.ndarray) -> SunlightConfig:
    """The Sun as it is at a time in s, by axes whose attitude (3, 3) in N is given."""
    direction = attitude.T @ sun_direction(time, sunlight)
    pole = attitude.T @ np.array(sunlight.orbit_pole)
    # What kernels say is kept for the hours after it.
    return dc.replace(
        sunlight, direction=direction.tolist(), orbit_pole=pole.tolist(), kernels=None
    )
