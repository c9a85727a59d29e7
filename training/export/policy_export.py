"""From a trained policy to its bundle, which flies."""

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
returned; target (T, 6) in m and m/s; the force commanded before each step (T, 3) in N."""


@dataclass(frozen=True)
class PolicyFacts:
    """The facts in a bundle beside its network."""

    recipe: str
    """Name of the recipe."""
    planes: int
    rays: int
    period: float
    """Control period in s."""
    thrust_limit: float
    """Greatest force per axis in N in the data."""
    memory: int
    """Length of the memory from step to step; at least 1."""
    estimates: bool
    """Whether it estimates position and velocity."""
    body: str
    """Name of the body."""
    shape_sha256: str
    data_sha256: str
    """Hash of the training data."""
    metrics: dict[str, typing.Any] = field(default_factory=dict)
    """Further figures of the training, as JSON takes them."""


def export_policy(
    module: nn.Module,
    folder: Path,
    facts: PolicyFacts,
    examples: Sequence[Example],
    report: str | None = None,
) -> None:
    """Exports a policy, checks it, and writes its bundle; an older bundle is replaced.

    The folder appears under its name only when it is complete. The module is not changed.

    Args:
      module: its `forward(ranges, target, commanded_force, memory)` gives force, estimate and next
        memory, all of one row: see `proxops.systems.policy.policy_bundle`.
      facts: are written to the bundle.
      examples: steps on which ONNX Runtime is run against torch.
      report: content of `report.md`.

    Raises:
      InputError: the module has another interface or does not fit the facts; ONNX Runtime's outputs
        differ from torch's by more than 1e-4 of their size; or the folder cannot be written.
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
    """The greatest difference between ONNX Runtime and torch, relative to each output's size.

    At every step of the examples both get the memory that torch computed.

    Raises:
      InputError: the difference is above 1e-4; there are no examples; a force or memory is not
        finite; or the policy estimates the state although the facts say that it does not, or the
        reverse.
    """
    session = open_session(model)

    def of_torch(*vectors: np.ndarray) -> list[np.ndarray]:
        rows = [torch.as_tensor(vector, dtype=torch.float32)[None] for vector in vectors]
        with torch.no_grad():
            outputs: tuple[Tensor, ...] = module(*rows)
        return [output.numpy()[0] for output in outputs]

    answers = []
    for ranges, target, commanded_force in examples:
        remembered = np.zeros(facts.memory, dtype=np.float32)
        for row in zip(ranges, target, commanded_force, strict=True):
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
    """Outputs (steps, size) by name; position and velocity apart, because their sizes differ."""
    names = ("force", "position", "velocity", "memory")
    return dict(zip(names, np.split(answers, [3, 6, 9], axis=1), strict=True))
