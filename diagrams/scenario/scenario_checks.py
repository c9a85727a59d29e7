"""Checks that a scenario's values are within their limits and fit each other."""

import itertools
import math
from collections.abc import Iterator

from proxops.diagrams.scenario.keys import names_and_paths, why_not_dispersed
from proxops.diagrams.scenario.scenario_config import Scenario, TransitConfig
from proxops.diagrams.scenario.spacecraft_model import RigidBodyConfig, load_spacecraft
from proxops.diagrams.scenario.tasks import MISSIONS, MissionConfig, TouchAndGoConfig, Transit
from proxops.systems.common import InputError, check_limits
from proxops.systems.lidar import LearnedLidarConfig

# The greatest number of control steps of a flight; all steps are kept in memory.
_MOST_STEPS = 1_000_000
# The greatest coordinate (m) or velocity (m/s) per axis.
_FAR = 1e9
# The greatest cosine of what is to be a right angle.
_RIGHT_ANGLE = 1e-2


def check_scenario(scenario: Scenario, source: str = "scenario") -> None:
    """Checks each value of a scenario, and whether the values fit each other.

    Args:
      scenario: the scenario.
      source: the origin of the scenario, such as a file name; the message begins with it.

    Raises:
      InputError: a value is beyond its limits or does not fit another; the message names its key.
    """
    check_limits(scenario, source)
    if isinstance(scenario.spacecraft, RigidBodyConfig):
        load_spacecraft(scenario.spacecraft.model)  # It says itself what is wrong.
    fastest = scenario.spacecraft.speed_limit_m_s
    for complaint in itertools.chain(
        _times(scenario),
        _sunlight(scenario),
        _bundles(scenario),
        _dispersed(scenario),
        _transit(scenario.transit, fastest, isinstance(scenario.task, Transit)),
        _task(scenario),
    ):
        raise InputError(f"{source}: {complaint}")


def _times(scenario: Scenario) -> Iterator[str]:
    """Yields a message for each time that does not fit the control period."""
    period, arrival = scenario.control_period_s, scenario.arrival
    if scenario.mpc.solve_delay_s > period:
        yield (
            "mpc.solve_delay_s must be from 0 to control_period_s, "
            f"got {scenario.mpc.solve_delay_s}"
        )
    if scenario.mpc.estimator_gain > 0.0 and scenario.assurance is not None:
        yield (
            "mpc.estimator_gain takes what runtime assurance changes in a command for an "
            "acceleration that nothing explains: leave out assurance or the estimator"
        )
    kicks = scenario.kicks
    if kicks is not None and kicks.mean_interval_s < period:
        yield (
            f"kicks.mean_interval_s must be at least control_period_s, {period:g} s, "
            f"got {kicks.mean_interval_s}"
        )
    if (arrival.deadline_s + arrival.dwell_s) / period > _MOST_STEPS:
        yield (
            f"arrival.deadline_s and arrival.dwell_s must sum to at most {_MOST_STEPS} times "
            "control_period_s"
        )


def _sunlight(scenario: Scenario) -> Iterator[str]:
    """Yields a message for each direction of the Sun's orbit that there cannot be."""
    sunlight = scenario.sunlight
    if sunlight is None:
        return
    if sunlight.kernels is not None and not (sunlight.spice_body and sunlight.epoch):
        yield "sunlight.kernels needs sunlight.spice_body and sunlight.epoch"
    direction, pole = sunlight.direction, sunlight.orbit_pole
    for name, value in (("direction", direction), ("orbit_pole", pole)):
        if not any(value):
            yield f"sunlight.{name} has no direction, got {value}"
    lengths = math.hypot(*direction), math.hypot(*pole)
    cosine = sum(a / lengths[0] * b / lengths[1] for a, b in zip(direction, pole, strict=True))
    if sunlight.year_days is not None and abs(cosine) > _RIGHT_ANGLE:
        yield (
            "sunlight.direction must be at right angles to sunlight.orbit_pole, because the Sun "
            f"is in the plane of the orbit; the cosine of their angle is {cosine:.3g}"
        )


def _bundles(scenario: Scenario) -> Iterator[str]:
    """Yields a message for each bundle or body that no path can name."""
    lidar = scenario.lidar
    if isinstance(lidar, LearnedLidarConfig) and not lidar.bundle:
        yield "lidar.bundle must name the bundle's folder"
    if scenario.assurance is not None and scenario.assurance.bounds == "":
        yield "assurance.bounds must name dispersions or a YAML file, or be null"
    if scenario.policy.bundle == "":
        yield "policy.bundle must name the bundle's folder, or be null"
    for key, name in names_and_paths(scenario):
        if "\0" in name:
            yield f"{key} must be a path, got {name!r}"


def _task(scenario: Scenario) -> Iterator[str]:
    """Yields a message for each setting that does not fit what the flight is to do."""
    task = scenario.task
    if isinstance(task, TouchAndGoConfig) and scenario.assurance is not None and not task.transit:
        yield (
            "runtime assurance keeps out of the keep-out ellipsoid, into which a touch-and-go "
            "goes: leave it out, or set task.transit, which it guards"
        )
    if isinstance(task, MissionConfig) and task.phases not in MISSIONS:
        choices = " or ".join(f"[{', '.join(phases)}]" for phases in MISSIONS)
        yield f"task.phases must be {choices}, got {task.phases}"


def _dispersed(scenario: Scenario) -> Iterator[str]:
    """Yields a message for each key of a drawn value that cannot have been drawn."""
    for complaint in filter(None, map(why_not_dispersed, scenario.dispersed)):
        yield f"dispersed is what proxops writes when it draws: {complaint}"


def _transit(transit: TransitConfig, fastest: float, goal_needed: bool) -> Iterator[str]:
    """Yields a message for each error in the transit; `fastest` is the speed limit in m/s."""
    if not transit.min_distance_m < transit.max_distance_m:
        yield (
            "transit.min_distance_m must be below transit.max_distance_m, "
            f"got {transit.min_distance_m}"
        )
    if goal_needed and (transit.start_m is None) != (transit.goal_m is None):
        yield "transit needs both start_m and goal_m, or neither"
    for name in ("start_m", "goal_m", "start_velocity_m_s"):
        value = getattr(transit, name)
        if value is None:
            continue
        if len(value) != 3 or not all(math.isfinite(number) for number in value):
            yield f"transit.{name} must be three numbers, got {value}"
        elif max(map(abs, value)) > _FAR:
            yield f"transit.{name} must be at most {_FAR:g} per axis, got {value}"
    velocity = transit.start_velocity_m_s
    if velocity is not None and max(map(abs, velocity)) > fastest:
        yield (
            "transit.start_velocity_m_s must be within spacecraft.speed_limit_m_s per axis, "
            f"got {velocity}"
        )
