"""A docs/results.json as it is when all campaigns were flown, with figures that are made up."""

from typing import Any

from proxops.studies.campaigns import all_campaigns

# Those of one controller in one campaign.
_FIGURES = {
    "transits": 200,
    "success_rate": 1.0,
    "success_rate_interval": [0.981155, 1.0],
    "success_rate_exact_interval": [0.981725, 1.0],
    "success_shown_90": 0.988553,
    "success_rate_2km": 1.0,
    "success_rate_2km_interval": [0.981155, 1.0],
    "unflyable": 0,
    "collisions": 0,
    "keep_out_violations": 0,
    "min_clearance_m": 15.6685,
    "min_clearance_m_p1": 16.2983,
    "min_clearance_m_p10": 25.6732,
    "min_clearance_m_median": 209.906,
    "terminal_position_error_m_median": 0.105162,
    "terminal_position_error_m_p90": 0.237732,
    "terminal_position_error_m_p95": 0.256061,
    "terminal_position_error_m_p99": 0.275582,
    "terminal_position_error_m_max": 0.299637,
    "terminal_speed_m_s_max": 0.00143431,
    "arrival_time_s_median": 5444.29,
    "arrival_time_s_p90": 6246.83,
    "arrival_time_s_p99": 6617.65,
    "arrival_time_s_max": 6975.43,
    "delta_v_m_s_median": 0.492632,
    "delta_v_m_s_mean": 0.496707,
    "delta_v_m_s_p90": 0.626037,
    "delta_v_99_m_s": 0.757305,
    "delta_v_99_m_s_bound": None,
    "delta_v_m_s_max": 0.811301,
    "expert_pairs": 200,
    "expert_delta_v_ratio_median": 0.998061,
    "expert_delta_v_ratio": 1.00013,
    "policy_share": 0.883079,
    "policy_share_to_arrival": 0.880909,
    "mpc_solves": 11927,
    "control_ms_median": 0.070965,
    "control_ms_mean": 0.303565,
    "control_ms_p99": 9.46249,
    "navigation_position_error_m_median": 0.0116126,
    "navigation_position_error_m_p95": 0.0385017,
    "navigation_velocity_error_m_s_median": 2.53e-06,
    "navigation_velocity_error_m_s_p95": 2.24386e-05,
    "navigation_attitude_error_deg_median": 0.00104447,
    "navigation_attitude_error_deg_p95": 0.00335497,
    "navigation_consistent": 0.986993,
    "navigation_following": 1.0,
    "small_command_share": 1.0,
}


def results_with_all() -> dict[str, Any]:
    """The same figures stand for every controller of every campaign."""
    campaigns = {}
    for each in all_campaigns():
        controllers = {
            variant.name: _FIGURES | {"transits": each.transits, "successes": each.transits}
            for variant in each.variants
        }
        campaigns[each.name] = {
            "commit": "0123456",
            "part": each.part,
            "title": each.title,
            "told": each.told,
            "command": f"proxops reproduce {each.name}",
            "body": each.body or "kleopatra",
            "dispersions": each.dispersions,
            "seed": each.seed,
            "wall_s": 3600,
            "controllers": controllers,
        }
    paper = {
        "proxops_version": "1.0.0",
        "seed": 10_000,
        "paper_and_ours": [{"what": "a share", "paper": "70 %", "ours": "71 %"}],
        "controllers": {
            "policy, paper's recipe": _FIGURES
            | {"successes": 0, "costs": {"saved": 1.0, "step_s": 2e-4}}
        },
    }
    return {"proxops_version": "1.0.0", "paper": paper, "campaigns": campaigns}
