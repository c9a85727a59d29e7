"""The report of a recipe, with the policy's forces against the MPC's, and the policy's bundle."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch

from proxops.diagrams.yaml_files import parse_mapping
from proxops.systems.common import write_json
from proxops.systems.policy import PolicyFacts
from proxops.training.data import PARTS, PackedFlights, part_rows
from proxops.training.export.policy_export import export_policy
from proxops.training.reports import (
    HISTOGRAMS_CAPTION,
    force_figures,
    picture,
    plot_forces,
    policy_sections,
    write_markdown,
)

# Number of flights, of similar length, that are replayed together.
_TOGETHER = 16
# Number of steps on which the exported policy is compared with the trained one.
_CHECKED_STEPS = 20


@torch.no_grad()
def replay_flights(policy: Any, flights: PackedFlights, part: str) -> tuple[np.ndarray, np.ndarray]:
    """Forces (K, 3) in N of the MPC and of the policy at every labelled step of a part's flights.

    The policy gets each flight from its start and keeps its memory, as in flight.

    Args:
      policy: a module with `sequence(frames, target, commanded_force)`, which gives forces first.
    """
    said: dict[str, np.ndarray] = {}
    device = next(policy.parameters()).device
    ordered = sorted(flights.part(part), key=lambda flight: flight.steps)
    for first in range(0, len(ordered), _TOGETHER):
        group = ordered[first : first + _TOGETHER]
        # The last row of a flight is repeated up to the length of the longest flight.
        steps = np.arange(group[-1].steps)
        rows = np.array([each.start + np.minimum(steps, each.steps - 1) for each in group])
        frames = flights.frames(rows.ravel()).reshape(*rows.shape, *_geometry(flights))
        given = (frames, flights.target[rows], flights.commanded_force[rows])
        inputs = (torch.from_numpy(each.astype(np.float32)).to(device) for each in given)
        forces = policy.sequence(*inputs)[0].cpu().numpy()
        for flight, force in zip(group, forces, strict=True):
            said[flight.name] = force[: flight.steps]
    rows = part_rows(flights, part)
    wanted = flights.mpc_force[rows]
    asked = np.isfinite(wanted).all(axis=1)
    answers = [np.zeros((0, 3)), *(said[flight.name] for flight in flights.part(part))]
    return wanted[asked], np.concatenate(answers)[asked]


def _geometry(flights: PackedFlights) -> tuple[int, int]:
    return flights.setting.planes, flights.setting.rays


def write_report(
    policy: Any, flights: PackedFlights, report: dict[str, Any], out: Path
) -> dict[str, Any]:
    """Adds the errors of force by part to a recipe's report; writes it, and forces.png.

    Args:
      report: with `recipe`, `settings` and `training`, the last as `policy_sections` takes it.
    """
    forces = {part: replay_flights(policy, flights, part) for part in PARTS}
    limit = flights.setting.thrust_limit_n
    report = report | {
        "parts": {
            part: {"flights": len(flights.part(part)), **force_figures(*forces[part], limit)}
            for part in PARTS
        }
    }
    figure = plot_forces(*forces["test"], limit)
    histograms = picture("forces", figure, HISTOGRAMS_CAPTION)
    write_markdown(out, report_title(report), policy_sections(report, histograms))
    write_json(out / "report.json", report)
    return report


def report_title(report: Mapping[str, Any]) -> str:
    """The title of the report on a recipe's policy."""
    return f"Policy by the {report['recipe']} recipe"


def export_recipe(
    policy: torch.nn.Module,
    flights: PackedFlights,
    folder: Path,
    *,
    recipe: str,
    memory: int,
    estimates: bool,
    data_sha256: str,
    metrics: dict[str, Any],
    report: str | None = None,
) -> None:
    """Exports a policy for the lidar, body and spacecraft of the flights; see `export_policy`."""
    setting = flights.setting
    facts = PolicyFacts(
        recipe=recipe,
        planes=setting.planes,
        rays=setting.rays,
        period=setting.control_period_s,
        thrust_limit=setting.thrust_limit_n,
        memory=memory,
        estimates=estimates,
        body=parse_mapping(setting.body, "the body")["name"],
        shape_sha256=setting.shape_sha256,
        data_sha256=data_sha256,
        metrics=metrics,
    )
    first = next(flight for part in reversed(PARTS) for flight in flights.part(part))
    rows = np.arange(first.start, first.start + min(first.steps, _CHECKED_STEPS))
    frames = flights.frames(rows).reshape(len(rows), -1)
    example = (frames, flights.target[rows], flights.commanded_force[rows])
    export_policy(policy, folder, facts, [example], report)
