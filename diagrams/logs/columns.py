"""The table of a log's columns: what each holds, and which are parts of a record.

All else that is known of columns follows from it: their sizes, and what a log may or must hold.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import NamedTuple

from proxops.systems.assurance import InterventionReason
from proxops.systems.expert import PlanReason, PlanStatus
from proxops.systems.hybrid import DecisionReason
from proxops.systems.navigation import NavigationPhase, ReturnUse
from proxops.systems.policy import PolicyStatus
from proxops.systems.touch import AbortReason, TouchPhase


class Column(NamedTuple):
    """What a column of a log holds."""

    dimensions: tuple[str, ...]
    """Its dimensions after time."""
    units: str
    """After the CF conventions; where components differ, that of each, with semicolons between."""
    long_name: str
    codes: type[IntEnum] | None = None
    """Its codes, written as flag_values and flag_meanings after the CF conventions."""
    record: str | None = None
    """The logged vector of which it is a component; None: it is logged by itself."""


def _record(name: str, columns: dict[str, Column]) -> dict[str, Column]:
    """Gives the columns of a record, in the order of its components."""
    return {column: each._replace(record=name) for column, each in columns.items()}


_OF_A_STATE = "m; m; m; m/s; m/s; m/s"
VARIABLES = {
    "state": Column(("component",), _OF_A_STATE, "position and velocity of the spacecraft in K"),
    "target": Column(("component",), _OF_A_STATE, "commanded final position and velocity in K"),
    "force": Column(
        ("axis",), "N",
        "force that the thrusters are to give, in S, from force_delay_s after this time on",
    ),
    "mpc_force": Column(("axis",), "N", "the MPC's force in K; NaN where it was not asked"),
    "policy_force": Column(("axis",), "N", "the policy's force in K; NaN where there is none"),
    "disturbance": Column(("axis",), "N", "applied less commanded (or assured) force in S"),
    **_record("intervention_record", {
        "intervention": Column((), "N", "size of what runtime assurance changed the command by"),
        "intervention_reason": Column(
            (), "1", "why it did: see flag_meanings; NaN: the flight was over", InterventionReason,
        ),
    }),
    **_record("assurance_record", {
        "assurance_margin": Column(
            (), "m",
            "least clearance of the command and the backup after it; negative: the command is not "
            "safe",
        ),
        "assurance_position": Column(
            (), "m", "error of the position that runtime assurance allows for",
        ),
        "assurance_velocity": Column((), "m/s", "error of the velocity that it allows for"),
    }),
    "thrust": Column(("axis",), "N", "force that the thrusters truly give, along their own axes"),
    "mass": Column((), "kg", "true mass of the spacecraft"),
    "attitude": Column(
        ("quaternion",), "1", "true rotation of S against K: unit quaternion w, x, y, z",
    ),
    "angular_velocity": Column(("axis",), "rad/s", "true angular velocity of S against N, in S"),
    "inertial_attitude": Column(
        ("quaternion",), "1", "true rotation of S against N, the axes of K as believed at time 0",
    ),
    "reference_attitude": Column(
        ("quaternion",), "1", "rotation of S against N that the guidance wants",
    ),
    "wheel_momentum": Column(("wheel",), "N m s", "true momentum of each reaction wheel"),
    "on_times": Column(
        ("thruster",), "s", "time for which each thruster is on in the attitude period before",
    ),
    "centre_of_mass": Column(
        ("axis",), "m", "centre of mass as it is estimated, less that of the data sheet, in S",
    ),
    "failed_thrusters": Column(("thruster",), "1", "1: the thruster is found to have failed"),
    "kick": Column(
        ("axis",), "m/s^2", "acceleration by a kick from this time on, until the next, in K",
    ),
    "sun_direction": Column(("axis",), "1", "unit vector from the body to the Sun in K"),
    "decision": Column((), "1", "flown by: 0 the controller named, 1 the MPC, 2 the policy"),
    **_record("decision_record", {
        "decision_reason": Column(
            (), "1",
            "why it is flown so: see flag_meanings; NaN: nothing was decided",
            DecisionReason,
        ),
        "agreement": Column(
            (), "1", "1 if the policy's force agrees with the MPC's; NaN: not compared",
        ),
        "force_difference": Column(
            (), "N", "size of the difference of both forces; NaN: not compared",
        ),
        "force_angle": Column(
            (), "rad", "angle that the gate compares; NaN: not compared, or a zero force",
        ),
        "check_clearance": Column(
            (), "m", "distance to the keep-out ellipsoid at a check; NaN: no check",
        ),
        "steps_to_check": Column((), "1", "control steps from this one to the next check"),
        "decision_time": Column((), "s", "wall time of comparing and deciding"),
    }),
    **_record("mpc_record", {
        "solve_time": Column((), "s", "wall time of the MPC's step; NaN where it was not asked"),
        "solve_status": Column(
            (), "1",
            "0 solved, 1 last plan continued, 2 braking or no state; NaN: not asked",
            PlanStatus,
        ),
        "solve_reason": Column(
            (), "1", "why the MPC did so: see flag_meanings; NaN: not asked", PlanReason,
        ),
    }),
    **_record("policy_record", {
        "policy_time": Column(
            (), "s", "wall time of the policy's network; NaN where it was not asked",
        ),
        "policy_status": Column(
            (), "1", "0 answered, 1 not finite: no force; NaN: not asked", PolicyStatus,
        ),
    }),
    **_record("touch_record", {
        "touch_phase": Column((), "1", "phase of a touch-and-go: see flag_meanings", TouchPhase),
        "touch_abort": Column((), "1", "why a descent was broken off last", AbortReason),
        "touch_tries": Column((), "1", "descents that were begun"),
        "touch_stopping_height": Column(
            (), "m", "least height over that of contact at which an abort now comes to rest",
        ),
        "touch_by_policy": Column((), "1", "1: the force of a descent is the learned policy's"),
    }),
    **_record("contact_record", {
        "contact_force": Column((), "N", "greatest force on the head since the last control step"),
        "parts_force": Column((), "N", "greatest on anything but the head"),
        "arm_stroke": Column((), "m", "how far the arm was pressed in at most"),
        "contact_energy": Column(
            (), "J", "greatest of kinetic energy over the ground, with that of the arm's spring",
        ),
    }),
    "estimate": Column(
        ("component",), _OF_A_STATE, "the policy's estimate of the state in K; NaN: none",
    ),
    "navigation_state": Column(
        ("component",), _OF_A_STATE,
        "position and velocity in K as the navigation knows them; NaN: it has none",
    ),
    "navigation_attitude": Column(
        ("quaternion",), "1",
        "rotation of S against K as the navigation knows it: unit quaternion w, x, y, z",
    ),
    "navigation_covariance": Column(
        ("known", "known_with"), f"{_OF_A_STATE}; rad; rad; rad",
        "covariance of navigation_state and of the rotation vector of S in K, as it is known",
    ),
    **_record("navigation_record", {
        "navigation_residual": Column(
            (), "m", "rms of what is left of the ranges after a step of navigation",
        ),
        "navigation_returns": Column((), "1", "lidar returns that the navigation used"),
        "navigation_rejected": Column((), "1", "lidar returns that it rejected"),
        "navigation_innovation": Column(
            (), "1", "normalised innovation squared over the returns used",
        ),
        "navigation_phase": Column(
            (), "1", "what the navigation does: see flag_meanings", NavigationPhase,
        ),
    }),
    "navigation_return_use": Column(
        ("plane", "ray"), "1",
        "what the navigation made of each return: see flag_meanings",
        ReturnUse,
    ),
    "ranges": Column(
        ("plane", "ray"), "m", "lidar ranges as received; +inf where nothing returned",
    ),
}  # fmt: skip
"""Each column, in the order of the file."""
SURVEY = {
    "survey_time": Column(("survey_time",), "s", "time to the flight, at most 0"),
    "survey_state": Column(
        ("survey_time", "component"), _OF_A_STATE, "position and velocity of the spacecraft in K",
    ),
    "survey_attitude": Column(
        ("survey_time", "quaternion"), "1", "rotation of S against K: unit quaternion w, x, y, z",
    ),
    "survey_force": Column(
        ("survey_time", "axis"), "N", "force of the thrusters in S, from this time to the next",
    ),
    "survey_frame": Column(
        ("survey_return",), "1", "of each lidar return, the row of survey_time; from 0",
    ),
    "survey_ray": Column(
        ("survey_return",), "1", "the number of its ray: 360 times the plane and so on; from 0",
    ),
    "survey_range": Column(("survey_return",), "m", "range as measured"),
}  # fmt: skip
"""A survey in a mission's log, with all dimensions."""
DERIVED = {
    "position_inertial": Column(
        ("axis",), "m", "position in the non-turning frame that is K at time 0"
    ),
    "velocity_inertial": Column(
        ("axis",), "m/s", "velocity in the non-turning frame that is K at time 0"
    ),
}
"""Columns that follow from `state`."""
RECORDS: dict[str, list[str]] = {}
for _name, _column in VARIABLES.items():
    if _column.record is not None:
        RECORDS.setdefault(_column.record, []).append(_name)
"""The columns into which a logged record is split, by the name of the record."""
COORDINATES = {
    "component": ["x", "y", "z", "vx", "vy", "vz"],
    "axis": ["x", "y", "z"],
}
SIZES = {
    **{name: len(labels) for name, labels in COORDINATES.items()},
    "quaternion": 4,
    "known": 9,
    "known_with": 9,
}
"""Sizes of all dimensions but time and those of frames and meshes."""
CONTROLLER_COLUMNS = {
    "mpc_force", "policy_force", "estimate", "decision",
    "mpc_record", "policy_record", "decision_record", "touch_record",
}  # fmt: skip
"""The controllers' ports that the log knows, by the names of their columns."""
NAVIGATION_COLUMNS = [
    name
    for name, column in VARIABLES.items()
    if name.startswith("navigation_") and "ray" not in column.dimensions
]
"""Columns of a flight with a navigation: all of them, or none."""
RESERVED_COLUMNS = {
    *VARIABLES, *DERIVED, *RECORDS, *SURVEY, "survey_return", "time",
    "command", *SIZES, "plane", "ray", "mesh_vertices",
    "mesh_facets", "vertex", "facet", "true_vertices", "true_facets", "true_vertex", "true_facet",
    "corner",
}  # fmt: skip
"""Names that a user's controller cannot give to its columns."""
WALL_TIMES = ("solve_time", "policy_time", "decision_time")
"""Columns that differ from run to run."""
OUTCOMES = ("arrival_time_s", "collided", "keep_out_violations")
"""Attributes that say how a flight ended."""


def column_size(name: str) -> int:
    """Gives the number of components of a logged vector: of a column or a record."""
    if name in RECORDS:
        return len(RECORDS[name])
    return math.prod(SIZES[dimension] for dimension in VARIABLES[name].dimensions)
