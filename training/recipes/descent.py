"""The recipe for a descent: from plans at random places of generated bodies to a bundle that flies.

A plan takes a millisecond, and is a function of state and time left: so states are drawn about the
way down, as far off it as an unsure navigation may lead, and none has to be flown.
"""

from __future__ import annotations

import contextlib
import dataclasses as dc
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from proxops.assets.random_bodies import RandomBody, random_body
from proxops.diagrams.flight import Workers
from proxops.systems.common import SolverFailure, generator, write_json, write_whole
from proxops.systems.gravity import GravityField
from proxops.systems.policy import DESCENT_INPUTS
from proxops.systems.rotation import SteadySpin
from proxops.systems.shapes import Polyhedron
from proxops.systems.touch import (
    DescentConfig,
    DescentGuidance,
    Site,
    TouchPhase,
    descent_inputs,
)
from proxops.training.export import export_descent
from proxops.training.loop import Schedule, TrainingTask, seeded
from proxops.training.networks import DescentCorrection
from proxops.training.recipes.recipe import (
    RecipeSettings,
    learned,
    report_head,
    sha256_of,
    trained_text,
)
from proxops.training.reports import Section, Table, Text, markdown_page

_STREAM, _BODIES_SEED = 9, 5
# Lengths of bodies in m, and thrust over mass of spacecraft in m/s^2: log-uniform.
_LENGTHS, _PUSHES = (200.0, 2000.0), (2e-3, 4e-2)
# Heights, times and speed of a descent over those that are usual: log-uniform.
_SCALES = (0.6, 1.6)
# Standard deviations of states from the way down, in m and m/s: log-uniform.
_OFF, _FASTER = (0.02, 5.0), (5e-4, 0.04)
# Of the centre of mass over the ground at contact, in m: it hardly matters.
_HIGH = 3.0
_PLANNED = 0.7
_COMPARED = 64
# The loss is that of a force's error over its size; below this size, in the unit of
# `descent_inputs`, over that.
_SMALL = 0.5


@dc.dataclass(frozen=True, kw_only=True)
class DescentSettings(RecipeSettings):
    """Settings of a training for descents: sizes of examples and network, the schedule."""

    bodies: int = 60
    held: int = 6
    """Of them, from the last: only their loss is looked at."""
    sites: int = 20
    """Random places of each, whether they can be touched or not."""
    states: int = 120
    """At each place."""
    width: int = 96
    schedule: Schedule = Schedule(epochs=60, batch=512, learning_rate=2e-3)

    def quick(self) -> DescentSettings:
        """Settings for a first try; what it gives flies less well."""
        schedule = dc.replace(self.schedule, epochs=5, batch=128)
        return dc.replace(self, bodies=4, held=1, sites=3, states=30, width=32, schedule=schedule)


@dc.dataclass(frozen=True)
class Places:
    """Places of a generated body at which plans are made."""

    name: str
    number: int
    """Of the body."""
    settings: DescentSettings

    def compute(self) -> np.ndarray:
        """Rows (N, 28): inputs, the law, and the program's acceleration in the same unit."""
        random = generator(self.settings.seed, _STREAM, self.number)
        body = random_body(_BODIES_SEED, self.number)
        rows = []
        for _ in range(self.settings.sites):
            guidance = _guidance(random, body)
            with contextlib.suppress(SolverFailure):
                ways = _ways(guidance)
                rows += [_example(random, guidance, ways) for _ in range(self.settings.states)]
        return np.array(rows, dtype=np.float32).reshape(-1, DESCENT_INPUTS + 6)


class Examples(NamedTuple):
    """What a network learns from, in the unit of `descent_inputs`."""

    given: Tensor
    """(N, 22)"""
    law: Tensor
    """(N, 3)"""
    wanted: Tensor
    """(N, 3): the program's."""

    @classmethod
    def of(cls, rows: Sequence[np.ndarray]) -> Examples:
        """The examples of rows as `Places` gives them."""
        table = torch.from_numpy(np.concatenate(rows))
        return cls(*(part.contiguous() for part in table.split([DESCENT_INPUTS, 3, 3], dim=1)))


def train_descent(
    out: Path, settings: DescentSettings, workers: Workers = Workers()
) -> dict[str, Any]:
    """Trains a descent; writes and returns the report.

    Writes descent.ckpt, curves/, report.json, report.md, and bundle/, which flies, to `out`. After
    a kill the plans are made again, and training continues behind the last complete epoch.

    Raises:
      InputError: see `train`.
    """
    pieces = [Places(f"body-{k:03d}", k, settings) for k in range(settings.bodies)]
    rows: dict[str, np.ndarray] = {}
    planning = workers.part(0.0, _PLANNED).progress
    for name, result in workers.results(pieces, Places.compute):
        rows[name] = result
        planning(len(rows) / len(pieces), f"plans at bodies, {len(rows)} of {len(pieces)}")
    kept = [rows[piece.name] for piece in pieces]
    seen, unseen = (Examples.of(part) for part in (kept[: -settings.held], kept[-settings.held :]))
    data = sha256_of([*seen, *unseen])
    with seeded(settings.seed):
        network = DescentCorrection(settings.width)
    task = TrainingTask.on_tensors(
        "descent",
        network,
        _loss,
        (seen, unseen),
        settings.schedule,
        settings.seed,
        f"proxops descent, data {data}, {settings}",
        held_size=8192,
        threads=1,
        keep_last=True,
    )
    progress = workers.part(_PLANNED, 1.0).progress
    figures = learned(task, out, settings, progress).figures()
    network.eval()
    report = report_head("descent", settings, {"data_sha256": data}) | {
        "parameters": sum(weights.numel() for weights in network.parameters()),
        "training": figures,
        "force_errors": {"training": errors(network, seen), "held out": errors(network, unseen)},
    }
    text = markdown_page("A descent", _sections(report))
    compared = unseen.given[:: max(1, len(unseen.given) // _COMPARED)]
    export_descent(network, out / "bundle", compared, report, text)
    write_whole(out / "report.md", lambda path: path.write_text(text, encoding="utf-8"))
    write_json(out / "report.json", report)
    progress(1.0, "done")
    return report


def _loss(network: nn.Module, batch: tuple[Tensor, ...]) -> Tensor:
    """Mean of the errors over the sizes of accelerations; the site's axes are turned at random."""
    given, law, wanted = batch
    if network.training:
        given, law, wanted = turned(given, law, wanted, 2.0 * np.pi * torch.rand(len(given)))
    return relative_errors(law + network(given), wanted).mean()


def relative_errors(got: Tensor, wanted: Tensor) -> Tensor:
    """The lengths (B,) of errors of accelerations (B, 3), over their sizes and a small one."""
    small = wanted.square().sum(1) + _SMALL**2
    return ((got - wanted).square().sum(1) / small + 1e-8).sqrt()


def turned(given: Tensor, law: Tensor, wanted: Tensor, angles: Tensor) -> tuple[Tensor, ...]:
    """The same examples in axes of the site that are turned about its normal.

    Args:
      given, law, wanted: (B, 22), (B, 3) and (B, 3). angles: (B,) in rad.
    """
    c, s, one, zero = angles.cos(), angles.sin(), torch.ones_like(angles), torch.zeros_like(angles)
    turn = torch.stack([c, -s, zero, s, c, zero, zero, zero, one], dim=1).unflatten(1, (3, 3))
    vectors = given[:, :15].unflatten(1, (5, 3)) @ turn.mT
    law, wanted = ((turn @ each[:, :, None])[:, :, 0] for each in (law, wanted))
    return torch.cat([vectors.flatten(1), given[:, 15:]], dim=1), law, wanted


@torch.no_grad()
def errors(network: nn.Module, part: Examples) -> dict[str, float]:
    """Medians of `relative_errors`, of the law alone and with the network; number of states."""
    alone = relative_errors(part.law, part.wanted)
    both = relative_errors(part.law + network(part.given), part.wanted)
    return {
        "states": len(both),
        "law_median": float(alone.median()),
        "median": float(both.median()),
        "at_95": float(both.quantile(0.95)),
    }


def _guidance(random: np.random.Generator, body: RandomBody) -> DescentGuidance:
    """The program at a random place of a body, for a random descent and spacecraft."""

    def between(limits: tuple[float, float]) -> float:
        return float(limits[0] * (limits[1] / limits[0]) ** random.random())

    longest = np.ptp(body.vertices, axis=0).max()
    shape = Polyhedron(body.vertices * (between(_LENGTHS) / longest), body.facets)
    field = GravityField(shape, density=body.density_kg_m3)
    spin = SteadySpin([0.0, 0.0, 2.0 * np.pi / (3600.0 * body.rotation_period_h)])
    facet = random.integers(len(shape.facets))
    normal = shape.normals[facet]
    place = shape.vertices[shape.facets[facet]].mean(axis=0) + _HIGH * normal
    usual, heights, times = DescentConfig(), between(_SCALES), between(_SCALES)
    descent = dc.replace(
        usual,
        home_m=heights * usual.home_m,
        checkpoint_m=heights * usual.checkpoint_m,
        matchpoint_m=heights * usual.matchpoint_m,
        speed_m_s=heights / times * usual.speed_m_s * between(_SCALES),
        checkpoint_s=times * usual.checkpoint_s,
        matchpoint_s=times * usual.matchpoint_s,
        contact_s=times * usual.contact_s,
    )
    return DescentGuidance(field, spin, 1.0, between(_PUSHES), Site(place, normal), descent)


def _ways(guidance: DescentGuidance) -> dict[TouchPhase, np.ndarray]:
    """The states (11, 6) of a way down at equal times of each leg.

    Raises:
      SolverFailure: there is none.
    """
    ways = {}
    for leg in (TouchPhase.CHECKPOINT, TouchPhase.MATCHPOINT, TouchPhase.GROUND):
        begun, (start, end) = guidance.target(TouchPhase(leg - 1)), guidance.times(leg)
        _, states = guidance.plan(begun, guidance.target(leg), end - start, start)
        ways[leg] = np.vstack([begun, states])
    return ways


def _example(
    random: np.random.Generator, guidance: DescentGuidance, ways: dict[TouchPhase, np.ndarray]
) -> np.ndarray:
    """A row (28,) of `Places.compute`.

    Raises:
      SolverFailure: there is no plan from the state that was drawn.
    """
    leg = list(ways)[random.integers(len(ways))]
    (start, end), share = guidance.times(leg), random.random()
    elapsed, knots = start + share * (end - start), np.linspace(0.0, 1.0, len(ways[leg]))
    state = np.array([np.interp(share, knots, column) for column in ways[leg].T])
    for part, (low, high) in ((slice(3), _OFF), (slice(3, 6), _FASTER)):
        state[part] += low * (high / low) ** random.random() * random.standard_normal(3)
    target, duration = guidance.aim(leg, elapsed)
    force, _ = guidance.plan(state, target, duration, elapsed)
    given, law = descent_inputs(guidance, state, target, duration, elapsed)
    wanted = guidance.axes @ force * duration / (guidance.mass * guidance.descent.speed_m_s)
    return np.concatenate([given, law, wanted])


def _sections(report: dict[str, Any]) -> list[Section]:
    """The report for people."""
    rows = [
        [
            name,
            str(row["states"]),
            *(f"{row[key]:.2%}" for key in ("law_median", "median", "at_95")),
        ]
        for name, row in report["force_errors"].items()
    ]
    table = Table(["", "states", "law alone, median", "median", "95 %"], rows)
    told = Text("Errors of the force over its size:")
    return [Section("Training", [trained_text(report["training"]), told, table])]
