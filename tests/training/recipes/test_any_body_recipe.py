"""The recipe for any body, small: it runs through, resumes, and its bundle flies at a member."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from short_flights import kleopatra

from proxops.cli.main import app
from proxops.diagrams.flight import Workers, fly
from proxops.diagrams.logs import FlightLog
from proxops.diagrams.scenario import load_scenario
from proxops.systems import GuidanceBundle, InputError, PointMassField, Surroundings
from proxops.training.loop import Schedule
from proxops.training.recipes import AnyBodySettings, DaggerSettings, run_dagger, train_any_body
from proxops.training.recipes.any_body import Family, examples_of

SMALL = dataclasses.replace(
    AnyBodySettings().quick(),
    members=2,
    held=1,
    transits=2,
    width=16,
    schedule=Schedule(epochs=2, batch=64, learning_rate=2e-3, patience=2),
)


def test_examples_are_over_the_thrust_of_their_own_spacecraft() -> None:
    axes = kleopatra().keep_out_semi_axes
    members = [
        Surroundings(PointMassField(mass), mass, 3e-4, axes, push, 40.0, 10.0, 0.03)
        for mass, push in ((3e18, 0.07), (1e18, 0.02))
    ]
    random = np.random.default_rng(1)
    labels = {
        "state": 1e5 * random.normal(size=(6, 6)),
        "goal": 1e5 * random.normal(size=(6, 3)),
        "force": random.normal(size=(6, 3)),
        "member": np.array([1, 0, 1, 1, 0, 0]),
    }
    scenarios = [load_scenario(None, {"spacecraft.mass_kg": mass}) for mass in (100.0, 50.0)]
    found = examples_of(labels, Family(scenarios, members, 0))
    for row in range(6):
        k = labels["member"][row]
        alone = members[k].inputs(labels["state"][row, None], labels["goal"][row, None])
        np.testing.assert_array_equal(found.given[row].numpy(), alone[0])
        limit = (7.0, 1.0)[k]
        np.testing.assert_allclose(
            found.force[row].numpy(), labels["force"][row] / limit, rtol=1e-6
        )


@pytest.mark.slow
def test_from_nothing_to_a_flight(tmp_path: Path) -> None:
    report = train_any_body(tmp_path, SMALL)
    assert report == json.loads((tmp_path / "report.json").read_text())
    assert report["training"]["epochs"] == 2
    assert report["force_errors"]["held out"]["states"] > 10
    bundle = GuidanceBundle.load(tmp_path / "bundle")
    assert bundle.ranges["semi_axis_x"][1] == pytest.approx(1.0 / 0.7, rel=0.1)
    weights = (tmp_path / "bundle/weights.npz").read_bytes()
    # Once more: nothing is computed again, and the bundle is the same.
    plans = {path: path.stat().st_mtime_ns for path in (tmp_path / "plans").glob("*.npz")}
    train_any_body(tmp_path, SMALL)
    assert plans == {path: path.stat().st_mtime_ns for path in plans}
    assert (tmp_path / "bundle/weights.npz").read_bytes() == weights
    path = next((tmp_path / "family").glob("*-00000/scenario.yaml"))
    scenario = load_scenario(path)
    # It learned at one body: the proportions of another margin lie outside of its family.
    changes = {
        "arrival.deadline_s": 30.0 * scenario.control_period_s,
        "policy.margin_m": scenario.mpc.keep_out_margin_m,
    }
    log = fly(load_scenario(path, changes), f"policy:{tmp_path / 'bundle'}")
    assert np.isfinite(log.dataset["policy_force"].values[:-1]).all()
    # Its own flights teach it: on navigation, in worlds that differ, at the member it learns at.
    before = report["force_errors"]["training"]["states"]
    settings = DaggerSettings(rounds=1, flights=1, epochs=2)
    told: list[str] = []
    workers = Workers(1, progress=lambda done, text: told.append(text))
    report = run_dagger(None, tmp_path, tmp_path / "dagger", settings, workers)
    assert told[0] == "making bodies"
    assert told[1].startswith("plans of transits")
    [outcome] = report["rounds"]
    assert report["training"]["epochs"] == 2
    assert outcome["flights"] == 1
    assert report["force_errors"]["training"]["states"] == before + outcome["labels"]
    assert GuidanceBundle.load(tmp_path / "dagger/bundle").sha256 != bundle.sha256
    [flown] = (tmp_path / "dagger/round-1/flights").glob("*.nc")
    kept = FlightLog.load(flown)
    assert kept.scenario.dispersed
    assert "navigation_state" in kept.dataset


@pytest.mark.parametrize("version", ["1.3.0", None])
def test_a_guidance_of_another_version_is_refused_and_left_as_it_is(
    tmp_path: Path, version: str | None
) -> None:
    report = {"settings": dataclasses.asdict(SMALL)} | ({"proxops": version} if version else {})
    (tmp_path / "report.json").write_text(json.dumps(report))
    (tmp_path / "family").mkdir()
    with pytest.raises(InputError, match=f"by proxops {version or 'before'}.*, and this is"):
        run_dagger(None, tmp_path, tmp_path / "dagger", DaggerSettings(rounds=1))
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["family", "report.json"]


def test_a_pilot_is_not_replaced_by_what_learns_from_it(tmp_path: Path) -> None:
    words = ["dagger", "--pilot", str(tmp_path), "--out", str(tmp_path / "." / "")]
    with pytest.raises(InputError, match="is the folder of --pilot"):
        app(words, standalone_mode=False)


@pytest.mark.parametrize(("seed", "rounds", "taken"), [(9998, 2, True), (9999, 2, False)])
def test_no_round_learns_from_a_seed_of_evaluation(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, seed: int, rounds: int, taken: bool
) -> None:
    asked: list[DaggerSettings] = []

    def run(data: None, first: Path, out: Path, settings: DaggerSettings, workers: Workers) -> dict:
        asked.append(settings)
        return {"rounds": []}

    monkeypatch.setattr("proxops.training.recipes.run_dagger", run)
    given = ("--rounds", str(rounds), "--seed", str(seed), "--json", "--out", str(tmp_path / "out"))
    words = ["dagger", "--pilot", str(tmp_path), *given]
    if taken:
        app(words, standalone_mode=False)
        assert asked == [DaggerSettings(rounds=rounds, seed=seed)]
    else:
        with pytest.raises(InputError, match=r"transits of seed 10000; seeds from 10,000 on"):
            app(words, standalone_mode=False)
        assert not asked
