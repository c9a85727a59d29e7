"""Variants of the policy for any body with parts taken out, each trained and exported as a bundle.

Each is a stage: it is made once from the same inputs, and goes on after an interruption.
"""

import dataclasses as dc
from pathlib import Path

import numpy as np
import torch

from proxops.diagrams.flight import Workers
from proxops.diagrams.scenario import load_scenario
from proxops.studies.reproduction import Stages
from proxops.systems.common import Progress
from proxops.systems.policy import INPUTS, GuidanceBundle
from proxops.training.export import export_guidance
from proxops.training.networks import AnyBodyGuidance
from proxops.training.recipes import (
    AnyBodySettings,
    Family,
    family_plans,
    known_family,
    learn,
    trained_settings,
)

# Where the natural accelerations and the constants are in a row of inputs.
NATURAL, AT_GOAL, NUMBERS = slice(9, 12), slice(12, 15), slice(15, INPUTS)
# What a network without body inputs takes for the constants: a ball, and proportions near the
# middle of the family.
BALL = (1.0, 1.0, 1.0, 0.3, 0.1, 0.5, 0.01, 0.3)
# Of the transits at one body.
ONE_BODY_SEED = 3


class Blind(AnyBodyGuidance):
    """Is told nothing of the body; only the law knows the natural acceleration."""

    def __init__(self, width: int):
        instead = torch.full((INPUTS,), torch.nan)
        instead[NATURAL] = instead[AT_GOAL] = 0.0
        instead[NUMBERS] = torch.tensor(BALL)
        super().__init__(width, instead)


def bare_law(dagger: Path, stages: Stages) -> Path:
    """The bundle of a trained guidance whose corrections are all zero.

    Args:
      dagger: what `proxops dagger` wrote.
    """

    def work(folder: Path, progress: Progress) -> dict:
        rounds = sorted(dagger.glob("round-*"), key=lambda each: int(each.name.split("-")[1]))
        settings, report = trained_settings(dagger, AnyBodySettings, "any-body")
        network = AnyBodyGuidance(settings.width)
        network.load_state_dict(torch.load(rounds[-1] / "guidance.ckpt")["network"])
        last = network.network[-1]
        with torch.no_grad():
            last.weight.zero_()
            last.bias.zero_()
        known = GuidanceBundle.load(dagger / "bundle").ranges
        ranges = {name: list(ends) for name, ends in known.items()}
        rows = torch.from_numpy(np.random.default_rng(0).uniform(0.3, 1.0, (64, INPUTS))).float()
        bundle, told = folder / "bundle", "The bare law.\n"
        export_guidance(network.eval(), bundle, rows, ranges, report, told)
        return {}

    return stages.run("bare-law", {"dagger": _sha256(dagger)}, work).folder / "bundle"


def no_body_inputs(guidance: Path, stages: Stages, workers: Workers) -> Path:
    """The bundle of a network that is told nothing of the body.

    Args:
      guidance: what `proxops train --recipe any-body` wrote; its plans are learned from.
    """

    def work(folder: Path, progress: Progress) -> dict:
        settings, _ = trained_settings(guidance, AnyBodySettings, "any-body")
        family, labels = known_family(guidance, settings, workers.reporting(progress))
        name = "ablation: no body inputs"
        learn(family, labels, settings, folder, name, progress, kind=Blind)
        return {}

    return stages.run("blind", {"guidance": _sha256(guidance)}, work).folder / "bundle"


def one_body(guidance: Path, transits: int, stages: Stages, workers: Workers) -> Path:
    """The bundle of a network that learned at Kleopatra alone.

    Args:
      guidance: its settings are taken. transits: whose plans are learned from; a tenth of them
        again is held out.
    """

    def work(folder: Path, progress: Progress) -> dict:
        settings, _ = trained_settings(guidance, AnyBodySettings, "any-body")
        settings, scenario = dc.replace(settings, held=1), load_scenario()
        counts = {"learned": transits, "held": max(1, transits // 10)}
        plan = workers.reporting(progress)
        parts = [
            family_plans([scenario], count, ONE_BODY_SEED + k, folder / f"plans-{name}", plan)
            for k, (name, count) in enumerate(counts.items())
        ]
        parts[1]["member"] = parts[1]["member"] + 1
        labels = {name: np.concatenate([each[name] for each in parts]) for name in parts[0]}
        family = Family.of([scenario, scenario], settings.held)
        learn(family, labels, settings, folder, "ablation: one body", progress)
        return {}

    inputs = {"guidance": _sha256(guidance), "transits": transits}
    return stages.run("one-body", inputs, work).folder / "bundle"


def _sha256(trained: Path) -> str:
    return GuidanceBundle.load(trained / "bundle").sha256
