"""From a trained network to the bundle of a learned lidar."""

from __future__ import annotations

import typing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from proxops.systems.common import InputError, open_session
from proxops.systems.lidar import (
    CHORDS_INPUT,
    DEPTH_OUTPUT,
    FRAME_NETWORK,
    HIT_OUTPUT,
    LIDAR_FILE,
    LIDAR_FORMAT,
    POSITION_INPUT,
    RANGES_OUTPUT,
    RAY_NETWORK,
)
from proxops.training.export import accepted_difference, describing, onnx_bytes, write_bundle_folder

_RAY_OUTPUTS = (HIT_OUTPUT, DEPTH_OUTPUT)


@dataclass(frozen=True)
class BundleFacts:
    """What the bundles of both kinds say besides their network."""

    planes: int
    rays: int
    cube: float
    """Edge in m of the cube of training positions."""
    body: str
    """Name of the body."""
    shape_sha256: str
    training: dict[str, typing.Any]
    """Figures of the training, as JSON takes them."""


def onnx_model(network: nn.Module) -> bytes:
    """A ray network as an ONNX file, for any number of rays, none included."""
    rays = ({0: torch.export.Dim("rays")},)
    return onnx_bytes(network, (torch.zeros(2, 6),), [CHORDS_INPUT], _RAY_OUTPUTS, rays)


def check_model(model: bytes, network: nn.Module, ends: np.ndarray) -> float:
    """The greatest relative difference between ONNX Runtime and torch for a ray network.

    Args:
      ends: (K, 6) chord ends to compare on.

    Raises:
      InputError: it is above 1e-4, or an output is not finite.
    """
    return _difference(model, network, CHORDS_INPUT, _RAY_OUTPUTS, [ends])


def write_bundle(
    folder: Path,
    network: nn.Module,
    facts: BundleFacts,
    ellipsoid: tuple[np.ndarray, np.ndarray],
    ends: np.ndarray,
) -> None:
    """Exports a ray network, checks it, and writes its bundle; an older bundle is replaced.

    The folder appears under its name only when it is complete.

    Args:
      ellipsoid: centre (3,) and semi-axes (3,) in m of the ellipsoid that cuts rays to chords.
      ends: (K, 6) chord ends to check the export on.

    Raises:
      InputError: the check fails, or the folder cannot be written.
    """
    centre, semi_axes = ellipsoid
    model = onnx_model(network)
    own = {
        "kind": RAY_NETWORK,
        "centre_m": [float(x) for x in centre],
        "semi_axes_m": [float(x) for x in semi_axes],
    }
    _write(folder, model, facts, own, check_model(model, network, ends))


def write_frame_bundle(
    folder: Path,
    network: nn.Module,
    facts: BundleFacts,
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
    model = onnx_bytes(network, (torch.zeros(1, 3),), [POSITION_INPUT], [RANGES_OUTPUT])
    scaled = (positions / (0.5 * facts.cube)).astype(np.float32)
    rows = [row[None] for row in scaled]
    difference = _difference(model, network, POSITION_INPUT, (RANGES_OUTPUT,), rows)
    own = {"kind": FRAME_NETWORK, "length_unit_m": float(length_unit)}
    _write(folder, model, facts, own, difference)


def _difference(
    model: bytes,
    network: nn.Module,
    input_name: str,
    outputs: tuple[str, ...],
    inputs: list[np.ndarray],
) -> float:
    """The greatest relative difference of all outputs, between ONNX Runtime and torch."""
    session = open_session(model)
    greatest = 0.0
    for given in inputs:
        with torch.no_grad():
            answer: Tensor | tuple[Tensor, ...] = network(torch.from_numpy(given))
        tensors = (answer,) if isinstance(answer, Tensor) else answer
        wanted = [tensor.numpy() for tensor in tensors]
        if not all(np.isfinite(output).all() for output in wanted):
            raise InputError("the network's output is not finite: no bundle is written")
        got = map(np.asarray, session.run(list(outputs), {input_name: given}))
        greatest = max(greatest, *map(accepted_difference, wanted, got))
    return greatest


def _write(
    folder: Path, model: bytes, facts: BundleFacts, own: dict[str, typing.Any], difference: float
) -> None:
    """Writes a bundle; `own` is what only its kind says."""
    content = {
        "format": LIDAR_FORMAT,
        "planes": facts.planes,
        "rays": facts.rays,
        "cube_m": float(facts.cube),
        **own,
        "body": facts.body,
        "shape_sha256": facts.shape_sha256,
        "training": facts.training | {"onnx_difference": difference},
    }
    write_bundle_folder(folder, model, {LIDAR_FILE: describing(content, model)})
