"""The report of the paper's reproduction: each of its figures and numbers, with ours beside it."""

from __future__ import annotations

from importlib import metadata
from typing import Any

from proxops.studies.evaluation import EXPERT, arrival_text
from proxops.studies.reproduction.figures import plot_gates
from proxops.studies.reproduction.findings import (
    STAGE_NAMES,
    Findings,
    effort_figures,
    error_figures,
)
from proxops.studies.reproduction.numbers import checks_passed, costs
from proxops.studies.reproduction.pictures import figure_sections
from proxops.studies.reproduction.tables import (
    comparison_lines,
    controller_figures,
    controller_table,
    cost_table,
    gate_table,
    stage_table,
)
from proxops.training.reports import Block, Section, Table, Text, force_figures, picture


def reproduction_sections(findings: Findings) -> list[Section]:
    """The report, to be written by `write_report`."""
    return [
        _head(findings),
        Section("The paper's numbers, and ours", _comparison(findings)),
        Section("Who flies how", _controllers(findings)),
        Section("Gates compared", _gates(findings)),
        Section("What a step costs", _costs(findings)),
        *figure_sections(findings),
    ]


def findings_json(findings: Findings) -> dict[str, Any]:
    """What report.json holds; the flights' rows are in the record of their stage."""
    return {
        "proxops_version": metadata.version("proxops"),
        "command": findings.command,
        "seed": findings.seed,
        "policy_sha256": findings.policy.sha256,
        "stages": [
            {"name": stage.name, "folder": stage.folder.name, "wall_s": stage.wall_s,
             "skipped": stage.skipped}
            for stage in findings.stages
        ],
        "not_run": list(findings.missing),
        "paper_and_ours": [
            dict(zip(("what", "paper", "ours"), line, strict=True))
            for line in comparison_lines(findings.results, findings.scenario, findings.trained)
        ],
        "controllers": controller_figures(findings.results),
        "forces_along_the_mpc": {
            name: force_figures(*forces) for name, forces in findings.forces.items()
        },
        "forces_on_the_test_part": {
            name: stage.result["parts"]["test"]
            for name, stage in findings.trained.items()
            if "parts" in stage.result
        },
        "path_errors_m": error_figures(findings),
        "efforts_n": effort_figures(findings),
    }  # fmt: skip


def _head(findings: Findings) -> Section:
    count = findings.results[EXPERT]["transits"]
    arrival = findings.scenario.arrival
    blocks: list[Block] = [
        Text(findings.command, code=True),
        Text(
            f"{findings.body.config.name}, proxops {metadata.version('proxops')}. Each controller "
            f"flies the same {count} transits of seed {findings.seed}, which nothing was trained "
            f"on. Success is arrival within {arrival_text(arrival)} of the goal by "
            f"{arrival.deadline_s:g} s, to stay there for {arrival.dwell_s:g} s, with no "
            "collision and no keep-out violation; intervals are Wilson's, of 95 %."
        ),
        stage_table(findings.stages),
    ]
    if findings.missing:
        names = ", ".join(STAGE_NAMES[name] for name in findings.missing)
        blocks.append(
            Text(
                f"Not run, and not there from an earlier run: {names}. What depends on them is "
                "missing below, or marked so; without --quick all of it is run."
            )
        )
    return Section("What was run", blocks)


def _comparison(findings: Findings) -> list[Block]:
    lines = comparison_lines(findings.results, findings.scenario, findings.trained)
    return [
        Table(["", "paper", "ours"], lines),
        Text(
            "Times are this machine's, several flights at once, so compare them with each other "
            "rather than with the paper's. The paper's 21.6 % is 0.053 s × 300 W over 0.473 s × "
            "155 W: of one step, and of a policy that flies alone. The hybrid asks the MPC as "
            "well, and the policy at every step, so that its gain is 1 / ((1 − saved) + policy "
            "time / MPC time). Our policy runs on the CPU that the MPC runs on: TDP cancels."
        ),
    ]


def _controllers(findings: Findings) -> list[Block]:
    return [
        controller_table(findings.results),
        Text(
            "Lost: flights with a step at which no ray of the lidar returns. Δv is over the "
            "MPC's, of the transits in which both succeed. Assured: with runtime assurance "
            "between policy and thrusters; it is off in all other rows. Zero commands nothing at "
            "all; the PD controllers know the true state, or what the policy takes it to be."
        ),
    ]


def _gates(findings: Findings) -> list[Block]:
    results = findings.results
    # Of those that fly, the hybrids are the ones that compare forces.
    shown = [name for name in results if checks_passed(results[name]) is not None]
    points = {
        name: (
            costs(results, name)["saved"] or 0.0,
            results[name].get("expert_delta_v_ratio") or float("nan"),
            results[name]["min_clearance_m"],
        )
        for name in shown
    }
    blocks: list[Block] = [
        gate_table(results, shown),
        Text(
            "Always zero is the hybrid with a policy that never thrusts: the share that a policy "
            "gets for having learned nothing. What a gate lets pass of it is no merit."
        ),
    ]
    if points:
        caption = "Solves saved against fuel and clearance, over all transits."
        blocks.append(picture("gates", plot_gates(points), caption))
    return blocks


def _costs(findings: Findings) -> list[Block]:
    return [
        cost_table(findings.results),
        Text(
            "By arithmetic: 1 / ((1 − saved) + policy time / MPC time), from medians, the MPC's of "
            "its own flights. Measured: the MPC's mean time of a step over the whole controller's, "
            "with what all its solves (after a pause a solve takes longer), its network and its "
            "decisions really took. Energy is time times the TDP of the paper's CPU."
        ),
    ]
