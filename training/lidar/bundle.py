"""From a trained ray network to the bundle that flies."""

from __future__ import annotations

import typing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import nn

from proxops.systems.common import InputError, open_session
from proxops.systems.lidar import CHORDS_INPUT, DEPTH_OUTPUT, HIT_OUTPUT, LIDAR_FILE, LIDAR_FORMAT
from proxops.training.export import accepted_difference, describing, onnx_bytes, write_bundle_folder


@dataclass(frozen=True)
class BundleFacts:
    """What a bundle says besides its network."""

    planes: int
    rays: int
    cube: float
    centre: np.ndarray
    semi_axes: np.ndarray
    body: str
    shape_sha256: str
    training: dict[str, typing.Any]


def onnx_model(network: nn.Module) -> bytes:
    """The network as an ONNX file, for any number of rays, none included."""
    rays = ({0: torch.export.Dim("rays")},)
    return onnx_bytes(
        network, (torch.zeros(2, 6),), [CHORDS_INPUT], [HIT_OUTPUT, DEPTH_OUTPUT], rays
    )


def check_model(model: bytes, network: nn.Module, ends: np.ndarray) -> float:
    """The greater relative difference, of both outputs, of ONNX Runtime and torch.

    Args:
      ends: (K, 6) chord ends to compare on.

    Raises:
      InputError: it is above 1e-5, or an output is not finite.
    """
    with torch.no_grad():
        wanted = [output.numpy() for output in network(torch.from_numpy(ends))]
    if not all(np.isfinite(output).all() for output in wanted):
        raise InputError("the network's output is not finite: no bundle is written")
    got = open_session(model).run([HIT_OUTPUT, DEPTH_OUTPUT], {CHORDS_INPUT: ends})
    return max(map(accepted_difference, wanted, map(np.asarray, got)))


def write_bundle(folder: Path, network: nn.Module, facts: BundleFacts, ends: np.ndarray) -> None:
    """Exports, checks on chord ends (K, 6), and writes the bundle; an older one is replaced.

    The folder appears under its name only when it is whole.

    Raises:
      InputError: the check fails, or the folder can't be written.
    """
    model = onnx_model(network)
    content = {
        "format": LIDAR_FORMAT,
        "planes": facts.planes,
        "rays": facts.rays,
        "cube_m": float(facts.cube),
        "centre_m": [float(x) for x in facts.centre],
        "semi_axes_m": [float(x) for x in facts.semi_axes],
        "body": facts.body,
        "shape_sha256": facts.shape_sha256,
        "training": facts.training | {"onnx_difference": check_model(model, network, ends)},
    }
    write_bundle_folder(folder, model, {LIDAR_FILE: describing(content, model)})
