"""The training stages of the paper's reproduction: lidar networks, the paper's policy and ours."""

from __future__ import annotations

import dataclasses as dc
import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from proxops.diagrams.flight import Workers, provenance
from proxops.diagrams.scenario import LearnedLidarConfig, Scenario, dump_scenario, load_body
from proxops.studies.campaigns import Stage, Stages
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
    """
    plain = dc.replace(scenario, policy=dc.replace(scenario.policy, bundle=None))
    body = load_body(scenario.body)
    flown = provenance(plain, body, "mpc")
    origin: dict[str, Any] = {"scenario": dump_scenario(plain), "body": flown.body}
    if flown.files:
        origin["files"] = flown.files

    def train(folder: Path, tell: Progress) -> dict[str, Any]:
        return train_lidar(plain, body, settings.lidar, folder, tell)

    def learn(folder: Path, tell: Progress) -> dict[str, Any]:
        fleet = workers.reporting(tell)
        return _trained(train_pilot(data.folder, folder, settings.pilot, fleet), folder)

    def go_on(folder: Path, tell: Progress) -> dict[str, Any]:
        fleet, begun = workers.reporting(tell), pilot.folder
        return _trained(run_dagger(data.folder, begun, folder, settings.rounds, fleet), folder)

    def learn_as_the_paper(folder: Path, tell: Progress) -> dict[str, Any]:
        return _trained(
            train_paper_policy(papers.folder, folder, settings.paper, workers.reporting(tell)),
            folder,
        )

    data = _collected(stages, "data-full", origin, plain, ("full", 1, settings.pilot_flights),
                      workers)  # fmt: skip
    learned_from = _learning(data, settings.pilot)
    pilot = stages.run("policy-pilot", learned_from, learn)
    # A budget of minutes that is infinite is no JSON.
    rounds = {key: str(value) for key, value in dc.asdict(settings.rounds).items()}
    begun_from = {"rounds": rounds, "pilot_sha256": pilot.result["bundle_sha256"]}
    stages.run("policy-dagger", learned_from | begun_from, go_on)
    lidar = stages.run("lidar", {**origin, "settings": dc.asdict(settings.lidar)}, train)
    network = learned_lidar_of(plain, lidar.folder / LIDAR_BUNDLES[settings.lidar_network])
    papers = _collected(stages, "data-paper", origin, plain, ("paper", 0, settings.paper_flights),
                        workers, network)  # fmt: skip
    stages.run("policy-paper", _learning(papers, settings.paper), learn_as_the_paper)


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
            scenario, MIXES[mix], seed, count, folder,
            learned_lidar=learned, workers=workers.reporting(tell),
        )  # fmt: skip
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


def _learning(data: Stage, settings: Any) -> dict[str, Any]:
    return {"logs_sha256": data.result["logs_sha256"], "settings": dc.asdict(settings)}


def _trained(report: dict[str, Any], folder: Path) -> dict[str, Any]:
    return report | {"bundle_sha256": PolicyBundle.load(folder / "bundle").sha256}
