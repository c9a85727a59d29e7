"""The table of a log's columns: what each holds, and how records are split into them."""

from __future__ import annotations

from enum import IntEnum

from proxops.systems.assurance import InterventionReason
from proxops.systems.expert import PlanReason, PlanStatus
from proxops.systems.hybrid import DecisionReason
from proxops.systems.navigation import NavigationPhase, ReturnUse
from proxops.systems.policy import PolicyStatus

VARIABLES: dict[str, tuple[tuple[str, ...], str, str]] = {
    "state": (("component",), "m; m/s", "position and velocity of the spacecraft in K"),
    "target": (("component",), "m; m/s", "commanded final position and velocity in K"),
    "force": (
        ("axis",),
        "N",
        "force that the thrusters are to give, in S, from force_delay_s after this time on",
    ),
    "mpc_force": (("axis",), "N", "the MPC's force in K; NaN where it was not asked"),
    "policy_force": (("axis",), "N", "the policy's force in K; NaN where there is none"),
    "disturbance": (("axis",), "N", "applied less commanded (or assured) force in S"),
    "intervention": ((), "N", "size of what runtime assurance changed the command by"),
    "intervention_reason": ((), "1", "why it did: see flag_meanings; NaN: the flight was over"),
    "assurance_margin": (
        (),
        "m",
        "least clearance of the command and the backup after it; negative: the command is not safe",
    ),
    "assurance_position": ((), "m", "error of the position that runtime assurance allows for"),
    "assurance_velocity": ((), "m/s", "error of the velocity that it allows for"),
    "thrust": (("axis",), "N", "force that the thrusters truly give, along their own axes"),
    "mass": ((), "kg", "true mass of the spacecraft"),
    "attitude": (("quaternion",), "1", "true rotation of S against K: unit quaternion w, x, y, z"),
    "kick": (("axis",), "m/s^2", "acceleration by a kick from this time on, until the next, in K"),
    "decision": ((), "1", "flown by: 0 the controller named, 1 the MPC, 2 the policy"),
    "decision_reason": ((), "1", "why it is flown so: see flag_meanings; NaN: nothing was decided"),
    "agreement": ((), "1", "1 if the policy's force agrees with the MPC's; NaN: not compared"),
    "force_difference": ((), "N", "size of the difference of both forces; NaN: not compared"),
    "force_angle": ((), "rad", "angle that the gate compares; NaN: not compared, or a zero force"),
    "check_clearance": ((), "m", "distance to the keep-out ellipsoid at a check; NaN: no check"),
    "steps_to_check": ((), "1", "control steps from this one to the next check"),
    "decision_time": ((), "s", "wall time of comparing and deciding"),
    "solve_time": ((), "s", "wall time of the MPC's step; NaN where it was not asked"),
    "solve_status": (
        (),
        "1",
        "0 solved, 1 last plan continued, 2 braking or no state; NaN: not asked",
    ),
    "solve_reason": ((), "1", "why the MPC did so: see flag_meanings; NaN: not asked"),
    "policy_time": ((), "s", "wall time of the policy's network; NaN where it was not asked"),
    "policy_status": ((), "1", "0 answered, 1 not finite: no force; NaN: not asked"),
    "estimate": (("component",), "m; m/s", "the policy's estimate of the state in K; NaN: none"),
    "navigation_state": (
        ("component",),
        "m; m/s",
        "position and velocity in K as the navigation knows them; NaN: it has none",
    ),
    "navigation_attitude": (
        ("quaternion",),
        "1",
        "rotation of S against K as the navigation knows it: unit quaternion w, x, y, z",
    ),
    "navigation_covariance": (
        ("known", "known_with"),
        "m, m/s, rad",
        "covariance of navigation_state and of the rotation vector of S in K, as it is known",
    ),
    "navigation_residual": (
        (),
        "m",
        "rms of what is left of the ranges after a step of navigation",
    ),
    "navigation_returns": ((), "1", "lidar returns that the navigation used"),
    "navigation_rejected": ((), "1", "lidar returns that it rejected"),
    "navigation_innovation": ((), "1", "normalised innovation squared over the returns used"),
    "navigation_phase": ((), "1", "what the navigation does: see flag_meanings"),
    "navigation_return_use": (
        ("plane", "ray"),
        "1",
        "what the navigation made of each return: see flag_meanings",
    ),
    "ranges": (("plane", "ray"), "m", "lidar ranges as received; +inf where nothing returned"),
}
"""Each column: its dimensions after time, its units and its long name."""
FLAGS: dict[str, type[IntEnum]] = {
    "solve_status": PlanStatus,
    "solve_reason": PlanReason,
    "policy_status": PolicyStatus,
    "decision_reason": DecisionReason,
    "intervention_reason": InterventionReason,
    "navigation_phase": NavigationPhase,
    "navigation_return_use": ReturnUse,
}
"""The codes of a column, written as flag_values and flag_meanings after the CF conventions."""
RECORDS = {
    "mpc_record": ("solve_time", "solve_status", "solve_reason"),
    "policy_record": ("policy_time", "policy_status"),
    "decision_record": (
        "decision_reason", "agreement", "force_difference", "force_angle", "check_clearance",
        "steps_to_check", "decision_time",
    ),
    "intervention_record": ("intervention", "intervention_reason"),
    "assurance_record": ("assurance_margin", "assurance_position", "assurance_velocity"),
    "navigation_record": (
        "navigation_residual", "navigation_returns", "navigation_rejected", "navigation_innovation",
        "navigation_phase",
    ),
}  # fmt: skip
"""The columns into which a logged record is split, by the name of the record."""
CONTROLLER_COLUMNS = {
    "mpc_force": 3, "policy_force": 3, "estimate": 6, "decision": 1,
    **{name: len(RECORDS[name]) for name in ("mpc_record", "policy_record", "decision_record")},
}  # fmt: skip
"""Sizes of the controllers' ports that the log knows, by the names of their columns."""
NAVIGATION_COLUMNS = (
    "navigation_state", "navigation_attitude", "navigation_covariance",
    *RECORDS["navigation_record"],
)  # fmt: skip
"""Columns of a flight with a navigation: all of them, or none."""
RESERVED_COLUMNS = {
    *VARIABLES, *RECORDS, "time", "command", "position_inertial",
    "velocity_inertial", "mesh_vertices", "mesh_facets", "true_vertices", "true_facets",
    "component", "axis", "plane", "ray", "quaternion", "known", "known_with", "vertex", "facet",
    "true_vertex", "true_facet", "corner",
}  # fmt: skip
"""Names that a user's controller cannot give to its columns."""
COORDINATES = {
    "component": ["x", "y", "z", "vx", "vy", "vz"],
    "axis": ["x", "y", "z"],
}
OUTCOMES = ("arrival_time_s", "collided", "keep_out_violations")
"""Attributes that say how a flight ended."""
