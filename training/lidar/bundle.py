"""From a trained network to the bundle of a learned lidar."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

from proxops.systems.common import InputError, open_session
from proxops.systems.lidar import (
    CHORDS_INPUT,
    DEPTH_OUTPUT,
    FRAME_NETWORK,
    HIT_OUTPUT,
    LIDAR_BUNDLE,
    POSITION_INPUT,
    RANGES_OUTPUT,
    RAY_NETWORK,
)
from proxops.training.export import accepted_difference, onnx_bytes

Facts = dict[str, Any]
"""What the manifests of both kinds say besides their network: planes, rays, cube_m, body,
shape_sha256 and training."""


def write_bundle(
    folder: Path,
    network: nn.Module,
    facts: Facts,
    ellipsoid: tuple[np.ndarray, np.ndarray],
    ends: np.ndarray,
) -> None:
    """Exports a ray network, checks it, and writes its bundle; an older bundle is replaced.

    Args:
      ellipsoid: centre (3,) and semi-axes (3,) in m of the ellipsoid that cuts rays to chords.
      ends: (K, 6) chord ends to check the export on.

    Raises:
      InputError: the check fails, or the folder cannot be written.
    """
    outputs = (HIT_OUTPUT, DEPTH_OUTPUT)
    rays = ({0: torch.export.Dim("rays")},)  # Any number of rays, none included.
    model = onnx_bytes(network, (torch.zeros(2, 6),), [CHORDS_INPUT], outputs, rays)
    centre, semi_axes = (each.tolist() for each in ellipsoid)
    own = {"kind": RAY_NETWORK, "centre_m": centre, "semi_axes_m": semi_axes}
    _write(folder, model, facts | own, difference(model, network, CHORDS_INPUT, outputs, [ends]))


def write_frame_bundle(
    folder: Path,
    network: nn.Module,
    facts: Facts,
    length_unit: float,
    positions: np.ndarray,
) -> None:
    """Exports a frame network, checks it, and writes its bundle; an older bundle is replaced.

    Args:
      network: gives ranges (1, planes * rays) for positions (1, 3) over half of the cube's edge.
      length_unit: unit of its ranges in m.
      positions: (N, 3) in m in K, to check the export on.

    Raises:
      InputError: the check fails, or the folder cannot be written.
    """
    outputs = (RANGES_OUTPUT,)
    model = onnx_bytes(network, (torch.zeros(1, 3),), [POSITION_INPUT], outputs)
    rows = (positions / (0.5 * facts["cube_m"])).astype(np.float32)[:, None]
    own = {"kind": FRAME_NETWORK, "length_unit_m": float(length_unit)}
    _write(folder, model, facts | own, difference(model, network, POSITION_INPUT, outputs, rows))


@torch.no_grad()
def difference(
    model: bytes,
    network: nn.Module,
    input_name: str,
    outputs: Sequence[str],
    inputs: Sequence[np.ndarray] | np.ndarray,
) -> float:
    """The greatest relative difference of all outputs, between ONNX Runtime and torch.

    Raises:
      InputError: it is above 1e-4, or an output is not finite.
    """
    session = open_session(model)
    greatest = 0.0
    for given in inputs:
        answer = network(torch.from_numpy(given))
        wanted = [each.numpy() for each in (answer if isinstance(answer, tuple) else (answer,))]
        if not all(np.isfinite(output).all() for output in wanted):
            raise InputError("the network's output is not finite: no bundle is written")
        got = map(np.asarray, session.run(list(outputs), {input_name: given}))
        greatest = max(greatest, *map(accepted_difference, wanted, got))
    return greatest


def _write(folder: Path, model: bytes, content: Facts, off: float) -> None:
    training = content["training"] | {"onnx_difference": off}
    LIDAR_BUNDLE.write(folder, content | {"training": training}, model)
