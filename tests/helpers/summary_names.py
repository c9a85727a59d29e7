"""Names of a summary, in order."""

SUMMARY = [
    "controller", "seed", "transit", "success", "success_2km", "collided", "keep_out_violations",
    "min_clearance_m", "terminal_position_error_m", "terminal_speed_m_s", "arrival_time_s",
    "delta_v_m_s", "hold_delta_v_m_s", "steps", "mpc_solves", "policy_share",
    "policy_share_to_arrival", "control_ms_median", "control_ms_p99", "control_ms_mean", "wall_s",
    "scenario_sha256", "policy_sha256", "dispersed", "transit_distance_m",
    "transit_start_clearance_m", "transit_goal_clearance_m", "transit_line_clearance_m",
]  # fmt: skip

NAVIGATION_SUMMARY = [
    "navigation_following", "navigation_position_error_m_median", "navigation_position_error_m_p95",
    "navigation_velocity_error_m_s_median", "navigation_velocity_error_m_s_p95",
    "navigation_attitude_error_deg_median", "navigation_attitude_error_deg_p95",
    "navigation_consistent",
]  # fmt: skip
