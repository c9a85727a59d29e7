"""Collecting, evaluating and the whole reproduction: on a cluster as in one process."""

import json
import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from dask.distributed import LocalCluster
from known_policies import DeadReckoning, write_policy
from short_flights import BRIEF, short_scenario

from proxops.diagrams.flight import Workers
from proxops.diagrams.scenario import Scenario, dump_scenario
from proxops.studies.campaigns.variants import Variant, fly_variants
from proxops.studies.reproduction.paper_experiments import ReproductionSettings, _origin, reproduce
from proxops.studies.reproduction.paper_flights import paper_variants
from proxops.systems.policy import PolicyConfig

pytestmark = pytest.mark.slow

WALL_TIMES = {"wall_s", "control_ms_median", "control_ms_p99", "control_ms_mean"}
WALL_TIMES |= {f"{name}_s{end}" for name in ("solve", "policy", "decision")
               for end in ("", "_median")}  # fmt: skip


def brief() -> Scenario:
    return short_scenario(**BRIEF)


def plain(value: Any) -> Any:
    """Without what a clock measured, and what depends on it: logs hold their wall times."""
    if isinstance(value, dict):
        left = WALL_TIMES | {"sha256", "bytes"}
        return {key: plain(each) for key, each in value.items() if key not in left}
    return [plain(each) for each in value] if isinstance(value, list) else value


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    """Address of a cluster of two processes."""
    cluster = LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0"
    )
    yield cluster.scheduler_address
    cluster.close()


def test_evaluate_on_a_cluster(scheduler: str, tmp_path: Path) -> None:
    flown = [Variant("mpc", "mpc"), Variant("zero", "zero"), Variant("pd", "pd", {"assurance": {}})]
    alone = fly_variants(flown, brief(), 10_000, 3, tmp_path / "alone", workers=Workers(1))
    cluster = Workers(scheduler=scheduler)
    together = fly_variants(flown, brief(), 10_000, 3, tmp_path / "together", workers=cluster)
    assert plain(together) == plain(alone)
    assert [row["transit"] for row in together["pd"]] == [0, 1, 2]


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_policy(tmp_path_factory.mktemp("policy") / "bundle", DeadReckoning())


@pytest.fixture(scope="module")
def reproduced(bundle: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Any]:
    out = tmp_path_factory.mktemp("reproduced")
    wanted = short_scenario(**BRIEF, policy__bundle=str(bundle))
    return out, reproduce(
        wanted, out, ReproductionSettings(transits=2, along=1), workers=Workers(1)
    )


def test_report_says_what_was_not_run(reproduced: tuple[Path, Any], bundle: Path) -> None:
    out, report = reproduced
    assert "policy-paper" in report["not_run"]
    assert "Not run" in (out / "report.md").read_text()
    assert list(report["controllers"]) == [
        each.name for each in paper_variants(bundle, None, brief())
    ]
    assert json.loads((out / "report.json").read_text())["not_run"] == report["not_run"]


def test_a_policys_margin_counts() -> None:
    """Where the bundle lies does not: it counts by its content."""
    settings, flown = ReproductionSettings(transits=2), [Variant("zero", "zero")]

    def scenario_of(**policy: Any) -> str:
        return _origin(Scenario(policy=PolicyConfig(**policy)), settings, flown)["scenario"]

    usual = scenario_of()
    assert usual == dump_scenario(Scenario(policy=PolicyConfig())) == scenario_of(bundle="anywhere")
    assert len({usual, scenario_of(margin_m=500.0), scenario_of(beyond_family=True)}) == 3


def written(out: Path) -> dict[Path, int]:
    """When each file of a stage was written."""
    return {path.relative_to(out): path.stat().st_mtime_ns for path in out.glob("*-*/*.json")}


def test_run_again_it_flies_nothing(
    reproduced: tuple[Path, Any], bundle: Path, tmp_path: Path
) -> None:
    """Though it was moved, and its policy too."""
    out, before = reproduced
    moved = Path(shutil.copytree(out, tmp_path / "moved"))
    assert len(written(moved)) >= 2
    shutil.copytree(bundle, tmp_path / "policy")
    wanted = short_scenario(**BRIEF, policy__bundle=os.fspath(tmp_path / "policy"))
    again = reproduce(wanted, moved, ReproductionSettings(transits=2, along=1), workers=Workers(1))
    assert all(stage["skipped"] for stage in again["stages"])
    assert again["controllers"] == before["controllers"]
    assert written(moved) == written(out)
