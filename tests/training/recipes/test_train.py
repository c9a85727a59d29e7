"""`proxops train --recipe paper`: learning from short flights, what it writes, what it refuses."""

import csv
import dataclasses
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from commands import proxops
from flight_folders import copy_flights

from proxops.systems import InputError
from proxops.training.data import PackedFlights, pack_flights
from proxops.training.export.policy_report import replay_flights
from proxops.training.loop import Schedule, WindowDataset
from proxops.training.recipes import RECIPES, PaperSettings, train_paper_policy
from proxops.training.recipes.paper import make_policy, rms_force_loss

SMALL = PaperSettings(
    schedule=Schedule(epochs=20, batch=4, learning_rate=3e-3, patience=20),
    window=8, stride=2, channels=(8, 8, 8), width=32, device="cpu",
)  # fmt: skip


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return copy_flights(tmp_path_factory.mktemp("data")).parent


@pytest.fixture(scope="module")
def packed(data: Path) -> PackedFlights:
    return pack_flights(data / "flights")


@pytest.mark.slow
def test_training_reduces_the_loss(data: Path, tmp_path: Path):
    report = train_paper_policy(data, tmp_path, SMALL)
    with (tmp_path / "curves" / "policy.csv").open() as file:
        losses = [float(row["training_loss"]) for row in csv.DictReader(file)]
    assert len(losses) == 20
    assert losses[-1] < 0.8 * losses[0]
    figures = report["parts"]["training"]
    assert figures["rmse_n"] < 0.3 * figures["zero_rmse_n"]


def test_report_and_checkpoint_are_of_every_step(data: Path, packed: PackedFlights, tmp_path: Path):
    brief = dataclasses.replace(SMALL, schedule=dataclasses.replace(SMALL.schedule, epochs=1))
    report = train_paper_policy(data, tmp_path, brief)
    for part, figures in report["parts"].items():
        assert figures["flights"] == len(packed.part(part)) > 0
        assert figures["steps"] == sum(flight.steps for flight in packed.part(part))
    assert report["logs_sha256"] == packed.logs_sha256
    assert json.loads((tmp_path / "report.json").read_text())["parts"] == report["parts"]
    assert f"{report['parts']['test']['rmse_n']:.3f}" in (tmp_path / "report.md").read_text()
    policy = make_policy(packed, SMALL)
    policy.load_state_dict(torch.load(tmp_path / "policy.ckpt")["best"])
    wanted, said = replay_flights(policy.eval(), packed, "test")
    rmse = np.sqrt(((said - wanted) ** 2).mean())
    assert rmse == pytest.approx(report["parts"]["test"]["rmse_n"], rel=1e-5)


@torch.no_grad()
def test_replayed_flights_are_seen_step_by_step(packed: PackedFlights):
    policy = make_policy(packed, SMALL).eval()
    forces, labels = [], []
    for flight in packed.part("training"):
        memory = torch.zeros(1, policy.memory_size)
        for row in range(flight.start, flight.start + flight.steps):
            ranges = torch.from_numpy(packed.frames(np.array([row])).reshape(1, -1))
            target = torch.from_numpy(packed.target[row : row + 1].astype(np.float32))
            force, _, memory = policy(ranges, target, torch.zeros(1, 3), memory)
            forces.append(force[0].numpy())
            labels.append(packed.mpc_force[row])
    wanted, said = replay_flights(policy, packed, "training")
    np.testing.assert_array_equal(wanted, np.array(labels))
    np.testing.assert_allclose(said, np.array(forces), rtol=1e-4, atol=1e-5)


@torch.no_grad()
def test_loss_is_the_root_mean_square_in_newtons_where_there_is_a_label(packed: PackedFlights):
    policy = make_policy(packed, SMALL).eval()
    windows = WindowDataset(packed, "training", 8, frames=True)
    batch = windows.batch([0, 1, 2])
    assert torch.isinf(batch["frames"]).any()
    said = policy.sequence(batch["frames"], batch["target"], batch["commanded_force"])[0]
    batch["labelled"][1, 3:] = False
    kept = batch["labelled"].numpy()
    errors = (said - batch["mpc_force"]).numpy()[kept]
    assert float(rms_force_loss(policy, batch)) == pytest.approx(
        np.sqrt((errors**2).mean()), rel=1e-5
    )
    batch["labelled"][:] = False
    assert float(rms_force_loss(policy, batch)) == pytest.approx(0.0, abs=1e-5)


@pytest.mark.slow
def test_quick_command_writes_all_that_it_says(
    data: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
):
    out = tmp_path / "out"
    arguments = ("train", data, "--recipe", "paper", "--quick", "--device", "cpu", "--out", out)
    assert proxops(*arguments) == 0
    assert "RMSE, test" in capfd.readouterr().out
    names = {path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file()}
    assert {name for name in names if "tfevents" not in name} == {
        "policy.ckpt", "curves/policy.csv", "report.json", "report.md", "forces.png",
        "bundle/model.onnx", "bundle/policy.json",
    }  # fmt: skip
    assert (out / "forces.png").read_bytes().startswith(b"\x89PNG")
    first = (out / "curves" / "policy.csv").read_text()
    assert len(first.splitlines()) == 1 + PaperSettings().quick().schedule.epochs
    assert proxops(*arguments, "--json") == 0  # What is finished stays as it is.
    assert json.loads(capfd.readouterr().out) == json.loads((out / "report.json").read_text())
    assert (out / "curves" / "policy.csv").read_text() == first
    assert proxops(*arguments, "--seed", "1") == 2
    assert "give another output folder" in capfd.readouterr().err
    again = ("--recipe", "paper", "--quick", "--epochs", "1", "--device", "cpu")
    assert proxops("train", data / "flights", *again, "--out", tmp_path / "logs") == 0
    assert len((tmp_path / "logs" / "curves" / "policy.csv").read_text().splitlines()) == 2


@pytest.mark.parametrize(
    ("recipe", "folder"),
    [("proxops", "out/pilot"), ("paper", "out/paper-policy"), ("any-body", "out/any-body")],
)
def test_each_recipe_has_a_folder_of_its_own(
    recipe: str, folder: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """In the folder of another, it would replace the bundle."""
    given: list[Any] = []

    def stop(*arguments: Any) -> None:
        given.extend(arguments)
        raise InputError("far enough")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(RECIPES, recipe, dataclasses.replace(RECIPES[recipe], train=stop))
    data = [] if recipe == "any-body" else ["data"]
    assert proxops("train", *data, "--recipe", recipe) == 2
    assert Path(folder) in given


def test_without_torch_it_says_what_to_do(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setitem(sys.modules, "torch", None)
    for name in [name for name in sys.modules if name.startswith("proxops.training.")]:
        monkeypatch.delitem(sys.modules, name)
    assert proxops("train", tmp_path, "--recipe", "paper", "--out", tmp_path / "out") == 2
    assert "make train" in capfd.readouterr().err
