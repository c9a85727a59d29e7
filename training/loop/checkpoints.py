"""Checkpoints of trainings: written whole, and refused by another training than their own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch
from lightning.fabric import Fabric

from proxops.systems.common import InputError, write_whole


def save_checkpoint(path: Path, identity: str, state: dict[str, Any]) -> None:
    """Writes `state` and whose it is; a kill leaves the checkpoint before it."""
    content = {"identity": identity, **state}
    write_whole(path, lambda name: torch.save(content, name))


def load_checkpoint(fabric: Fabric, path: Path, identity: str) -> dict[str, Any] | None:
    """What `save_checkpoint` wrote; None if there is none.

    Raises:
      InputError: the file is damaged, or of a training of another identity.
    """
    if not path.exists():
        return None
    try:
        saved = fabric.load(path)
        known = saved["identity"]
    except Exception as error:  # A damaged file makes torch raise all sorts.
        raise InputError(f"{path} is not a checkpoint of a training: remove it") from error
    if known != identity:
        raise InputError(
            f"{path} is of a training with other settings, data, body or version: "
            "give another output folder, or remove that one"
        )
    return saved
