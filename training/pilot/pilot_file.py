"""The file that keeps a trained pilot."""

from __future__ import annotations

import dataclasses as dc
from pathlib import Path

import numpy as np
import torch

from proxops.systems.common import InputError, file_sha256
from proxops.training.loop import write_tensors
from proxops.training.pilot.dimensions import PilotDimensions
from proxops.training.pilot.network import Pilot

PILOT_FILE = "pilot.ckpt"
# The key of the dimensions in the file.
_DIMENSIONS = "shape"
# Rays of a frame, and the widths of all layers together, in a file that is read.
_GREATEST_SIZE = 2**16


def save_pilot(folder: Path, dimensions: PilotDimensions, pilot: Pilot, origin: dict) -> None:
    """Writes a pilot, its dimensions and origin to `folder`; the file is complete or not there."""
    content = {_DIMENSIONS: dc.asdict(dimensions), "weights": pilot.state_dict(), "origin": origin}
    write_tensors(folder / PILOT_FILE, content)


def load_pilot(folder: Path) -> tuple[PilotDimensions, Pilot, dict]:
    """Reads what `save_pilot` wrote.

    Raises:
      InputError: there is no such file, or it holds no pilot.
    """
    path = folder / PILOT_FILE
    try:
        # Only tensors and plain values are read, so that a file from a stranger runs no code.
        content = torch.load(path, map_location="cpu", weights_only=True)
        dimensions, origin = PilotDimensions(**content[_DIMENSIONS]), dict(content["origin"])
        _check_size(dimensions, content["weights"])
        pilot = dimensions.make()
        pilot.load_state_dict(content["weights"])
        return dimensions, pilot.eval(), origin
    except Exception as error:  # A damaged file makes torch raise all sorts.
        raise InputError(
            f"{path} is no pilot that `proxops train --recipe proxops` wrote: {error}"
        ) from error


def _check_size(told: PilotDimensions, weights: dict[str, torch.Tensor]) -> None:
    """Raises `ValueError` for dimensions far beyond the weights: they would fill the memory."""
    cells = np.prod((np.array(told.high) - np.array(told.low)) / told.spacing + 2.0)
    widths = told.coarse_width + told.motion_width + told.guidance_width + told.hits
    rays = told.planes * told.rays
    if not cells <= 2 * weights["geometry.field.values"].numel():
        raise ValueError("the surface's grid is not as large as its values")
    if not (0 < rays <= _GREATEST_SIZE and 0 < widths <= _GREATEST_SIZE):
        raise ValueError("the network is too large")


def pilot_sha256(folder: Path) -> str:
    """Hash of the pilot's file in a folder."""
    return file_sha256(folder / PILOT_FILE)
