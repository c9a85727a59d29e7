"""Bundles of trained networks: a folder with an ONNX model and a JSON file that describes it."""

from __future__ import annotations

import hashlib
import json
import typing
from dataclasses import dataclass
from pathlib import Path

from proxops.systems.common.errors import InputError

if typing.TYPE_CHECKING:
    import onnxruntime as ort

MODEL_FILE = "model.onnx"


@dataclass(frozen=True)
class BundleKind:
    """What a bundle of one kind must contain."""

    noun: str
    """What the bundle holds, for messages: for instance "policy"."""
    file: str
    """Name of the JSON file."""
    format: str
    """Value of the key `format` in that file."""
    keys: dict[str, type]
    """The file's keys, `model_sha256` among them, and the types of their values."""
    command: str
    """The command that makes such a bundle."""
    model: str = MODEL_FILE
    """Name of the network's file."""


def read_bundle(folder: Path, kind: BundleKind) -> tuple[dict[str, typing.Any], str, bytes]:
    """Reads and checks a bundle.

    Returns:
      The content of its JSON file, that file's SHA-256, and the content of the network's file. The
      JSON file holds the network's hash, so its own hash identifies the bundle.

    Raises:
      InputError: there is no bundle of this kind, it has another format, or it is damaged; the
        message says which.
    """
    text = _read(folder / kind.file, folder, kind)
    model = _read(folder / kind.model, folder, kind)
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{folder / kind.file} is damaged: it is not JSON") from error
    if not isinstance(content, dict) or content.get("format") != kind.format:
        raise InputError(
            f"{folder / kind.file} is not of the format {kind.format!r}; train the {kind.noun} "
            f"again with {kind.command}"
        )
    for key, kind_of_value in kind.keys.items():
        if not isinstance(content.get(key), kind_of_value):
            raise InputError(
                f"{folder / kind.file} is damaged: {key} is no {kind_of_value.__name__}"
            )
    if hashlib.sha256(model).hexdigest() != content["model_sha256"]:
        raise InputError(
            f"{folder / kind.model} is damaged or of another bundle: its hash is not the one "
            f"in {kind.file}; train it again with {kind.command}"
        )
    return content, hashlib.sha256(text).hexdigest(), model


def open_session(model: bytes) -> ort.InferenceSession:
    """The network of an ONNX file. It runs on one thread, so that results repeat bit for bit.

    Raises:
      InputError: ONNX Runtime refuses the file.
    """
    import onnxruntime as ort  # It is slow to import, so only when it is needed.

    options = ort.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 4  # What goes wrong is in the exception.
    # ONNX calls a file that holds weights their "location". Such a network could read any file.
    if b"location" in model:
        raise InputError("the network takes weights from other files; all must be in model.onnx")
    try:
        return ort.InferenceSession(model, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # ONNX Runtime's exceptions have no common type.
        raise InputError(
            f"the network is not one that ONNX Runtime takes: {str(error).partition(chr(10))[0]}"
        ) from error


def _read(path: Path, folder: Path, kind: BundleKind) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(
            f"{folder} is not the bundle of a {kind.noun}: {path.name} cannot be read "
            f"({error.strerror}); {kind.command} makes one"
        ) from error
