"""The paper's network: its interface, its memory, and how it takes frames."""

import math

import pytest
import torch
from torch import Tensor

from proxops.training.data.normalisation import Normalisation, Scale
from proxops.training.networks.paper_policy import PaperPolicy

NORMALISATION = Normalisation(
    position=Scale((1e4, -2e4, 3e3), (9e4, 8e4, 7e4)),
    velocity=Scale((-3.0, 2.0, 0.5), (20.0, 18.0, 12.0)),
    force=Scale((0.5, -0.25, 0.125), (1.5, 1.25, 1.0)),
    range=Scale((80e3,), (40e3,)),
)


def small_policy(rays: int = 40) -> PaperPolicy:
    torch.manual_seed(1)
    return PaperPolicy(NORMALISATION, 3, rays, channels=(4, 8), width=16, layers=2).eval()


def inputs(batch: int, steps: int, rays: int) -> tuple[Tensor, Tensor, Tensor]:
    """Ranges with one ray in ten returning, targets, applied forces."""
    ranges = torch.where(torch.rand(batch, steps, rays) < 0.1, 2e5 * torch.rand(()), math.inf)
    return ranges, 1e5 * torch.randn(batch, steps, 6), torch.randn(batch, steps, 3)


@torch.no_grad()
def test_steps_with_memory_are_the_sequence():
    policy = small_policy()
    ranges, target, applied = inputs(3, 9, 120)
    for memory in (torch.zeros(3, policy.memory_size), torch.randn(3, policy.memory_size)):
        whole, _, end = policy.sequence(ranges, target, applied, memory)
        one = memory
        for step in range(9):
            force, _, one = policy(ranges[:, step], target[:, step], applied[:, step], one)
            torch.testing.assert_close(force, whole[:, step], rtol=1e-5, atol=1e-6)
        torch.testing.assert_close(one, end, rtol=1e-5, atol=1e-6)
    again = policy.sequence(ranges, target, applied)[0]
    zeros = policy.sequence(ranges, target, applied, torch.zeros(3, policy.memory_size))[0]
    assert torch.equal(again, zeros)


@torch.no_grad()
def test_no_return_is_minus_100_km():
    policy = small_policy()
    frame = torch.tensor([[[math.inf, 0.0, 80e3, 200e3]]])
    wanted = [0.0, 100.0 / 180.0, 1.0, 300.0 / 180.0]
    assert policy.network_frames(frame).flatten().tolist() == pytest.approx(wanted, abs=1e-5)
    given = policy.network_frames(torch.full((1, 1, 4), math.nan))
    assert given.flatten().tolist() == pytest.approx([0.0] * 4)


@torch.no_grad()
def test_the_two_ends_of_a_plane_meet():
    """Two strides of 4: what turns by 16 rays comes out turned by one place."""
    policy = small_policy(rays=64)
    frames = torch.randn(2, 3, 64)
    layers = policy.convolutions[:4]
    turned = layers(frames.roll(16, dims=-1))
    torch.testing.assert_close(turned, layers(frames).roll(1, dims=-1), rtol=1e-5, atol=1e-6)


@torch.no_grad()
def test_forces_and_goals_are_in_si():
    policy = small_policy()
    ranges, target, applied = inputs(1, 1, 120)
    last = policy.perceptron[-1]
    assert isinstance(last, torch.nn.Linear)
    last.weight.zero_()
    last.bias.copy_(torch.tensor([1.0, 0.0, -2.0]))
    force = policy.sequence(ranges, target, applied)[0]
    assert force.flatten().tolist() == pytest.approx([2.0, -0.25, -1.875])
    first = policy.perceptron[0]
    assert isinstance(first, torch.nn.Linear)
    seen = []
    first.register_forward_hook(lambda module, given, output: seen.append(given[0]))
    target[0, 0] = torch.tensor([1e5, -2e4, 3e3, -3.0, 20.0, 0.5])
    policy.sequence(ranges, target, applied)
    assert seen[0][0, 0, -6:].tolist() == pytest.approx([1.0, 0.0, 0.0, 0.0, 1.0, 0.0])
