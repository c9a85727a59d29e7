"""A policy's bundle: what it says, when it is not written, and what damage does."""

import hashlib
from pathlib import Path

import numpy as np
import pytest
import torch
from exported_once import change_json, copied
from known_policies import (
    Counting,
    DeadReckoning,
    example_steps,
    facts_of,
    remember,
    write_policy,
)
from torch import nn

from proxops.systems import InputError, NeuralPolicy
from proxops.systems.common import whole_folder
from proxops.training.export import export_policy, policy_export


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_policy(tmp_path_factory.mktemp("policy") / "bundle", DeadReckoning())


def write_folder(folder: Path, content: bytes, name: str = "model") -> None:
    with whole_folder(folder) as part:
        (part / name).write_bytes(content)


def test_after_a_kill_between_two_bundles_the_older_one_is_put_back(tmp_path: Path) -> None:
    folder = tmp_path / "bundle"
    write_folder(folder, b"1")
    folder.rename(tmp_path / ".bundle.abcdefgh.old.folder")
    with pytest.raises(InputError, match="cannot write"):
        write_folder(folder, b"2", "no/such/file")
    assert set(tmp_path.iterdir()) == {folder}
    assert (folder / "model").read_bytes() == b"1"


# --- what is not written --------------------------------------------------------------------------


def refused(tmp_path: Path, why: str, module: nn.Module, facts, examples=None) -> None:
    with pytest.raises(InputError, match=why):
        export_policy(module, tmp_path / "policy", facts, examples or example_steps())
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_difference_that_only_memory_shows_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A force that differs from the second step on: one step alone would pass."""
    onnx_bytes = policy_export.onnx_bytes

    class Late(Counting):
        def forward(self, ranges, target, commanded_force, memory):
            force, estimate, following = super().forward(ranges, target, commanded_force, memory)
            return force * (1.0 + 1e-3 * memory[:, :1]), estimate, following

    monkeypatch.setattr(
        policy_export, "onnx_bytes", lambda module, *given: onnx_bytes(Late(), *given)
    )
    refused(tmp_path, "no bundle is written", Counting(), facts_of(Counting))
    one = [(ranges[:1], target[:1], force[:1]) for ranges, target, force in example_steps()]
    export_policy(Counting(), tmp_path / "policy", facts_of(Counting), one)


@pytest.mark.slow
def test_what_is_not_as_the_facts_say_is_refused(tmp_path: Path) -> None:
    refused(tmp_path, "gives no estimate", Counting(), facts_of(Counting, estimates=True))
    known = facts_of(DeadReckoning, estimates=False)
    refused(tmp_path, "gives an estimate", DeadReckoning(), known)

    class Shorter(Counting):
        def forward(self, ranges, target, commanded_force, memory):
            force, estimate, following = super().forward(ranges, target, commanded_force, memory)
            return force, estimate, following[:, :2]

    refused(tmp_path, "the network's outputs are", Shorter(), facts_of(Counting))


@pytest.mark.slow
def test_nothing_finite_and_nothing_to_compare(tmp_path: Path) -> None:
    [first, second] = example_steps()
    blind = (np.full_like(first[0], np.inf), *first[1:])
    refused(tmp_path, "not finite on an example", Counting(), facts_of(Counting), [blind, second])
    with pytest.raises(InputError, match="needs example steps"):
        export_policy(Counting(), tmp_path / "policy", facts_of(Counting), [])


# --- damage ---------------------------------------------------------------------------------------


def change(folder: Path, **changes: object) -> None:
    change_json(folder / "policy.json", **changes)


def flip_a_byte(folder: Path) -> None:
    model = bytearray((folder / "model.onnx").read_bytes())
    model[len(model) // 2] ^= 1
    (folder / "model.onnx").write_bytes(model)


def put_no_network(folder: Path) -> None:
    (folder / "model.onnx").write_bytes(b"no network")
    change(folder, model_sha256=hashlib.sha256(b"no network").hexdigest())


DAMAGES = {
    "model.onnx cannot be read .*proxops train": lambda folder: (folder / "model.onnx").unlink(),
    "policy.json cannot be read .*proxops train": lambda folder: (folder / "policy.json").unlink(),
    "its hash is not the one in policy.json": flip_a_byte,
    "not one that ONNX Runtime takes": put_no_network,
    "is not of the format": lambda folder: change(folder, format="proxops learned lidar 1"),
    "metrics is no dict": lambda folder: change(folder, metrics=None),
    "thrust_limit_n is not positive": lambda folder: change(folder, thrust_limit_n=-7.0),
    "is no policy: the network's inputs are": lambda folder: change(folder, memory=8),
}


@pytest.mark.parametrize("why", DAMAGES)
def test_damaged_bundle_is_refused(bundle: Path, tmp_path: Path, why: str) -> None:
    folder = copied(bundle, tmp_path)
    DAMAGES[why](folder)
    with pytest.raises(InputError, match=why):
        NeuralPolicy(folder)


def test_weights_are_torch_s(tmp_path: Path) -> None:
    """A trained network, not a closed form: a GRU cell over the frame's sectors."""

    class Recurrent(nn.Module):
        def __init__(self):
            super().__init__()
            self.cell, self.head = nn.GRUCell(12 + 9, 16), nn.Linear(16, 3)

        def forward(self, ranges, target, commanded_force, memory):
            near = torch.where(ranges < torch.inf, 1e5 / ranges, 0.0).view(-1, 12, 360).mean(dim=2)
            memory = self.cell(torch.cat([near, target / 1e5, commanded_force], dim=1), memory)
            return self.head(memory), torch.full_like(target, torch.nan), memory

    torch.manual_seed(5)
    module = Recurrent()
    facts = facts_of(Counting, memory=16)
    examples = example_steps(30)
    export_policy(module, tmp_path / "policy", facts, examples)
    policy = NeuralPolicy(tmp_path / "policy")
    context = policy.CreateDefaultContext()
    memory = torch.zeros(1, 16)
    for row in zip(*examples[0], strict=True):
        for name, value in zip(("ranges", "target", "commanded_force"), row, strict=True):
            policy.GetInputPort(name).FixValue(context, value)
        tensors = [torch.tensor(value, dtype=torch.float32)[None] for value in row]
        with torch.no_grad():
            force, _, memory = module(*tensors, memory)
        got = policy.GetOutputPort("force").Eval(context)
        assert got == pytest.approx(force[0].numpy(), abs=1e-6)
        remember(policy, context)
