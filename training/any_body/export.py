"""From a trained guidance to its bundle, which flies."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from proxops.systems.common import open_session
from proxops.systems.policy import (
    GUIDANCE_FILE,
    GUIDANCE_FORMAT,
    GUIDANCE_INPUT,
    GUIDANCE_OUTPUT,
    Surroundings,
    check_guidance_network,
    run_guidance,
)
from proxops.training.any_body.network import AnyBodyGuidance
from proxops.training.export import (
    accepted_difference,
    describing,
    onnx_bytes,
    write_bundle_folder,
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
      examples: (N, 22) rows on which ONNX Runtime is run against torch.
      ranges: see `ranges_of`. report: of the training. text: content of `report.md`.

    Raises:
      InputError: the networks differ by more than 1e-4 of a force.
    """
    model = onnx_bytes(network, (examples[:1],), [GUIDANCE_INPUT], [GUIDANCE_OUTPUT])
    session = open_session(model)
    check_guidance_network(session)
    with torch.no_grad():
        wanted = network(examples).numpy()
    got = np.array([run_guidance(session, row[None]) for row in examples.numpy()])
    content = {
        "format": GUIDANCE_FORMAT,
        "recipe": report["recipe"],
        "ranges": ranges,
        "data_sha256": report["data_sha256"],
        "metrics": report["training"],
        "onnx_difference": accepted_difference(wanted, got),
    }
    texts = {GUIDANCE_FILE: describing(content, model), "report.md": text}
    write_bundle_folder(folder, model, texts)
