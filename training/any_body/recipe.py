"""The recipe for any body: from the expert's plans at a family of bodies to a bundle that flies."""

from __future__ import annotations

import dataclasses as dc
import hashlib
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from proxops.diagrams.flight import Workers, surroundings
from proxops.diagrams.scenario import Scenario, load_body, load_scenario
from proxops.systems.common import Progress, write_json, write_whole
from proxops.systems.policy import Surroundings
from proxops.training.any_body.examples import Examples, examples_of, mirrored
from proxops.training.any_body.export import export_guidance, ranges_of
from proxops.training.any_body.family import write_family
from proxops.training.any_body.member_plans import family_plans
from proxops.training.any_body.network import AnyBodyGuidance
from proxops.training.any_body.settings import AnyBodySettings
from proxops.training.data import Labels
from proxops.training.loop import (
    TensorBatches,
    Trained,
    TrainingTask,
    force_loss,
    seeded,
    train,
)
from proxops.training.reports import Section, Table, Text, markdown_page

# Shares of the whole work at which the family is written, and its plans are computed.
_WRITTEN, _PLANNED = 0.05, 0.7
_FAMILY_SEED, _PLANS_SEED = 1, 1
# Of the training, on any machine: last bits depend on it. Two take 0.6 of the time of one.
_THREADS = 2
# Number of examples on which the exported network is compared with the trained one.
_COMPARED = 64


@dc.dataclass(frozen=True)
class Family:
    """The members that a guidance learns at, and what it is told of them."""

    scenarios: Sequence[Scenario]
    surroundings: Sequence[Surroundings]
    held: int
    """So many of them, from the last, only show how well it flies where it did not learn."""

    @property
    def learned(self) -> int:
        """Number of members that are learned at."""
        return len(self.scenarios) - self.held


def train_any_body(
    out: Path, settings: AnyBodySettings, workers: Workers = Workers()
) -> dict[str, Any]:
    """Trains a guidance for any body; writes and returns the report.

    Writes family/ (bodies and scenarios), plans/, guidance.ckpt, curves/, report.json, report.md,
    and bundle/, which flies, to `out`. After a kill it continues behind the last complete epoch,
    and computes only the plans that are missing.

    Args:
      workers: compute the plans, and report the progress.

    Raises:
      InputError: see `family_plans` and `train`.
    """
    family, labels = known_family(out, settings, workers.part(0.0, _PLANNED))
    progress = workers.part(_PLANNED, 1.0).progress
    return learn(family, labels, settings, out, {"recipe": "any-body"}, progress)


def known_family(
    folder: Path, settings: AnyBodySettings, workers: Workers
) -> tuple[Family, Labels]:
    """The family in a folder and the expert's plans there; what is missing is made.

    Raises:
      InputError: see `family_plans`.
    """
    workers.progress(0.0, "making bodies")
    paths = write_family(folder / "family", _FAMILY_SEED, settings.members)
    scenarios = [load_scenario(path) for path in paths]
    labels = family_plans(
        scenarios, settings.transits, _PLANS_SEED, folder / "plans", workers.part(_WRITTEN, 1.0)
    )
    return family_of(scenarios, settings.held), labels


def family_of(scenarios: Sequence[Scenario], held: int) -> Family:
    """The family of some scenarios, of which the last `held` are not learned from."""
    return Family(scenarios, [_as_the_expert(each) for each in scenarios], held)


def _as_the_expert(scenario: Scenario) -> Surroundings:
    """What a guidance is told while it learns: of the ellipsoid that the expert keeps out of."""
    policy = dc.replace(scenario.policy, margin_m=scenario.mpc.keep_out_margin_m)
    return surroundings(dc.replace(scenario, policy=policy), load_body(scenario.body))


def learn(
    family: Family,
    labels: Labels,
    settings: AnyBodySettings,
    out: Path,
    told: dict[str, Any],
    progress: Progress,
    kind: type[AnyBodyGuidance] = AnyBodyGuidance,
) -> dict[str, Any]:
    """Trains a guidance from nothing on labels; writes it to a folder and returns the report.

    Args:
      family: the members. labels: with the column `member`.
      settings: seed, width and schedule.
      out: for guidance.ckpt, curves/, report.json, report.md and bundle/.
      told: for the report, with `recipe`.
      progress: of the training.
      kind: of network.

    Raises:
      InputError: see `train`.
    """
    masses = [each.spacecraft.mass_kg for each in family.scenarios]
    examples = examples_of(labels, family.surroundings, masses)
    data = _sha256(examples)
    held = labels["member"] >= family.learned
    with seeded(settings.seed):
        network = kind(settings.width)
    learned, unseen = (_rows(examples, chosen) for chosen in (~held, held))
    task = guidance_task(network, learned, unseen, settings, f"proxops any-body, data {data}")
    options: Any = {"device": settings.device, "precision": settings.precision}
    trained = train(task, out, settings.seed, progress=progress, **options)
    network = network.cpu().eval()
    ranges = ranges_of(family.surroundings[: family.learned])
    made = {"proxops": metadata.version("proxops"), "data_sha256": data}
    told = told | made | {"settings": dc.asdict(settings)}
    report = told | _report(trained, (learned, unseen), network)
    text = _page(report, ranges)
    compared = examples.given[:: max(1, len(held) // _COMPARED)]
    export_guidance(network, out / "bundle", compared, ranges, report, text)
    write_whole(out / "report.md", lambda path: path.write_text(text, encoding="utf-8"))
    write_json(out / "report.json", report)
    progress(1.0, "done")
    return report


def guidance_task(
    network: AnyBodyGuidance,
    training: Examples,
    validation: Examples,
    settings: AnyBodySettings,
    identity: str,
) -> TrainingTask:
    """The guidance learns the expert's forces, at the bodies and at mirrored and turned ones.

    The last epoch is kept: see the pilot's `guidance_task`.
    """

    def loss(network: nn.Module, batch: tuple[Tensor, ...]) -> Tensor:
        given, force = batch
        if network.training:
            turn, mirror = (2.0 * (torch.rand(len(given), 1) < 0.5).to(given) - 1.0 for _ in "ab")
            given, force = mirrored(given, force, torch.cat([turn, turn, mirror], dim=1))
        return force_loss(network(given), force, 1.0)

    schedule = settings.schedule
    batches = TensorBatches(training, schedule.batch, shuffle=True, seed=settings.seed)
    held = TensorBatches(validation, 8192)
    text = f"{identity}, {settings}"
    return TrainingTask(
        "guidance", network, loss, batches, held, schedule, text, threads=_THREADS, keep_last=True
    )


def _rows(examples: Examples, chosen: np.ndarray) -> Examples:
    """The examples that a mask (N,) chooses."""
    rows = torch.from_numpy(np.flatnonzero(chosen))
    return Examples(*(column[rows] for column in examples))


def _sha256(examples: Examples) -> str:
    """Hash of all that a guidance learns from."""
    data = hashlib.sha256()
    for column in examples:
        data.update(column.numpy().tobytes())
    return data.hexdigest()


@torch.no_grad()
def _report(
    trained: Trained, parts: Sequence[Examples], network: AnyBodyGuidance
) -> dict[str, Any]:
    """The part of the report that says how the training went."""
    last = trained.history[-1]
    errors = {}
    for name, part in zip(("training", "held out"), parts, strict=True):
        off = torch.cat([network(rows).clamp(-1.0, 1.0) for rows in part.given.split(8192)])
        off = (off - part.force).norm(dim=1)
        errors[name] = {
            "states": len(off),
            "rms": float(off.square().mean().sqrt()),
            "median": float(off.median()),
        }
    return {
        "parameters": sum(weights.numel() for weights in network.parameters()),
        "training": {
            "epochs": len(trained.history),
            "training_loss": last["training_loss"],
            "validation_loss": last["validation_loss"],
            "cpu_s": trained.cpu_s,
        },
        "force_errors": errors,
    }


def _page(report: dict[str, Any], ranges: dict[str, list[float]]) -> str:
    """The text of the report for people."""
    run = report["training"]
    errors = [
        [name, str(row["states"]), f"{row['rms']:.3f}", f"{row['median']:.3f}"]
        for name, row in report["force_errors"].items()
    ]
    family = [[name, f"{low:.3g}", f"{high:.3g}"] for name, (low, high) in ranges.items()]
    sections = [
        Section(
            "Training",
            [
                Text(
                    f"{run['epochs']} epochs, {run['cpu_s']:.0f} s of processor time, loss "
                    f"{run['training_loss']:.4f}, and {run['validation_loss']:.4f} at the bodies "
                    "that were held out."
                ),
                Text("Errors of the force over the thrust limit:"),
                Table(["", "states", "rms", "median"], errors),
            ],
        ),
        Section(
            "What it learned",
            [
                Text(
                    "It is told the nearest value within these ranges, and refuses to fly where "
                    "one is too far outside."
                ),
                Table(["proportion", "least", "greatest"], family),
            ],
        ),
    ]
    return markdown_page("A guidance for any body", sections)
