"""The paper's experiments in one sequence: data, lidar networks, policies, flights and report."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from proxops.diagrams.flight import Workers, bundle_of, provenance
from proxops.diagrams.scenario import Scenario, dump_scenario, load_body
from proxops.studies.campaigns import (
    Logs,
    Stage,
    Stages,
    Variant,
    describe_steps,
    fly_logs,
    fly_variants,
    load_logs,
)
from proxops.studies.figures import EXPERT, Results, aggregate_all, results_from_json
from proxops.studies.reproduction.paper_flights import (
    DRAWN_VARIANTS,
    HYBRIDS,
    PAPER_POLICY,
    POLICY,
    expert_forces,
    forces_along,
    paper_variants,
)
from proxops.studies.reproduction.paper_report import Findings, findings_json, paper_sections
from proxops.systems.common import InputError, Progress, write_json
from proxops.systems.policy import PolicyBundle
from proxops.training.reports import write_report

if TYPE_CHECKING:
    from proxops.studies.reproduction.training import TrainingSettings

TRAINING_STAGES = ("data-full", "policy-pilot", "policy-dagger", "lidar", "data-paper",
                   "policy-paper")  # fmt: skip
"""Names of the stages that collect and train, in the order in which they run."""
DRAWN = 1
"""The transit that is drawn; the ellipsoid blocks its straight line."""


@dc.dataclass(frozen=True)
class ReproductionSettings:
    """Which transits are flown and how many, and along how many of them forces are compared."""

    seed: int = 10_000
    """Seed of the transits; nothing was trained on them."""
    transits: int = 200
    """Number of transits that each controller flies."""
    along: int = 8
    """Number of flights of the MPC along which forces are compared."""

    def of_transits(self, transits: int) -> ReproductionSettings:
        """The same with another number of transits."""
        return dc.replace(self, transits=transits, along=min(self.along, transits))


def reproduce(
    scenario: Scenario,
    out: Path,
    settings: ReproductionSettings,
    training: TrainingSettings | None = None,
    *,
    command: str = "proxops reproduce",
    workers: Workers = Workers(),
    tell: Callable[[str, float, str], Any] | None = None,
) -> dict[str, Any]:
    """Runs all stages that are not done yet, and writes the report.

    Writes report.html, report.md, report.json and figures/ in `out`, and a folder for each stage;
    see `Stages`.

    Args:
      training: what is collected and trained; None: nothing is, and the report says so. Results
        of an earlier run in `out` are used. Our policy is then the one that the scenario names,
        else the one trained in `out`, else the one that ships.
      command: as it was typed, for the report.
      workers: fly and compute plans; what they report goes to `tell`.
      tell: is called with the stage's name, the share of it that is done, and a text.

    Returns:
      What report.json holds.

    Raises:
      InputError: the scenario logs no frames, or names a policy although one is to be trained; no
        policy is named, trained or shipped; or see the functions of the stages.
    """
    if not scenario.log_ranges:
        raise InputError("the report shows what the lidar saw: it needs log_ranges: true")
    if training is not None and scenario.policy.bundle is not None:
        raise InputError(
            "the policy that is trained is the one that flies: name another with policy.bundle "
            "only where nothing is trained (--quick)"
        )
    stages = Stages(out, tell)
    trained = _trained(stages, scenario, training, workers)
    policy, papers = _policy(scenario, trained), _bundle(trained.get("policy-paper"))
    flown = paper_variants(policy, papers, scenario)
    origin = _origin(scenario, settings, flown)
    results = _evaluated(stages, origin, flown, scenario, settings, workers)
    logs = _logged(stages, origin, flown, scenario, settings, workers)
    bundle = PolicyBundle.load(policy)
    compared = {POLICY: bundle}
    if papers is not None:
        compared[PAPER_POLICY] = PolicyBundle.load(papers)
    findings = Findings(
        command=command,
        scenario=scenario,
        body=load_body(scenario.body),
        seed=settings.seed,
        transit=DRAWN,
        stages=stages.over,
        trained=trained,
        missing=[name for name in TRAINING_STAGES if name not in trained],
        policy_sha256=bundle.sha256,
        results=results,
        logs=logs,
        forces={
            name: forces_along(each, list(logs[EXPERT].values())) for name, each in compared.items()
        },
        efforts={name: expert_forces(logs[name][DRAWN]) for name in HYBRIDS if name in logs},
    )
    title = "End-to-end imitation learning near an asteroid, reproduced"
    write_report(out, title, paper_sections(findings))
    content = findings_json(findings)
    write_json(out / "report.json", content, indent=1)
    return content


def paper_policy(out: Path) -> Path | None:
    """The bundle of the paper's recipe that `reproduce` of this version trained in a folder.

    None without one.
    """
    return _bundle(Stages(out).latest("policy-paper"))


def _trained(
    stages: Stages, scenario: Scenario, training: TrainingSettings | None, workers: Workers
) -> dict[str, Stage]:
    """The stages of training by name: those run now, or without `training` those of earlier.

    Where this version trained none, one of another version counts: the report says so.
    """
    if training is None:
        found = {
            name: stages.latest(name) or stages.latest(name, any_version=True)
            for name in TRAINING_STAGES
        }
        earlier = {name: stage for name, stage in found.items() if stage is not None}
        stages.over.extend(earlier.values())  # The report's table of stages shows them, too.
        return earlier
    # PyTorch takes a while to import, and nothing else here needs it.
    from proxops.studies.reproduction.training import train_everything

    train_everything(stages, scenario, training, workers)
    return {stage.name: stage for stage in stages.over}


def _evaluated(
    stages: Stages,
    origin: Mapping[str, Any],
    flown: Sequence[Variant],
    scenario: Scenario,
    settings: ReproductionSettings,
    workers: Workers,
) -> Results:
    def work(folder: Path, progress: Progress) -> dict[str, Any]:
        rows = fly_variants(
            flown, scenario, settings.seed, settings.transits, folder, describe=describe_steps,
            workers=workers.reporting(progress),
        )  # fmt: skip
        return {name: dc.asdict(result) for name, result in aggregate_all(rows).items()}

    stage = stages.run("evaluation", {**origin, "transits": settings.transits}, work)
    return results_from_json(stage.result)


def _logged(
    stages: Stages,
    origin: Mapping[str, Any],
    flown: Sequence[Variant],
    scenario: Scenario,
    settings: ReproductionSettings,
    workers: Workers,
) -> Logs:
    """Logs of the flights that the report draws."""
    transits = {each.name: [DRAWN] for each in flown if each.name in DRAWN_VARIANTS}
    transits[EXPERT] = sorted({DRAWN, *range(min(settings.along, settings.transits))})

    def work(folder: Path, progress: Progress) -> dict[str, Any]:
        fly_logs(
            flown, scenario, settings.seed, transits, folder, workers=workers.reporting(progress)
        )
        return {}

    stage = stages.run("shown", {**origin, "transits": transits}, work)
    return load_logs(stage.folder, settings.seed, transits)


def _policy(scenario: Scenario, trained: Mapping[str, Stage]) -> Path:
    """The folder of the bundle that flies as our policy."""
    named = scenario.policy.bundle is not None
    ours = _bundle(trained.get("policy-dagger")) or _bundle(trained.get("policy-pilot"))
    # The pilot is what carries the paper's line on; it ships beside the default policy.
    shipped = bundle_of("policy" if named else "policy:end-to-end", scenario)
    bundle = ours if ours is not None and not named else shipped
    assert bundle is not None
    return bundle.resolve()


def _bundle(stage: Stage | None) -> Path | None:
    return None if stage is None else (stage.folder / "bundle").resolve()


def _origin(
    scenario: Scenario, settings: ReproductionSettings, flown: Sequence[Variant]
) -> dict[str, Any]:
    """Everything that the flights depend on; policies by their content, not by their folder."""
    body = load_body(scenario.body)
    policy = dc.replace(scenario.policy, bundle=None)
    return {
        "scenario": dump_scenario(dc.replace(scenario, policy=policy)),
        "variants": [
            dc.asdict(each)
            | {"controller": str(provenance(each.applied_to(scenario), body, each.controller))}
            for each in flown
        ],
        "seed": settings.seed,
        "shown": DRAWN,
    }
