"""Computes the figures of merit of one flight from its log."""

from __future__ import annotations

import collections
import typing
from collections.abc import Mapping

import numpy as np
import xarray as xr

from proxops.diagrams.logs.attitude_figures import attitude_figures
from proxops.diagrams.logs.columns import WALL_TIMES
from proxops.diagrams.logs.navigation_figures import navigation_figures
from proxops.diagrams.logs.touch_figures import of_controller, touch_figures
from proxops.diagrams.scenario import Body, Scenario, dispersed_values
from proxops.systems.assurance import InterventionReason
from proxops.systems.common import States, Values
from proxops.systems.expert import PlanReason, PlanStatus
from proxops.systems.hybrid import FlownBy
from proxops.systems.shapes import clearances
from proxops.systems.vehicle import STANDARD_GRAVITY, hermite_curve

# A second figure, `success_2km`, accepts arrival within this multiple of the scenario's radius and
# speed, because a policy that only has lidar knows its state less well. Its name comes from the
# values with the default scenario, 2 km and 2 m/s.
WIDE_ARRIVAL = 2.0
# A change of the command by runtime assurance counts as an intervention above this size (N).
INTERVENTION_TOLERANCE = 1e-3
# Number of samples from one row to the next for the least clearance.
_SUBSTEPS = 10
# Number of samples of the straight line from start to goal.
_LINE_SAMPLES = 201


def summarise(data: xr.Dataset, scenario: Scenario, body: Body) -> dict[str, typing.Any]:
    """Computes the figures of merit from a log's dataset; see `FlightLog.summary`."""
    times, states = data["time"].values, data["state"].values
    attrs = data.attrs
    arrival = float(attrs["arrival_time_s"])
    arrived = bool(np.isfinite(arrival))
    least = float(clearances(body.keep_out_semi_axes, dense_positions(times, states)).min())
    # The true acceleration by each row's thrust, and the time for which it acts: `lengths` in the
    # whole flight, `until` before arrival.
    thrust = _true_acceleration(data, scenario)
    starts = times[:-1] + attrs.get("force_delay_s", 0.0)
    lengths = np.clip(times[-1] - starts, 0.0, np.diff(times))
    until = np.clip((arrival if arrived else np.inf) - starts, 0.0, lengths)
    error = states[-1] - data["target"].values[-1]
    flown = of_controller(data)
    control_ms = _control_ms(flown)
    by_policy = flown["decision"].values[:-1] == FlownBy.POLICY
    under_way = by_policy[flown["time"].values[:-1] < arrival] if arrived else by_policy
    collided = bool(attrs["collided"])
    violations = int(attrs["keep_out_violations"])
    in_time = arrived and arrival <= scenario.arrival.deadline_s
    # A flight that arrives by the scenario's rule also arrives by the wider rule. It is not tested
    # again, because interpolation between the rows could miss it.
    radius, speed = scenario.arrival.radius_m, scenario.arrival.speed_m_s
    nearly = in_time or _arrives(data, scenario, WIDE_ARRIVAL * radius, WIDE_ARRIVAL * speed)
    return {
        "controller": attrs["controller"],
        "seed": scenario.transit.seed,
        "transit": scenario.transit.index,
        "success": in_time and not collided and violations == 0,
        "success_2km": nearly and not collided and violations == 0,
        "collided": collided,
        "keep_out_violations": violations,
        "min_clearance_m": least,
        "terminal_position_error_m": float(np.linalg.norm(error[:3])),
        "terminal_speed_m_s": float(np.linalg.norm(error[3:])),
        "arrival_time_s": arrival if arrived else None,
        "delta_v_m_s": float(thrust @ until),
        "hold_delta_v_m_s": float(thrust @ (lengths - until)),
        "steps": len(times) - 1,
        "mpc_solves": int(np.isfinite(flown["solve_time"].values).sum()),
        "policy_share": float(np.mean(by_policy)),
        "policy_share_to_arrival": float(np.mean(under_way)) if under_way.size else None,
        "control_ms_median": float(np.median(control_ms)) if control_ms.size else None,
        "control_ms_p99": float(np.percentile(control_ms, 99)) if control_ms.size else None,
        "control_ms_mean": float(np.mean(control_ms)) if control_ms.size else None,
        "wall_s": float(attrs["wall_s"]),
        "scenario_sha256": attrs["scenario_sha256"],
        "policy_sha256": attrs.get("policy_sha256"),
        "dispersed": dispersed_values(scenario),
        **_transit(data, body),
        **_estimate_errors(data),
        **navigation_figures(data),
        **attitude_figures(data, scenario),
        **_interventions(data, scenario),
        **touch_figures(data),
    }


def outcome(row: Mapping[str, typing.Any]) -> str:
    """How a flight ended, in a few words, by its summary."""
    if row["collided"]:
        return "collision"
    if row["keep_out_violations"]:
        return "inside the keep-out"
    if row["success"]:
        if row.get("touched"):
            return "touched, and parked" if "parked_m" in row else "touched, and home again"
        return "arrived" if "arrival_time_s" in row else "a map"
    if "touched" in row and row["safe"]:
        return "home again without a touch"
    return "no arrival" if row["arrival_time_s"] is None else "arrived too late"


def _transit(data: xr.Dataset, body: Body) -> dict[str, float]:
    """Gives the distance from start to goal, and the clearance of both and of the line between."""
    start, goal = data["state"].values[0, :3], data["target"].values[-1, :3]
    line = clearances(body.keep_out_semi_axes, np.linspace(start, goal, _LINE_SAMPLES))
    return {
        "transit_distance_m": float(np.linalg.norm(goal - start)),
        "transit_start_clearance_m": float(line[0]),
        "transit_goal_clearance_m": float(line[-1]),
        "transit_line_clearance_m": float(line.min()),
    }


def _control_ms(data: xr.Dataset) -> np.ndarray:
    """Gives the controller's wall time in ms at each step that has one, but the first.

    It is the sum of the MPC's step, the policy's network and the hybrid's decision. The first step
    loads or compiles what they call.
    """
    parts = np.array([data[name].values for name in WALL_TIMES if name in data])
    return 1e3 * np.nansum(parts[:, np.isfinite(parts).any(axis=0)], axis=0)[1:]


def _estimate_errors(data: xr.Dataset) -> dict[str, float]:
    """Gives median and 95th percentile of the errors of the policy's estimates, if it makes any."""
    if "estimate" not in data:
        return {}
    error = data["estimate"].values - data["state"].values
    error = error[np.isfinite(error).all(axis=1)]
    if not error.size:
        return {}
    figures = {}
    for name, part in (("position_error_m", error[:, :3]), ("velocity_error_m_s", error[:, 3:])):
        sizes = np.linalg.norm(part, axis=1)
        figures[f"estimate_{name}_median"] = float(np.median(sizes))
        figures[f"estimate_{name}_p95"] = float(np.percentile(sizes, 95))
    return figures


def _interventions(data: xr.Dataset, scenario: Scenario) -> dict[str, float]:
    """Gives the number of interventions, those for the keep-out, and the Δv of all changes.

    `assured_share` is the share of the control steps at which runtime assurance judged the command.
    """
    if "intervention" not in data:
        return {}
    changes = data["intervention"].values[:-1]
    pushed = changes @ np.diff(data["time"].values)
    many = changes > INTERVENTION_TOLERANCE
    out = data["intervention_reason"].values[:-1] >= InterventionReason.KEEP_OUT
    figures = {
        "interventions": int(many.sum()),
        "interventions_keep_out": int((many & out).sum()),
        "intervention_delta_v_m_s": float(pushed / _true_mass(scenario)),
    }
    if "touch_phase" not in data:  # In a descent it judges nothing, as it should.
        margins = data["assurance_margin"].values[:-1]
        figures["assured_share"] = float(np.isfinite(margins).mean())
    return figures


def _true_acceleration(data: xr.Dataset, scenario: Scenario) -> np.ndarray:
    """Gives the sum over the axes of the true thrust over the true mass, of each step, in m/s^2."""
    impulse = scenario.true_specific_impulse_s
    if scenario.is_rigid and impulse is not None:
        # What its thrusters gave, by the rocket equation.
        mass = data["mass"].values
        return STANDARD_GRAVITY * impulse * -np.diff(np.log(mass)) / np.diff(data["time"].values)
    name = "thrust" if "thrust" in data else "force"
    mass = data["mass"].values[:-1] if "mass" in data else _true_mass(scenario)
    return np.abs(data[name].values[:-1]).sum(axis=1) / mass


def _true_mass(scenario: Scenario) -> float:
    """Gives the true mass in kg at the start."""
    return scenario.truth.mass * scenario.spacecraft.mass_kg


def fallback_steps(data: xr.Dataset) -> dict[str, int]:
    """Counts the steps at which the MPC or the policy had no new answer.

    Returns:
      The number of steps by a text "what was done: reason".
    """
    counts, data = collections.Counter(), of_controller(data)
    if "policy_status" in data and (bad := int((data["policy_status"] > 0).sum())):
        counts["without force: policy not finite"] = bad
    pairs = zip(data["solve_status"].values, data["solve_reason"].values, strict=True)
    for status, reason in pairs:
        if status > PlanStatus.SOLVED:
            text = f"{PlanStatus(int(status)).name}: {PlanReason(int(reason)).name}"
            counts[text.lower().replace("_", " ")] += 1
    return counts


def dense_positions(times: Values, states: States) -> np.ndarray:
    """Interpolates a path by cubic Hermite splines, with ten positions for each row.

    With steps of 10 s the result is within a millimetre of the integrated path.

    Args:
      times: (N,) in s.
      states: (N, 6), position in m and velocity in m/s in K.

    Returns:
      Positions (10 (N - 1) + 1, 3) in m in K; for a single row, its position.
    """
    if len(times) < 2:
        return states[:, :3]
    shares = np.arange(_SUBSTEPS * (len(times) - 1) + 1) / _SUBSTEPS
    dense_times = np.interp(shares, np.arange(len(times)), times)
    return hermite_curve(times, states)(dense_times)


def _arrives(data: xr.Dataset, scenario: Scenario, radius: float, speed: float) -> bool:
    """Tells whether a dwell within radius (m) and speed (m/s) begins before the deadline.

    It interpolates the times of entering and leaving between the rows.
    """
    arrival = scenario.arrival
    times = data["time"].values
    error = data["state"].values - data["target"].values
    distance, rate = np.linalg.norm(error[:, :3], axis=1), np.linalg.norm(error[:, 3:], axis=1)
    level = np.maximum(distance / radius, rate / speed)
    entered = times[0] if level[0] <= 1.0 else None
    for k in range(1, len(times)):
        inside = level[k] <= 1.0
        if inside != (level[k - 1] <= 1.0):
            share = (level[k - 1] - 1.0) / (level[k - 1] - level[k])
            crossed = times[k - 1] + share * (times[k] - times[k - 1])
        else:
            crossed = times[k]
        if entered is None and inside:
            entered = crossed
        if entered is not None:
            if crossed - entered >= arrival.dwell_s * (1.0 - 1e-9):
                return bool(entered <= arrival.deadline_s)
            if not inside:
                entered = None
    return False
