"""The training stages of the paper's reproduction: lidar networks, the paper's policy and ours."""

from __future__ import annotations

import dataclasses as dc
import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from proxops.diagrams.flight import Workers, provenance
from proxops.diagrams.scenario import LearnedLidarConfig, Scenario, dump_scenario, load_body
from proxops.studies.reproduction.stages import Stage, Stages
from proxops.systems.common import Progress
from proxops.systems.lidar import LidarBundle
from proxops.systems.policy import PolicyBundle
from proxops.training.data import MIXES, collect, learned_lidar_of
from proxops.training.lidar import LidarSettings, train_lidar
from proxops.training.recipes import (
    DaggerSettings,
    PaperSettings,
    PilotSettings,
    run_dagger,
    train_paper_policy,
    train_pilot,
)

LIDAR_BUNDLES = {"learned": "bundle", "paper": "paper_bundle"}
"""Folders in which `train_lidar` leaves its two networks: our ray network and the paper's MLP."""


@dc.dataclass(frozen=True)
class TrainingSettings:
    """How much is flown and trained."""

    lidar: LidarSettings = dc.field(default_factory=LidarSettings)
    lidar_network: str = "learned"
    """The network that makes the frames of the paper's disturbed flights: a key of
    `LIDAR_BUNDLES`."""
    paper_flights: int = 400
    """In the paper's mix: a quarter are nominal, the others are disturbed."""
    paper: PaperSettings = dc.field(default_factory=PaperSettings)
    pilot_flights: int = 400
    pilot: PilotSettings = dc.field(default_factory=PilotSettings)
    rounds: DaggerSettings = dc.field(default_factory=DaggerSettings)


def train_everything(
    stages: Stages,
    scenario: Scenario,
    settings: TrainingSettings,
    workers: Workers = Workers(),
) -> None:
    """Collects the data and trains the lidar networks and the policies, stage by stage.

    `Stages.latest` finds the results.

    Args:
      workers: fly and compute plans; networks are trained in this process.

    Raises:
      InputError: see the functions of the stages.
    """
    plain = dc.replace(scenario, policy=dc.replace(scenario.policy, bundle=None))
    flown = provenance(plain, load_body(scenario.body), "mpc")
    origin: dict[str, Any] = {"scenario": dump_scenario(plain), "body": flown.body}
    if flown.files:
        origin["files"] = flown.files
    data = _collected(
        stages, "data-full", origin, plain, ("full", 1, settings.pilot_flights), workers
    )
    pilot = _pilot(stages, data, settings, workers)
    _dagger(stages, data, pilot, settings, workers)
    lidar = _lidar(stages, origin, plain, settings)
    learned = learned_lidar_of(plain, lidar.folder / LIDAR_BUNDLES[settings.lidar_network])
    paper_data = _collected(
        stages, "data-paper", origin, plain, ("paper", 0, settings.paper_flights), workers, learned
    )
    _paper_policy(stages, paper_data, settings)


def _lidar(
    stages: Stages, origin: Mapping[str, Any], scenario: Scenario, settings: TrainingSettings
) -> Stage:
    def work(folder: Path, tell: Progress) -> dict[str, Any]:
        body = load_body(scenario.body)
        return train_lidar(scenario, body, settings.lidar, folder, tell)

    return stages.run("lidar", {**origin, "settings": dc.asdict(settings.lidar)}, work)


def _collected(
    stages: Stages,
    name: str,
    origin: Mapping[str, Any],
    scenario: Scenario,
    which: tuple[str, int, int],
    workers: Workers,
    learned: LearnedLidarConfig | None = None,
) -> Stage:
    """Expert flights; `which` are the mix of kinds, the seed and the number of flights."""
    mix, seed, count = which

    def work(folder: Path, tell: Progress) -> dict[str, Any]:
        manifest, report = collect(
            scenario,
            MIXES[mix],
            seed,
            count,
            folder,
            learned_lidar=learned,
            workers=workers.reporting(tell),
        )
        hashes = " ".join(flight["sha256"] for flight in manifest["flights"])
        return {
            "mix": mix,
            "seed": seed,
            "lidar": None if learned is None else Path(learned.bundle).name,
            "logs_sha256": hashlib.sha256(hashes.encode()).hexdigest(),
            "all": report["all"],
            "kinds": {kind: figures["flights"] for kind, figures in report["kinds"].items()},
        }

    lidar = None if learned is None else LidarBundle.load(learned.bundle).sha256
    inputs = {**origin, "mix": MIXES[mix], "seed": seed, "count": count, "lidar": lidar}
    return stages.run(name, inputs, work)


def _paper_policy(stages: Stages, data: Stage, settings: TrainingSettings) -> Stage:
    def work(folder: Path, tell: Progress) -> dict[str, Any]:
        report = train_paper_policy(data.folder, folder, settings.paper, Workers(progress=tell))
        return _trained(report, folder)

    return stages.run("policy-paper", _learning(data, settings.paper), work)


def _pilot(stages: Stages, data: Stage, settings: TrainingSettings, workers: Workers) -> Stage:
    def work(folder: Path, tell: Progress) -> dict[str, Any]:
        report = train_pilot(data.folder, folder, settings.pilot, workers.reporting(tell))
        return _trained(report, folder)

    return stages.run("policy-pilot", _learning(data, settings.pilot), work)


def _dagger(
    stages: Stages, data: Stage, pilot: Stage, settings: TrainingSettings, workers: Workers
) -> Stage:
    def work(folder: Path, tell: Progress) -> dict[str, Any]:
        report = run_dagger(
            data.folder, pilot.folder, folder, settings.rounds, workers.reporting(tell)
        )
        return _trained(report, folder)

    # A budget of minutes that is infinite is no JSON.
    rounds = {k: str(v) for k, v in dc.asdict(settings.rounds).items()}
    inputs = _learning(data, settings.pilot) | {
        "rounds": rounds,
        "pilot_sha256": pilot.result["bundle_sha256"],
    }
    return stages.run("policy-dagger", inputs, work)


def _learning(data: Stage, settings: Any) -> dict[str, Any]:
    return {"logs_sha256": data.result["logs_sha256"], "settings": dc.asdict(settings)}


def _trained(report: dict[str, Any], folder: Path) -> dict[str, Any]:
    return report | {"bundle_sha256": PolicyBundle.load(folder / "bundle").sha256}
