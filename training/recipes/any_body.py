"""The recipe for any body: from the expert's plans at a family of bodies to a bundle that flies."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from proxops.diagrams.flight import Workers, surroundings
from proxops.diagrams.scenario import Scenario, load_body, load_scenario
from proxops.systems.common import Progress, write_json, write_whole
from proxops.systems.policy import INPUTS, Surroundings
from proxops.training.data import Labels
from proxops.training.export import export_guidance
from proxops.training.loop import Schedule, TrainingTask, seeded
from proxops.training.networks import AnyBodyGuidance
from proxops.training.recipes.family import family_plans, write_family
from proxops.training.recipes.recipe import (
    Learner,
    RecipeSettings,
    Round,
    force_loss,
    learned,
    report_head,
    sha256_of,
    trained_settings,
    trained_text,
)
from proxops.training.reports import Section, Table, Text, markdown_page

# Shares of the whole work at which the family is written, and its plans are computed.
_WRITTEN, _PLANNED = 0.05, 0.7
_FAMILY_SEED, _PLANS_SEED = 1, 1
# Of the training, on any machine: last bits depend on it. Two take 0.6 of the time of one.
_THREADS = 2
# Number of examples on which the exported network is compared with the trained one.
_COMPARED = 64
# Vectors of a row of inputs: state, goal, and both natural accelerations.
_VECTORS = 5
# Epochs of a round: more than the first training, because there is more to learn.
_ROUND_EPOCHS = 80
# So many states of a flight are labelled: more flights teach more than more of the states of one.
_STATES = 100


@dc.dataclass(frozen=True, kw_only=True)
class AnyBodySettings(RecipeSettings):
    """Settings of a training for any body: sizes of the family and of the network, the schedule."""

    members: int = 180
    """Bodies, each with a spacecraft of its own proportions."""
    held: int = 10
    """Of them, from the last: only their loss is looked at."""
    transits: int = 160
    """Transits at each body whose plans are learned from."""
    width: int = 320
    """Width of the network's layers."""
    schedule: Schedule = Schedule(epochs=30, batch=1024, learning_rate=2e-3)

    def quick(self) -> AnyBodySettings:
        """Settings for a first try of a few minutes; what it gives flies less well."""
        schedule = dc.replace(self.schedule, epochs=8, batch=256)
        return dc.replace(self, members=6, held=1, transits=20, width=64, schedule=schedule)


@dc.dataclass(frozen=True)
class Family:
    """The members that a guidance learns at, and what it is told of them."""

    scenarios: Sequence[Scenario]
    surroundings: Sequence[Surroundings]
    held: int
    """So many of them, from the last, only show how well it flies where it did not learn."""

    @classmethod
    def of(cls, scenarios: Sequence[Scenario], held: int) -> Family:
        """The family of some scenarios, of which the last `held` are not learned from.

        While it learns, a guidance is told of the ellipsoid that the expert keeps out of.
        """
        told = []
        for scenario in scenarios:
            policy = dc.replace(scenario.policy, margin_m=scenario.mpc.keep_out_margin_m)
            told.append(surroundings(dc.replace(scenario, policy=policy), load_body(scenario.body)))
        return cls(scenarios, told, held)

    @property
    def learned(self) -> int:
        """Number of members that are learned at."""
        return len(self.scenarios) - self.held


class Examples(NamedTuple):
    """Rows of inputs and the expert's forces there."""

    given: Tensor
    """(N, 23): `Surroundings.inputs`."""
    force: Tensor
    """(N, 3) over the thrust limit, in K."""


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
    return learn(family, labels, settings, out, "any-body", progress)


def any_body_learner(first: Path, dispersions: str | None, workers: Workers) -> Learner:
    """The guidance in a folder, which DAgger goes on with: it flies at each member, on navigation.

    Args:
      first: what `train_any_body` wrote.
      dispersions: the worlds that the first round flies in; None: as believed. Later rounds fly as
        believed, which takes a third of the time.

    Raises:
      InputError: there is none, or it was trained by another version.
    """
    settings, _ = trained_settings(first, AnyBodySettings, "any-body")
    family, labels = known_family(first, settings, workers)

    def scenarios(number: int) -> list[Scenario]:
        worlds = dispersions if number == 1 else None
        # With the margin of flights, not the expert's, a member at the edge may be just beyond.
        return [
            dc.replace(each, policy=dc.replace(each.policy, beyond_family=True), dispersions=worlds)
            for each in family.scenarios[: family.learned]
        ]

    def learn_more(labels: Labels, folder: Path, this: Round, progress: Progress) -> dict[str, Any]:
        own = settings.limited(this.epochs or _ROUND_EPOCHS)
        own = dc.replace(own, seed=settings.seed + this.number)
        told = {"rounds": list(this.outcomes)}
        return learn(family, labels, own, folder, "any-body, DAgger", progress, told)

    files = ("report.json", "report.md")
    # The examples are over each member's own mass, so that flies in all worlds.
    return Learner(
        first, labels, scenarios, learn_more, files, flights=3, states=_STATES, own_mass=True
    )


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
    plans = workers.part(_WRITTEN, 1.0)
    labels = family_plans(scenarios, settings.transits, _PLANS_SEED, folder / "plans", plans)
    return Family.of(scenarios, settings.held), labels


def learn(
    family: Family,
    labels: Labels,
    settings: AnyBodySettings,
    out: Path,
    recipe: str,
    progress: Progress,
    told: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """Trains a guidance from nothing on labels; writes it to a folder and returns the report.

    Args:
      family: the members. labels: with the column `member`.
      settings: seed, width and schedule.
      out: for guidance.ckpt, curves/, report.json, report.md and bundle/.
      recipe: its name in the report. told: what the report says besides.
      progress: of the training.

    Raises:
      InputError: see `train`.
    """
    examples = examples_of(labels, family)
    data = sha256_of(examples)
    held = labels["member"] >= family.learned
    parts = {"training": _rows(examples, ~held), "held out": _rows(examples, held)}
    with seeded(settings.seed):
        network = AnyBodyGuidance(settings.width)
    seen, unseen = parts.values()
    task = guidance_task(network, seen, unseen, settings, f"proxops any-body, data {data}")
    figures = learned(task, out, settings, progress).figures()
    network.eval()
    report = report_head(recipe, settings, {"data_sha256": data}) | (told or {})
    report |= {
        "parameters": sum(weights.numel() for weights in network.parameters()),
        "training": figures,
        "force_errors": {name: force_errors(network, part) for name, part in parts.items()},
    }
    ranges = ranges_of(family.surroundings[: family.learned])
    text = markdown_page("A guidance for any body", _sections(report, ranges))
    compared = examples.given[:: max(1, len(held) // _COMPARED)]
    export_guidance(network, out / "bundle", compared, ranges, report, text)
    write_whole(out / "report.md", lambda path: path.write_text(text, encoding="utf-8"))
    write_json(out / "report.json", report)
    progress(1.0, "done")
    return report


def examples_of(labels: Labels, family: Family) -> Examples:
    """The examples of labels that say which member of the family they are of."""
    count = len(labels["member"])
    given = np.empty((count, INPUTS), dtype=np.float32)
    force = np.empty((count, 3), dtype=np.float32)
    for k, around in enumerate(family.surroundings):
        rows, mass = np.flatnonzero(labels["member"] == k), family.scenarios[k].spacecraft.mass_kg
        given[rows] = around.inputs(labels["state"][rows], labels["goal"][rows])
        force[rows] = labels["force"][rows] / (mass * around.acceleration)
    return Examples(torch.from_numpy(given), torch.from_numpy(force))


def _rows(examples: Examples, chosen: np.ndarray) -> Examples:
    """The examples that a mask (N,) chooses."""
    rows = torch.from_numpy(np.flatnonzero(chosen))
    return Examples(*(column[rows] for column in examples))


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

    return TrainingTask.on_tensors(
        "guidance",
        network,
        loss,
        (training, validation),
        settings.schedule,
        settings.seed,
        f"{identity}, {settings}",
        held_size=8192,
        threads=_THREADS,
        keep_last=True,
    )


def mirrored(given: Tensor, force: Tensor, signs: Tensor) -> tuple[Tensor, Tensor]:
    """The same examples at bodies that are mirrored or turned, where the expert flies likewise.

    A body mirrored in its equator spins as before, and so does one that is turned by half a turn
    about its axis: it is at another time.

    Args:
      given, force: (B, 23) and (B, 3).
      signs: (B, 3) of 1 and -1, of the axes; those of x and y are equal.
    """
    vectors = given[:, : 3 * _VECTORS].unflatten(1, (_VECTORS, 3)) * signs[:, None]
    rest = given[:, 3 * _VECTORS :]
    return torch.cat([vectors.flatten(1), rest], dim=1), force * signs


@torch.no_grad()
def force_errors(network: AnyBodyGuidance, part: Examples) -> dict[str, float]:
    """Errors of the forces over the thrust limit, at its states: their number, rms and median."""
    off = torch.cat([network(rows).clamp(-1.0, 1.0) for rows in part.given.split(8192)])
    off = (off - part.force).norm(dim=1)
    rms = float(off.square().mean().sqrt())
    return {"states": len(off), "rms": rms, "median": float(off.median())}


def ranges_of(members: Sequence[Surroundings]) -> dict[str, list[float]]:
    """Least and greatest value of each of `Surroundings.numbers` over members of a family."""
    numbers = [member.numbers() for member in members]
    return {
        name: [min(each[name] for each in numbers), max(each[name] for each in numbers)]
        for name in numbers[0]
    }


def _sections(report: dict[str, Any], ranges: dict[str, list[float]]) -> list[Section]:
    """The report for people."""
    trained = trained_text(report["training"])
    errors = [
        [name, str(row["states"]), f"{row['rms']:.3f}", f"{row['median']:.3f}"]
        for name, row in report["force_errors"].items()
    ]
    table = Table(["", "states", "rms", "median"], errors)
    family = [[name, f"{low:.3g}", f"{high:.3g}"] for name, (low, high) in ranges.items()]
    told = Text(
        "It is told the nearest value within these ranges, and refuses to fly where one is too far "
        "outside."
    )
    return [
        Section("Training", [trained, Text("Errors of the force over the thrust limit:"), table]),
        Section("What it learned", [told, Table(["proportion", "least", "greatest"], family)]),
    ]
