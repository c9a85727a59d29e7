"""Rows of flights, as a campaign has them."""

from typing import Any

ESTIMATE_ERRORS = {
    "position_error_m_median": 40.0, "position_error_m_p95": 90.0,
    "velocity_error_m_s_median": 0.1, "velocity_error_m_s_p95": 0.3,
}  # fmt: skip


def row(**changes: Any) -> dict[str, Any]:
    figures = {
        "controller": "mpc", "seed": 1, "transit": 0, "success": True, "success_2km": True,
        "collided": False, "keep_out_violations": 0, "min_clearance_m": 3000.0,
        "terminal_position_error_m": 1.0, "terminal_speed_m_s": 0.1, "arrival_time_s": 4000.0,
        "delta_v_m_s": 150.0, "hold_delta_v_m_s": 10.0, "steps": 459, "mpc_solves": 460,
        "policy_share": 0.0, "control_ms_median": 4.0, "control_ms_p99": 8.0,
        "control_ms_mean": 5.0, "policy_share_to_arrival": 0.0, "wall_s": 3.0,
        "scenario_sha256": "0" * 64, "policy_sha256": None,
    }  # fmt: skip
    return figures | changes


def unflyable(transit: int, reason: str = "the start is inside the true body") -> dict[str, Any]:
    return {
        "controller": "mpc", "seed": 1, "transit": transit, "dispersed": {"truth.scale": 1.2},
        "unflyable": reason,
    }  # fmt: skip
