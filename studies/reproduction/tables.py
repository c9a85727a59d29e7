"""Tables of the paper's reproduction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import metadata
from typing import Any

from proxops.diagrams.logs import length_text
from proxops.diagrams.scenario import Scenario
from proxops.studies.evaluation import EXPERT, successes_text, without_flights
from proxops.studies.reproduction import flights, numbers
from proxops.studies.reproduction.stages import Stage
from proxops.training.reports import DASH, Table, interval_text, number_text

Results = Mapping[str, Mapping[str, Any]]

_NOT_RUN = "not run"


def number(figures: Mapping[str, Any], key: str, form: str = ".0f", scale: float = 1.0) -> str:
    """Formats a figure; a dash stands for one that there is not."""
    return number_text(figures.get(key), form, scale)


def stage_table(stages: Sequence[Stage]) -> Table:
    """Makes the table of the stages, with their folders and wall times."""
    lines = [[each.name, each.folder.name, f"{each.wall_s:.0f}", _run(each)] for each in stages]
    return Table(["stage", "folder", "wall time (s)", "run"], lines)


def _run(stage: Stage) -> str:
    """When a stage was run; and by which version, if by another than this."""
    if stage.version != metadata.version("proxops"):
        return f"before, by proxops {stage.version}"
    return "before" if stage.skipped else "now"


def controller_table(results: Results) -> Table:
    """Makes the table of the controllers' flights, one line each."""
    lines = []
    for name, result in results.items():
        lines.append(
            [
                name,
                successes_text(result),
                interval_text(result["success_rate_exact_interval"]),
                successes_text(result, wide=True),
                str(result["collisions"]),
                str(result["keep_out_violations"]),
                str(numbers.blind_flights(result)),
                length_text(result["min_clearance_m"]),
                number(result, "terminal_position_error_m_median", ".1f"),
                number(result, "delta_v_m_s_median", ".1f"),
                number(result, "expert_delta_v_ratio", ".3f"),
            ]
        )
    head = [
        "", "success", "exact 95 % interval", "success, twice as wide", "collisions", "violations",
        "lost", "least clearance", "end error, median (m)", "Δv, median (m/s)", "Δv / MPC's",
    ]  # fmt: skip
    return Table(head, lines)


def gate_table(results: Results, names: Sequence[str]) -> Table:
    """Makes the table that compares the hybrids."""
    lines = []
    for name in names:
        result, cost = results[name], numbers.costs(results, name)
        passed = numbers.checks_passed(result)
        lines.append(
            [
                name,
                f"{100 * result['policy_share']:.1f}",
                number(result, "policy_share_to_arrival", ".1f", 100.0),
                number(cost, "saved", ".1f", 100.0),
                number_text(passed, ".1f", 100.0),
                successes_text(result),
                str(result["keep_out_violations"]),
                number(result, "expert_delta_v_ratio", ".3f"),
            ]
        )
    head = [
        "", "flown by the policy (%)", "before arrival (%)", "solves saved (%)",
        "checks passed (%)", "success", "violations", "Δv / MPC's",
    ]  # fmt: skip
    return Table(head, lines)


def cost_table(results: Results) -> Table:
    """Makes the table of the times of steps, energy by TDP, and gains."""
    lines = []
    for name in results:
        cost = numbers.costs(results, name)
        if cost["step_s"] is None:
            continue
        lines.append(
            [
                name,
                number(cost, "policy_s", ".3f", 1e3),
                number(cost, "solve_s", ".3f", 1e3),
                number(cost, "saved", ".1f", 100.0),
                number(cost, "step_s", ".3f", 1e3),
                number(cost, "step_s", ".4f", numbers.CPU_W),
                number(cost, "gain_arithmetic", ".2f"),
                number(cost, "gain_measured", ".2f"),
            ]
        )
    head = [
        "", "network, median (ms)", "a solve, mean (ms)", "solves saved (%)",
        "a step in all, mean (ms)", f"at {numbers.CPU_W:g} W (J)", "gain, by arithmetic",
        "measured",
    ]  # fmt: skip
    return Table(head, lines)


def controller_figures(results: Results) -> dict[str, dict[str, Any]]:
    """Returns each controller's figures with its costs; see `without_flights`."""
    return {
        name: without_flights(result)
        | {
            "checks_passed": numbers.checks_passed(result),
            "flights_that_lost_the_body": numbers.blind_flights(result),
            "costs": numbers.costs(results, name),
        }
        for name, result in results.items()
    }


def comparison_lines(
    results: Results, scenario: Scenario, trained: Mapping[str, Stage]
) -> list[list[str]]:
    """Returns a line for each number of the paper: its name, the paper's value, and ours."""
    lidar, craft = scenario.lidar, scenario.spacecraft
    mpc, policy = numbers.costs(results, EXPERT), numbers.costs(results, flights.POLICY)
    mpc_s, policy_s = mpc["mpc_s"], policy["policy_s"]
    assert mpc_s is not None
    assert policy_s is not None
    energy = numbers.energy_share(policy_s, numbers.CPU_W, mpc_s, numbers.CPU_W)
    paper_gain = {
        name: numbers.gain(numbers.POLICY_SHARE, seconds * watts, numbers.MPC_S * numbers.CPU_W)
        for name, seconds, watts in (
            ("GPU", numbers.POLICY_GPU_S, numbers.GPU_W),
            ("CPU", numbers.POLICY_CPU_S, numbers.CPU_W),
        )
    }
    data = trained.get("data-paper")
    kinds = {} if data is None else data.result["kinds"]
    lines = [
        ["transits collected", "about 400", _collected(data)],
        ["of them as the MPC flies", "100", str(kinds.get("nominal", _NOT_RUN))],
        ["of them disturbed", "about 300", str(kinds.get("random_walk", _NOT_RUN))],
        ["a frame, rays × planes", "360 × 12", f"{lidar.rays} × {lidar.planes}"],
        ["no return, to the paper's network", "-100", "-100"],
        ["cube of positions (km)", "340", f"{scenario.transit.cube_m / 1e3:g}"],
        ["training, validation, test (%)", "60, 20, 20", "60, 20, 20"],
        ["thrust per axis (N)", "7", f"{craft.thrust_limit_n:g}"],
        ["check of the fixed hybrid, 1 step in", "10", str(scenario.hybrid.check_period)],
        ["MPC, a step, median (s)", f"{numbers.MPC_S}", f"{mpc_s:.5f}"],
        ["policy, a step, GPU (s)", f"{numbers.POLICY_GPU_S}", "runs on the CPU"],
        ["policy, a step, CPU, median (s)", f"{numbers.POLICY_CPU_S}", f"{policy_s:.5f}"],
        ["MPC over policy, CPU", f"{numbers.MPC_S / numbers.POLICY_CPU_S:.1f}",
         f"{mpc_s / policy_s:.1f}"],
        ["energy of a step, policy on GPU / MPC (%)", f"{100 * numbers.PAPER_ENERGY_GPU:.1f}",
         "runs on the CPU"],
        ["energy of a step, policy on CPU / MPC (%)", f"{100 * numbers.PAPER_ENERGY_CPU:.1f}",
         f"{100 * energy:.1f}"],
        ["pure policy, paper's recipe", "does not arrive, may crash",
         _success(results, flights.PAPER_POLICY)],
        ["pure policy, ours", DASH, _success(results, flights.POLICY)],
        ["its flights that lose the body from lidar range", "the one shown",
         _lost(results, flights.PAPER_POLICY)],
        ["the same, ours", DASH, _lost(results, flights.POLICY)],
    ]  # fmt: skip
    share = f"up to {100 * numbers.POLICY_SHARE:.0f}"
    for name in (flights.PAPER_HYBRID, flights.PAPER_GATE, flights.STRICT, flights.ADAPTIVE):
        paper = name == flights.PAPER_HYBRID
        lines.append([f"{name}: success", "arrives" if paper else DASH, _success(results, name)])
        lines += [
            [f"{name}: flown by the policy (%)", share, _share(results, name, "policy_share")],
            [f"{name}: before arrival (%)", DASH,
             _share(results, name, "policy_share_to_arrival")],
        ]  # fmt: skip
    for name in (flights.ZERO_PAPER, flights.ZERO_STRICT, flights.ZERO_ADAPTIVE):
        lines.append([f"{name}: flown by it (%)", DASH, _share(results, name, "policy_share")])
    told = ", ".join(f"{value:.2f} ({name})" for name, value in paper_gain.items())
    for name in (flights.PAPER_GATE, flights.STRICT, flights.ADAPTIVE):
        cost = numbers.costs(results, name)
        lines.append(
            [f"{name}: energy gained over the MPC alone, by arithmetic", told,
             number(cost, "gain_arithmetic", ".2f")]
        )  # fmt: skip
        lines.append(
            [f"{name}: the same by all solves' cost", DASH, number(cost, "gain_measured", ".2f")]
        )
    return lines


def _collected(data: Stage | None) -> str:
    return _NOT_RUN if data is None else str(data.result["all"]["flights"])


def _success(results: Results, name: str) -> str:
    if name not in results:
        return _NOT_RUN
    result = results[name]
    crashed = result["collisions"]
    return (
        f"{successes_text(result)} ({interval_text(result['success_rate_exact_interval'])}), "
        f"{crashed} crash{'' if crashed == 1 else 'es'}"
    )


def _lost(results: Results, name: str) -> str:
    if name not in results:
        return _NOT_RUN
    return f"{numbers.blind_flights(results[name])} of {results[name]['transits']}"


def _share(results: Results, name: str, key: str) -> str:
    return _NOT_RUN if name not in results else number(results[name], key, ".1f", 100.0)
