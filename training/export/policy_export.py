"""From a trained policy to the bundle that flies."""

from __future__ import annotations

import copy
import typing
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from proxops.systems.common import InputError, open_session
from proxops.systems.policy import (
    POLICY_FILE,
    POLICY_FORMAT,
    POLICY_INPUTS,
    POLICY_OUTPUTS,
    check_network,
    run_network,
)
from proxops.training.export.onnx_export import (
    accepted_difference,
    describing,
    onnx_bytes,
    write_bundle_folder,
)

REPORT_FILE = "report.md"

Example = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Consecutive steps from a flight's start: ranges (T, planes * rays) in m, +inf where nothing
returned; target (T, 6) in m and m/s; the force applied before each step (T, 3) in N."""


@dataclass(frozen=True)
class PolicyFacts:
    """What a bundle says besides its network."""

    recipe: str
    """How it was trained."""
    planes: int
    rays: int
    period: float
    """Control period in s."""
    thrust_limit: float
    """Greatest force per axis in N in the data."""
    memory: int
    """Length of what it remembers from step to step; at least 1."""
    estimates: bool
    """Whether it estimates position and velocity."""
    body: str
    """Name of the body."""
    shape_sha256: str
    data_sha256: str
    """Of the data that it was trained on."""
    metrics: dict[str, typing.Any] = field(default_factory=dict)
    """Whatever is worth telling of its training, as JSON takes it."""


def export_policy(
    module: nn.Module,
    folder: Path,
    facts: PolicyFacts,
    examples: Sequence[Example],
    report: str | None = None,
) -> None:
    """Exports a policy, checks it, and writes its bundle; an older one is replaced.

    The folder appears under its name only when it is whole. The module itself stays as it is.

    Args:
      module: its `forward(ranges, target, applied_force, memory)` gives force, estimate and next
        memory, all of one row: see `proxops.systems.policy.policy_bundle`.
      examples: ONNX Runtime is run against torch on these.
      report: becomes `report.md`.

    Raises:
      InputError: it is no such module, ONNX Runtime's outputs differ from torch's by more than
        1e-5 of their size, it is not as the facts say, or the folder can't be written.
    """
    module = copy.deepcopy(module).cpu().eval()
    rays = facts.planes * facts.rays
    sizes = (rays, 6, 3, facts.memory)
    blank = tuple(torch.zeros(1, size) for size in sizes)
    model = onnx_bytes(module, blank, POLICY_INPUTS, POLICY_OUTPUTS)
    check_network(open_session(model), rays, facts.memory)
    content = {
        "format": POLICY_FORMAT,
        "recipe": facts.recipe,
        "planes": facts.planes,
        "rays": facts.rays,
        "period_s": float(facts.period),
        "thrust_limit_n": float(facts.thrust_limit),
        "memory": facts.memory,
        "estimates": facts.estimates,
        "body": facts.body,
        "shape_sha256": facts.shape_sha256,
        "data_sha256": facts.data_sha256,
        "metrics": facts.metrics,
        "onnx_difference": check_policy(model, module, facts, examples),
    }
    texts = {POLICY_FILE: describing(content, model)}
    if report is not None:
        texts[REPORT_FILE] = report
    write_bundle_folder(folder, model, texts)


def check_policy(
    model: bytes, module: nn.Module, facts: PolicyFacts, examples: Sequence[Example]
) -> float:
    """The greatest difference of ONNX Runtime and torch, relative to each output's size.

    At every step of the examples both are given the memory that torch has made.

    Raises:
      InputError: it is above 1e-5, there is nothing to compare, a force or memory is not finite,
        or there are estimates where the facts say that there are none, or none where some.
    """
    session = open_session(model)

    def of_torch(*vectors: np.ndarray) -> list[np.ndarray]:
        rows = [torch.as_tensor(vector, dtype=torch.float32)[None] for vector in vectors]
        with torch.no_grad():
            outputs: tuple[Tensor, ...] = module(*rows)
        return [output.numpy()[0] for output in outputs]

    answers = []
    for ranges, target, applied_force in examples:
        remembered = np.zeros(facts.memory, dtype=np.float32)
        for row in zip(ranges, target, applied_force, strict=True):
            both = of_torch(*row, remembered), run_network(session, *row, remembered)
            answers.append([np.concatenate(answer) for answer in both])
            remembered = both[0][2]
    if not answers:
        raise InputError("a policy needs example steps, to check its export on")
    wanted, got = (_parts(each) for each in np.array(answers).transpose(1, 0, 2))
    if not (np.isfinite(wanted["force"]).all() and np.isfinite(wanted["memory"]).all()):
        raise InputError("the policy gives a force or a memory that is not finite on an example")
    if np.isfinite(wanted["position"]).any() != facts.estimates:
        told = "no estimate" if facts.estimates else "an estimate"
        raise InputError(f"the policy gives {told}, but the facts say estimates={facts.estimates}")
    return max(accepted_difference(wanted[name], got[name]) for name in wanted)


def _parts(answers: np.ndarray) -> dict[str, np.ndarray]:
    """Outputs (steps, size) by name; position and velocity apart, for they differ in size."""
    names = ("force", "position", "velocity", "memory")
    return dict(zip(names, np.split(answers, [3, 6, 9], axis=1), strict=True))
