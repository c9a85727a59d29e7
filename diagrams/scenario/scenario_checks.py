"""What no flight can have: the checks of a scenario's values."""

import dataclasses as dc
import math
import typing

import numpy as np

from proxops.diagrams.scenario.scenario_config import LidarConfig, Scenario
from proxops.systems.common import InputError
from proxops.systems.hybrid import GateKind, PeriodRule

# What the expert may minimise.
COSTS = ("time_and_fuel", "weighted")


def check_scenario(scenario: Scenario, source: str = "scenario") -> None:
    """Raises `InputError` for values that no flight can have, naming the key."""

    def need(good: bool, key: str, why: str) -> None:
        if not good:
            raise InputError(f"{source}: {key} {why}")

    def each(section: str, names: tuple[str, ...], good: typing.Callable, why: str) -> None:
        holder = getattr(scenario, section) if section else scenario
        for name in names:
            value = getattr(holder, name)
            key = f"{section}.{name}" if section else name
            need(math.isfinite(value) and good(value), key, f"{why}, got {value}")

    def positive(section: str, *names: str) -> None:
        each(section, names, lambda value: value > 0, "must be positive")

    def not_negative(section: str, *names: str) -> None:
        each(section, names, lambda value: value >= 0, "must not be negative")

    positive("", "control_period_s")
    not_negative("", "noise_seed")
    positive("spacecraft", "mass_kg", "thrust_limit_n", "speed_limit_m_s")
    positive("mismatch", "gravity", "mass", "thrust")
    need(
        0.0 <= scenario.mpc.estimator_gain <= 1.0,
        "mpc.estimator_gain",
        f"must be from 0 to 1, got {scenario.mpc.estimator_gain}",
    )
    if isinstance(scenario.lidar, LidarConfig):
        positive("lidar", "max_incidence_deg")
        each("lidar", ("max_incidence_deg",), lambda value: value <= 90, "must be at most 90")
    else:
        need(bool(scenario.lidar.bundle), "lidar.bundle", "must name the bundle's folder")
        positive("lidar", "hit_probability")
        each("lidar", ("hit_probability",), lambda value: value < 1, "must be below 1")
    need(scenario.policy.bundle != "", "policy.bundle", "must name the bundle's folder, or be null")
    positive("lidar", "max_range_m", "planes", "rays")
    not_negative("lidar", "noise_std_m", "dropout", "false_returns", "attitude_error_deg")
    each("lidar", ("attitude_error_deg",), lambda value: value <= 180, "must be at most 180")
    each("lidar", ("bias_m",), lambda value: True, "must be finite")
    each("lidar", ("scale_error",), lambda value: value > -1, "must be above -1")
    chances = ("dropout", "false_returns")
    each("lidar", chances, lambda value: value <= 1, "must be at most 1, a chance")
    positive(
        "mpc", "intervals", "interval_growth", "nominal_acceleration_m_s2", "min_horizon_s",
        "cold_iterations",
    )  # fmt: skip
    need(scenario.mpc.intervals >= 2, "mpc.intervals", "must be at least 2")
    need(
        scenario.mpc.cost in COSTS,
        "mpc.cost",
        f"must be {' or '.join(COSTS)}, got {scenario.mpc.cost!r}",
    )
    for name, value in dc.asdict(scenario.mpc.weighted).items():
        good = math.isfinite(value) and value > 0
        need(good, f"mpc.weighted.{name}", f"must be positive, got {value}")
    need(
        0.0 <= scenario.mpc.solve_delay_s <= scenario.control_period_s,
        "mpc.solve_delay_s",
        f"must be from 0 to control_period_s, got {scenario.mpc.solve_delay_s}",
    )
    not_negative("mpc", "keep_out_margin_m", "fuel_weight")
    hybrid = scenario.hybrid
    for name, values in (("gate", list(GateKind)), ("period_rule", list(PeriodRule))):
        value = getattr(hybrid, name)
        need(value in values, f"hybrid.{name}", f"must be {' or '.join(values)}, got {value!r}")
    not_negative(
        "hybrid", "epsilon_magnitude_n", "epsilon_angle_deg", "dead_band_n",
        "state_noise_position_m", "state_noise_velocity_m_s",
    )  # fmt: skip
    positive("hybrid", "check_period", "longest_period")
    if scenario.assurance is not None:
        not_negative("assurance", "margin_m")
    if scenario.disturbance is not None:
        positive("disturbance", "reset_period_s")
        not_negative("disturbance", "max_relative_magnitude", "increment_std_n")
    if scenario.force_noise is not None:
        not_negative("force_noise", "std_n", "correlation_time_s")
    if scenario.kicks is not None:
        not_negative("kicks", "velocity_std_m_s")
        period = scenario.control_period_s
        why = f"must be at least control_period_s, {period:g} s"
        each("kicks", ("mean_interval_s",), lambda value: value >= period, why)
    transit = scenario.transit
    positive("transit", "cube_m", "min_distance_m", "max_distance_m", "max_hover_share")
    not_negative("transit", "seed", "index", "end_clearance_m")
    need(
        transit.min_distance_m < transit.max_distance_m,
        "transit.min_distance_m",
        "must be below transit.max_distance_m",
    )
    need(
        (transit.start_m is None) == (transit.goal_m is None),
        "transit",
        "needs start_m and goal_m both or neither",
    )
    for name in ("start_m", "goal_m", "start_velocity_m_s"):
        value = getattr(transit, name)
        if value is not None:
            need(
                len(value) == 3 and bool(np.isfinite(value).all()),
                f"transit.{name}",
                f"must be three numbers, got {value}",
            )
    if transit.start_velocity_m_s is not None:
        slow = np.abs(transit.start_velocity_m_s).max() <= scenario.spacecraft.speed_limit_m_s
        why = "must be within spacecraft.speed_limit_m_s per axis"
        need(bool(slow), "transit.start_velocity_m_s", f"{why}, got {transit.start_velocity_m_s}")
    positive("arrival", "radius_m", "speed_m_s", "dwell_s", "deadline_s")
