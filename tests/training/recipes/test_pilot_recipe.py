"""Our recipe and DAgger: a small pilot learns, flies, goes on after a kill, learns from itself."""

import csv
import json
import shutil
from dataclasses import asdict, replace
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest
import torch

from proxops.assets import ASSETS
from proxops.cli.main import app
from proxops.diagrams.flight import Workers, fly
from proxops.diagrams.logs.flight_log import FlightLog
from proxops.diagrams.scenario.scenario import load_scenario
from proxops.systems import InputError
from proxops.training.export import policy_report
from proxops.training.networks.pilot_network import Pilot, PilotDimensions, load_pilot, save_pilot
from proxops.training.recipes import DaggerSettings, PilotSettings, run_dagger, trained_settings
from proxops.training.recipes.dagger import round_flights
from proxops.training.recipes.pilot import collected_scenario, restarted, train_pilot
from proxops.training.recipes.recipe import Learner

DIMENSIONS = PilotDimensions(
    planes=12, rays=360, hits=16, period=10.0, mass=100.0, thrust_limit=7.0, length=98e3,
    keep_out=(140e3, 70e3, 65e3), low=(-130e3, -50e3, -50e3), high=(130e3, 50e3, 50e3),
    spacing=40e3, coarse_width=8, motion_width=8, guidance_width=8,
)  # fmt: skip
# Transit 0 of this seed is one to train on.
SEED = 3


def small_pilot() -> Pilot:
    torch.manual_seed(0)
    return DIMENSIONS.make().eval()


def same(first: Pilot, second: Pilot, part: str) -> bool:
    pairs = zip(first.state_dict().items(), second.state_dict().items(), strict=True)
    chosen = [(a, b) for (name, a), (_, b) in pairs if name.startswith(part)]
    return bool(chosen) and all(torch.equal(a, b) for a, b in chosen)


def test_pilot_is_kept_whole(tmp_path: Path):
    pilot = small_pilot()
    pilot.fit_residual(torch.tensor([90.0, 100.0, 110.0]))
    save_pilot(tmp_path, DIMENSIONS, pilot)
    dimensions, again = load_pilot(tmp_path)
    assert dimensions == DIMENSIONS
    assert same(pilot, again, "")
    assert float(again.usual_residual) == 100.0
    (tmp_path / "pilot.ckpt").write_bytes(b"half a pil")
    with pytest.raises(InputError, match="no pilot"):
        load_pilot(tmp_path)


def test_settings_come_back_from_a_report(tmp_path: Path):
    settings = PilotSettings(seed=4).quick()
    report = {"proxops": metadata.version("proxops"), "settings": asdict(settings)}

    def read(**changes: object) -> PilotSettings:
        (tmp_path / "report.json").write_text(json.dumps(report | changes))
        return trained_settings(tmp_path, PilotSettings, "proxops")[0]

    assert read() == settings
    with pytest.raises(InputError, match=r"made by proxops 0\.1\.2, and this is"):
        read(proxops="0.1.2")
    with pytest.raises(InputError, match=r"its report\.json cannot be read"):
        read(settings={"frames": 3, "what": 4})


def test_restarted_pilot_sees_as_before_and_knows_nothing():
    pilot = small_pilot()
    fresh = restarted(DIMENSIONS, pilot, seed=7)
    for part in ("coarse.", "geometry.", "filter."):
        assert same(pilot, fresh, part)
    assert not same(pilot, fresh, "guidance.network.")
    assert same(fresh, restarted(DIMENSIONS, small_pilot(), seed=7), "guidance.")
    assert not any(weights.requires_grad for weights in fresh.filter.motion.parameters())


def some_frames() -> torch.Tensor:
    """(2, 5, 12, 360): two flights of five steps."""
    random = np.random.default_rng(0)
    frames = torch.full((2, 5, 12, 360), torch.inf)
    frames[:, :, :, 100:130] = torch.from_numpy(random.uniform(50e3, 60e3, (2, 5, 12, 30))).float()
    return frames


def test_all_parts_learn_from_a_force():
    """The pilot is one network: an error of the last force has a slope in each part's weights."""
    torch.manual_seed(0)
    pilot = replace(DIMENSIONS, thrust_limit=1e6).make()
    pilot.fit_residual(torch.tensor([1e5]))
    forces, _, _ = pilot.sequence(some_frames(), torch.ones(2, 5, 6), torch.zeros(2, 5, 3))
    forces[:, -1].sum().backward()
    for part in ("coarse.network", "geometry", "filter.motion", "filter.logs", "guidance"):
        slopes = [
            weights.grad for name, weights in pilot.named_parameters() if name.startswith(part)
        ]
        assert any(slope is not None and slope.abs().max() > 0.0 for slope in slopes), part


@torch.no_grad()
def test_sequence_is_step_after_step():
    pilot, frames = small_pilot(), some_frames()
    target, applied = torch.ones(2, 5, 6), torch.randn(2, 5, 3)
    forces, estimates, memory = pilot.sequence(frames, target, applied)
    remembered = torch.zeros(2, memory.shape[1])
    for step in range(5):
        given = frames[:, step].flatten(1), target[:, step], applied[:, step], remembered
        force, estimate, remembered = pilot(*given)
        torch.testing.assert_close(forces[:, step], force)
        torch.testing.assert_close(estimates[:, step], estimate)
    torch.testing.assert_close(memory, remembered)


def test_a_round_flies_what_is_hard(tmp_path: Path):
    """Three in four of the transits are blocked; each round has others, all of training seeds."""
    nothing: dict = {}
    learner = Learner(
        tmp_path, nothing, lambda _: [load_scenario()], lambda *_: nothing, (), flights=20
    )
    [first], [second] = (
        round_flights(learner, ASSETS / "end_to_end", DaggerSettings(), k) for k in (1, 2)
    )
    numbers = [int(flight.name.rsplit("-", 1)[1]) for flight in first]
    blocked = [number for number in numbers if number % 10 in (1, 4, 7)]
    assert len(first) == len(set(numbers)) == 20
    assert len(blocked) / 20 == pytest.approx(0.75, abs=0.1)
    assert not {flight.name for flight in first} & {flight.name for flight in second}
    assert all(flight.scenario.transit.seed < 10_000 for flight in first + second)


def test_data_must_be_a_collection(tmp_path: Path):
    with pytest.raises(InputError, match="manifest"):
        collected_scenario(tmp_path)


# --- the whole, in small --------------------------------------------------------------------------


@pytest.fixture(scope="module")
def collected(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("pilot") / "data"
    arguments = ("--transits", "12", "--seed", str(SEED), "--recovery", "full", "--workers", "1")
    app(["collect", *arguments, "--out", str(out)], standalone_mode=False)
    return out


@pytest.fixture(scope="module")
def trained(collected: Path) -> Path:
    out = collected.parent / "pilot"
    train_pilot(collected, out, PilotSettings().quick(), workers=Workers(1))
    return out


@pytest.fixture
def without_replays(monkeypatch: pytest.MonkeyPatch) -> None:
    """Only to save time: no logged flight is replayed for what a report says of the forces."""
    nothing = np.zeros((0, 3))
    monkeypatch.setattr(policy_report, "replay_flights", lambda *given: (nothing, nothing))


@pytest.mark.slow
def test_every_part_learns(trained: Path):
    for part in ("coarse", "geometry", "motion", "filter", "guidance", "end_to_end"):
        # The filter starts from sensible noise, sees few windows here, and is not told what
        # disturbs its flights: its loss while it trains is mostly chance. On the validation windows
        # it must not get worse.
        column = "validation_loss" if part == "filter" else "training_loss"
        with (trained / "curves" / f"{part}.csv").open() as file:
            losses = [float(row[column]) for row in csv.DictReader(file)]
        # The end-to-end training starts from parts that have learned; the guidance's loss
        # saturates.
        share = {"filter": 1.05, "end_to_end": 1.0, "guidance": 0.6}.get(part, 0.5)
        assert losses[-1] < share * losses[0], part
    report = json.loads((trained / "report.json").read_text())
    figures = report["parts"]["training"]
    assert figures["rmse_n"] < figures["zero_rmse_n"]


@pytest.mark.slow
def test_the_bundle_arrives(trained: Path):
    """On a transit that it was trained on: a minute of training on twelve flights."""
    settings = {
        "transit.seed": SEED,
        "transit.index": 0,
        "policy.bundle": str(trained / "bundle"),
        "log_ranges": False,
    }
    log = fly(load_scenario(None, settings), "policy")
    assert log.summary["success_2km"], log.summary
    assert log.summary["estimate_position_error_m_median"] < 500.0


@pytest.mark.slow
@pytest.mark.usefixtures("without_replays")
def test_run_again_it_ends_the_same(collected: Path, trained: Path, tmp_path: Path):
    again = Path(shutil.copytree(trained, tmp_path / "again"))
    told: list[str] = []
    workers = Workers(progress=lambda done, text: told.append(text))
    train_pilot(collected, again, PilotSettings().quick(), workers)
    assert not [text for text in told if "epoch" in text]
    bundles = [json.loads((out / "bundle" / "policy.json").read_text()) for out in (trained, again)]
    assert bundles[0]["model_sha256"] == bundles[1]["model_sha256"]


@pytest.mark.slow
@pytest.mark.usefixtures("without_replays")
def test_dagger_learns_from_its_flights_and_goes_on_after_a_kill(
    collected: Path, trained: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    settings = DaggerSettings(rounds=1, flights=1, seed=SEED)
    calls = 0

    class KilledError(Exception):
        pass

    def kill(done: float, text: str) -> None:
        nonlocal calls
        calls += "labelling" in text
        if calls:
            raise KilledError

    with pytest.raises(KilledError):
        run_dagger(collected, trained, tmp_path, settings, Workers(1, progress=kill))
    flown = sorted((tmp_path / "round-1" / "flights").glob("*.nc"))
    written = [path.stat().st_mtime_ns for path in flown]
    assert len(flown) == 1
    report = run_dagger(collected, trained, tmp_path, settings, workers=Workers(1))
    assert [path.stat().st_mtime_ns for path in flown] == written
    options = ("--rounds", "1", "--flights", "1", "--seed", str(SEED), "--workers", "1", "--json")
    given = ("dagger", str(collected), "--pilot", str(trained), *options, "--out", str(tmp_path))
    app([*given], standalone_mode=False)
    assert json.loads(capsys.readouterr().out) == json.loads((tmp_path / "report.json").read_text())
    # As if it had been killed between its last round and what it leaves of it.
    network = (tmp_path / "bundle" / "model.onnx").read_bytes()
    shutil.rmtree(tmp_path / "bundle")
    run_dagger(collected, trained, tmp_path, settings, workers=Workers(1))
    assert (tmp_path / "bundle" / "model.onnx").read_bytes() == network
    row = report["rounds"][0]
    states = sum(len(FlightLog.load(path).dataset["time"]) - 1 for path in flown)
    assert row["flights"] == 1
    assert row["labels"] >= states
    (_, before), (_, after) = map(load_pilot, (trained, tmp_path))
    assert same(before, after, "geometry.")
    assert not same(before, after, "guidance.network.")
    scenario = load_scenario(None, {"policy.bundle": str(tmp_path / "bundle")})
    assert np.isfinite(fly(scenario, "policy").dataset["policy_force"].values[:-1]).all()
