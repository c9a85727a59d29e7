"""From a trained policy of either kind to its bundle, which flies."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from proxops.systems.common import InputError, open_session
from proxops.systems.policy import (
    DESCENT_BUNDLE,
    GUIDANCE_BUNDLE,
    POLICY_BUNDLE,
    POLICY_INPUTS,
    POLICY_OUTPUTS,
    PolicyFacts,
    check_network,
    run_network,
)
from proxops.training.export.onnx_export import accepted_difference, onnx_bytes
from proxops.training.networks import AnyBodyGuidance, DescentCorrection

Example = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Consecutive steps from a flight's start: ranges (T, planes * rays) in m, +inf where nothing
returned; target (T, 6) in m and m/s; the force commanded before each step (T, 3) in N."""


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
    content = facts.told() | {"onnx_difference": check_policy(model, module, facts, examples)}
    POLICY_BUNDLE.write(folder, content, model, report)


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


@torch.no_grad()
def export_guidance(
    network: AnyBodyGuidance,
    folder: Path,
    examples: Tensor,
    ranges: dict[str, list[float]],
    report: dict[str, Any],
    text: str,
) -> None:
    """Exports a guidance for any body, checks it, and writes its bundle; an older one is replaced.

    Args:
      examples: (N, 23) rows on which what flies is run against torch.
      ranges: least and greatest value of each of `Surroundings.numbers` that it learned.
      report: of the training. text: content of `report.md`.

    Raises:
      InputError: the networks differ by more than 1e-4 of a force, or the folder cannot be written.
    """
    compiled = network.compiled()
    compiled.check()
    got = np.array([compiled.run(row) for row in examples.numpy()])
    content = {
        "recipe": report["recipe"],
        "ranges": ranges,
        "data_sha256": report["data_sha256"],
        "metrics": report["training"],
        "kernel_difference": accepted_difference(network(examples).numpy(), got),
    }
    GUIDANCE_BUNDLE.write(folder, content, compiled.to_bytes(), text)


@torch.no_grad()
def export_descent(
    network: DescentCorrection,
    folder: Path,
    examples: Tensor,
    report: dict[str, Any],
    text: str,
) -> None:
    """Exports a descent, checks it, and writes its bundle; an older one is replaced.

    Args:
      examples: (N, 22) rows on which what flies is run against torch.
      report: of the training. text: content of `report.md`.

    Raises:
      InputError: the networks differ by more than 1e-4, or the folder cannot be written.
    """
    compiled = network.compiled()
    got = compiled.correction(examples.numpy())
    content = {
        "recipe": report["recipe"],
        "data_sha256": report["data_sha256"],
        "metrics": report["training"],
        "kernel_difference": accepted_difference(network(examples).numpy(), got),
    }
    DESCENT_BUNDLE.write(folder, content, compiled.to_bytes(), text)
