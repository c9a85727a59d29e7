"""From a trained guidance to its bundle, which flies."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from proxops.systems.policy import (
    GUIDANCE_FILE,
    GUIDANCE_FORMAT,
    WEIGHTS_FILE,
    Surroundings,
)
from proxops.training.any_body.network import AnyBodyGuidance
from proxops.training.export import (
    accepted_difference,
    describing,
    write_folder,
)


def ranges_of(members: Sequence[Surroundings]) -> dict[str, list[float]]:
    """Least and greatest value of each of `Surroundings.numbers` over members of a family."""
    numbers = [member.numbers() for member in members]
    return {
        name: [min(each[name] for each in numbers), max(each[name] for each in numbers)]
        for name in numbers[0]
    }


def export_guidance(
    network: AnyBodyGuidance,
    folder: Path,
    examples: Tensor,
    ranges: dict[str, list[float]],
    report: dict[str, Any],
    text: str,
) -> None:
    """Exports a guidance, checks it, and writes its bundle; an older bundle is replaced.

    Args:
      network: the guidance. folder: of the bundle.
      examples: (N, 23) rows on which what flies is run against torch.
      ranges: see `ranges_of`. report: of the training. text: content of `report.md`.

    Raises:
      InputError: the networks differ by more than 1e-4 of a force.
    """
    compiled = network.compiled()
    compiled.check()
    with torch.no_grad():
        wanted = network(examples).numpy()
    got = np.array([compiled.run(row) for row in examples.numpy()])
    weights = compiled.to_bytes()
    content = {
        "format": GUIDANCE_FORMAT,
        "recipe": report["recipe"],
        "ranges": ranges,
        "data_sha256": report["data_sha256"],
        "metrics": report["training"],
        "kernel_difference": accepted_difference(wanted, got),
    }
    files = {GUIDANCE_FILE: describing(content, weights).encode(), "report.md": text.encode()}
    write_folder(folder, {WEIGHTS_FILE: weights, **files})
