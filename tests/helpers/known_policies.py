"""Policies for tests that have learned nothing: their answers are known in closed form."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from exported_once import exported_once
from pydrake.systems.framework import Context
from short_flights import SHORT, kleopatra
from torch import Tensor, nn

from proxops.systems import NeuralPolicy
from proxops.systems.policy import PolicyFacts
from proxops.training.export.policy_export import Example, export_policy

RAYS = 4320
PERIOD, MASS = 10.0, 100.0
START = SHORT["transit.start_m"]


class Counting(nn.Module):
    """Counts steps, sums up the applied forces, and measures the frame; it estimates nothing.

    Memory: steps so far, sum of the applied forces. Force: in N the number of this step from 0,
    the sum along y, and the nearest return in 100 km.
    """

    MEMORY, ESTIMATES = 4, False

    def forward(
        self, ranges: Tensor, target: Tensor, commanded_force: Tensor, memory: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        count, total = memory[:, :1], memory[:, 1:] + commanded_force
        nearest = ranges.amin(dim=1, keepdim=True) / 1e5
        force = torch.cat([count, total[:, 1:2], nearest], dim=1)
        return force, torch.full_like(target, torch.nan), torch.cat([count + 1.0, total], dim=1)


class NotANumber(Counting):
    """Works like `Counting`, but each third step divides 0 by 0 in the force.

    It claims to estimate: 0.9 of the target.
    """

    ESTIMATES = True

    def forward(self, ranges, target, commanded_force, memory):
        force, _, following = super().forward(ranges, target, commanded_force, memory)
        left = 2.0 - memory[:, :1]
        return force * (left / left), 0.9 * target, following


class DeadReckoning(nn.Module):
    """PD control of where forces alone would have taken it from `SHORT`'s start, at rest.

    Memory: whether there was a step before, position and velocity then, in m and m/s.
    """

    MEMORY, ESTIMATES = 7, True

    start: Tensor

    def __init__(self, proportional: float = 0.01, derivative: float = 4.0):
        super().__init__()
        self.proportional, self.derivative = proportional, derivative
        self.register_buffer("start", torch.tensor([[*START, 0.0, 0.0, 0.0]]))

    def forward(
        self, ranges: Tensor, target: Tensor, commanded_force: Tensor, memory: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        under_way = memory[:, :1]
        before = under_way * memory[:, 1:] + (1.0 - under_way) * self.start
        pushed = commanded_force / MASS * PERIOD
        velocity = before[:, 3:] + pushed
        position = before[:, :3] + PERIOD * (before[:, 3:] + 0.5 * pushed) * under_way
        estimate = torch.cat([position, velocity], dim=1)
        error = target - estimate
        force = self.proportional * error[:, :3] + self.derivative * error[:, 3:]
        return force, estimate, torch.cat([torch.ones_like(under_way), estimate], dim=1)


def facts_of(module: type[Counting] | type[DeadReckoning], **changes) -> PolicyFacts:
    facts = {
        "recipe": "closed form",
        "planes": 12,
        "rays": 360,
        "period": PERIOD,
        "thrust_limit": 7.0,
        "memory": module.MEMORY,
        "estimates": module.ESTIMATES,
        "body": "Kleopatra",
        "shape_sha256": kleopatra().shape.sha256,
        "data_sha256": "0" * 64,
        "metrics": {"validation_loss_n": 0.5},
    }
    return PolicyFacts(**(facts | changes))


def example_steps(steps: int = 5, rays: int = RAYS) -> Sequence[Example]:
    """Two sequences, of which the first has no return at all in its first frame."""
    random = np.random.default_rng(3)
    examples = []
    for _ in range(2):
        ranges = np.where(
            random.random((steps, rays)) < 0.05, random.uniform(4e4, 2e5, (steps, rays)), np.inf
        )
        target = np.tile([160e3, 8e3, 0.0, 0.0, 0.0, 0.0], (steps, 1))
        commanded_force = random.uniform(-7.0, 7.0, (steps, 3))
        commanded_force[0] = 0.0
        examples.append((ranges, target, commanded_force))
    return examples


def write_policy(folder: Path, module: Counting | DeadReckoning, **changes) -> Path:
    """A bundle in `folder`, checked on steps before anything that divides by 0."""
    facts = facts_of(type(module), **changes)
    steps = 2 if isinstance(module, NotANumber) else 5

    def export(bundle: Path) -> None:
        export_policy(module, bundle, facts, example_steps(steps, facts.planes * facts.rays))

    settings = {name: value for name, value in vars(module).items() if not name.startswith("_")}
    return exported_once(folder, (type(module), repr(settings), repr(facts)), export)


def remember(policy: NeuralPolicy, context: Context) -> None:
    """The policy's update at the end of a step, without a simulator."""
    memory = policy.EvalUniquePeriodicDiscreteUpdate(context)
    context.get_mutable_discrete_state().SetFrom(memory)
