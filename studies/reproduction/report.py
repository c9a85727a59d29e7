"""The report of the paper's reproduction: each figure and number of the paper beside ours."""

from __future__ import annotations

from importlib import metadata
from typing import Any

from proxops.diagrams.scenario import TrueStateConfig
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
    """Makes the report, which `write_report` writes."""
    return [
        _head(findings),
        Section("The paper's numbers, and ours", _comparison(findings)),
        Section("The controllers on the same transits", _controllers(findings)),
        Section("Gates compared", _gates(findings)),
        Section("Time and energy of a step", _costs(findings)),
        *figure_sections(findings),
    ]


def findings_json(findings: Findings) -> dict[str, Any]:
    """Makes the content of report.json; the flights' rows are in the record of their stage."""
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
            name: force_figures(*forces, findings.scenario.spacecraft.thrust_limit_n)
            for name, forces in findings.forces.items()
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
            "collision and no keep-out violation; intervals are exact ones, of 95 %."
        ),
        stage_table(findings.stages),
    ]
    if findings.missing:
        names = ", ".join(STAGE_NAMES[name] for name in findings.missing)
        blocks.append(
            Text(
                f"Not run, now or earlier: {names}. Figures that "
                "need them are missing below or marked so. Without --quick all stages are run."
            )
        )
    return Section("What was run", blocks)


def _comparison(findings: Findings) -> list[Block]:
    lines = comparison_lines(findings.results, findings.scenario, findings.trained)
    return [
        Table(["", "paper", "ours"], lines),
        Text(
            "Times were measured on this machine with several flights at once; compare them with "
            "each other rather than with the paper's. The paper's 21.6 % is 0.053 s × 300 W over "
            "0.473 s × 155 W, for one step of a policy that flies alone. A hybrid runs the policy "
            "at every step and the MPC at some, so its gain is 1 / ((1 − saved) + policy time / "
            "MPC time). Our policy and our MPC run on the same CPU, so TDP cancels."
        ),
    ]


def _controllers(findings: Findings) -> list[Block]:
    return [
        controller_table(findings.results),
        Text(
            "Lost counts flights with a step at which no ray of the lidar returns. Δv / MPC's is "
            f"over the transits in which both succeed. {_told(findings)} Assured means with "
            "runtime assurance between policy and thrusters; it is off in all other rows. Zero "
            "commands no force. The second PD controller uses the state that the policy estimates."
        ),
    ]


def _told(findings: Findings) -> str:
    """Says from what the controllers know the state."""
    who = "The MPC, the hybrid's check, runtime assurance and PD"
    if isinstance(findings.scenario.navigation, TrueStateConfig):
        return f"{who} use the true state (navigation: !TrueState), as the paper's do."
    return f"{who} use the state that the lidar navigation makes of the frames; the paper's do not."


def _gates(findings: Findings) -> list[Block]:
    results = findings.results
    # Only hybrids compare forces.
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
            "Always zero is the hybrid with a policy that never thrusts. Its share is what a "
            "policy gets that has learned nothing."
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
            "Gain by arithmetic is 1 / ((1 − saved) + policy time / MPC time), from medians; the "
            "MPC's time is that of its own flights. Gain measured is the MPC's mean time of a step "
            "over that of the whole controller, with all solves (a solve takes longer after a "
            "pause), the network and the decisions. Energy is time times the TDP of the paper's "
            "CPU."
        ),
    ]
