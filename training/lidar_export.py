"""From a trained ray network to the bundle that flies."""

from __future__ import annotations

import hashlib
import json
import logging
import shutil
import tempfile
import typing
import warnings
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

import numpy as np
import torch
from torch import nn

from proxops.diagrams.flight_log import make_folder
from proxops.systems.errors import InputError
from proxops.systems.lidar_bundle import (
    BUNDLE_FILE,
    DEPTH,
    FORMAT,
    HIT,
    INPUT,
    MODEL_FILE,
    open_session,
)

# An output of the exported network may differ from torch's by this much, relative to the output's
# greatest magnitude. Not value by value: logits near 0 are differences of numbers around 100, and
# single precision itself leaves them uncertain by some 4e-5.
_TOLERANCE = 1e-5


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
    example = torch.zeros(2, 6)
    # It says there that torchvision, which nothing here needs, is not installed.
    logging.getLogger("torch.onnx._internal.exporter._registration").setLevel(logging.ERROR)
    with warnings.catch_warnings():
        # The exporter uses parts of torch that torch itself calls deprecated.
        warnings.simplefilter("ignore")
        program = torch.onnx.export(
            network.eval(),
            (example,),
            input_names=[INPUT],
            output_names=[HIT, DEPTH],
            dynamic_shapes=({0: torch.export.Dim("rays")},),
            dynamo=True,
            verbose=False,
        )
    assert program is not None
    return program.model_proto.SerializeToString()


def check_model(model: bytes, network: nn.Module, ends: np.ndarray) -> float:
    """The greater relative difference, of both outputs, of ONNX Runtime and torch.

    Args:
      ends: (K, 6) chord ends to compare on.

    Raises:
      InputError: it is above 1e-5, or not a number.
    """
    with torch.no_grad():
        wanted = [output.numpy() for output in network(torch.from_numpy(ends))]
    got = open_session(model).run([HIT, DEPTH], {INPUT: ends})
    worst = 0.0
    for one, other in zip(wanted, map(np.asarray, got), strict=True):
        difference = float(np.abs(one - other).max() / np.abs(one).max())
        worst = max(worst, difference)
        if not difference <= _TOLERANCE:
            raise InputError(
                f"the exported network differs from the trained one by {difference:.1e} "
                f"(relative), more than {_TOLERANCE:g}: no bundle is written"
            )
    return worst


def write_bundle(folder: Path, network: nn.Module, facts: BundleFacts, ends: np.ndarray) -> None:
    """Exports, checks on chord ends (K, 6), and writes the bundle; an older one is replaced.

    The folder appears under its name only when it is whole.

    Raises:
      InputError: the check fails, or the folder can't be written.
    """
    model = onnx_model(network)
    content = {
        "format": FORMAT,
        "planes": facts.planes,
        "rays": facts.rays,
        "cube_m": float(facts.cube),
        "centre_m": [float(x) for x in facts.centre],
        "semi_axes_m": [float(x) for x in facts.semi_axes],
        "body": facts.body,
        "shape_sha256": facts.shape_sha256,
        "model_sha256": hashlib.sha256(model).hexdigest(),
        "training": facts.training | {"onnx_difference": check_model(model, network, ends)},
        "versions": {
            name: metadata.version(name) for name in ("proxops", "torch", "onnx", "onnxruntime")
        },
    }
    make_folder(folder.parent)
    try:
        part = Path(tempfile.mkdtemp(dir=folder.parent, prefix=f".{folder.name}.", suffix=".part"))
        part.chmod(0o755)
        try:
            (part / MODEL_FILE).write_bytes(model)
            (part / BUNDLE_FILE).write_text(json.dumps(content, indent=2) + "\n")
            older = part.with_suffix(".old")
            if folder.exists():
                folder.rename(older)
            part.rename(folder)
            shutil.rmtree(older, ignore_errors=True)
        finally:
            shutil.rmtree(part, ignore_errors=True)
    except OSError as error:
        raise InputError(f"cannot write {folder}: {error.strerror or error}") from error
