"""Checkpoints of trainings: written whole, and refused by any training but their own."""

from __future__ import annotations

import io
from importlib import metadata
from pathlib import Path
from typing import Any

import torch

from proxops.systems.common import InputError, write_whole

_KEYS = ("network", "optimizer", "history", "best")


def save_checkpoint(path: Path, identity: str, state: dict[str, Any]) -> None:
    """Writes `state` with the training's identity and the version of proxops.

    The file is replaced only when the new one is complete.
    """
    content = {"proxops": metadata.version("proxops"), "identity": identity, **state}
    write_tensors(path, content)


def write_tensors(path: Path, content: dict[str, Any]) -> None:
    """Writes tensors and plain values as PyTorch does; the file is complete or not there.

    Raises:
      InputError: see `write_whole`.
    """
    # PyTorch would report a full disk as an error of its own.
    memory = io.BytesIO()
    torch.save(content, memory)
    write_whole(path, lambda name: name.write_bytes(memory.getbuffer()))


def load_checkpoint(path: Path, identity: str) -> dict[str, Any] | None:
    """Reads what `save_checkpoint` wrote; None if there is no file.

    Only tensors and plain values are read, so that a file from a stranger runs no code.

    Raises:
      InputError: the file is no checkpoint, or was written by another version of proxops or by
        another training.
    """
    if not path.exists():
        return None
    try:
        saved = torch.load(path, map_location="cpu", weights_only=True)
        version, known = saved.get("proxops", "before 0.3"), saved["identity"]
        state = {key: saved[key] for key in _KEYS}
    except Exception as error:  # A damaged file makes torch raise all sorts of errors.
        raise InputError(f"{path} is not a checkpoint of a training: remove it") from error
    if version != metadata.version("proxops"):
        raise InputError(
            f"{path} was written by proxops {version}, and this is {metadata.version('proxops')}: "
            "give another output folder, or remove that one"
        )
    if known != identity:
        raise InputError(
            f"{path} is of a training with other settings, data or body: "
            "give another output folder, or remove that one"
        )
    return state
