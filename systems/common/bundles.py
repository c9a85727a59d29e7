"""Bundles of trained networks: one format, reader and writer for all that fly."""

from __future__ import annotations

import hashlib
import io
import json
import typing
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

import numpy as np

from proxops.systems.common.errors import InputError
from proxops.systems.common.files import whole_folder

if typing.TYPE_CHECKING:
    import onnxruntime as ort


@dataclass(frozen=True)
class BundleKind:
    """A kind of bundle: a folder with a network and a JSON file, the manifest, that describes it.

    The manifest holds the network's hash, so its own hash identifies the bundle.
    """

    noun: str
    """What the bundle holds, for messages: for instance "policy"."""
    file: str
    """Name of the manifest."""
    format: str
    """Value of the key `format` in it."""
    keys: dict[str, type]
    """Its other keys, besides those that every kind has, and the types of their values."""
    command: str
    """The command that makes such a bundle."""
    model: str = "model.onnx"
    """Name of the network's file."""

    def read(self, folder: Path) -> tuple[dict[str, typing.Any], str, bytes]:
        """Reads and checks a bundle.

        Returns:
          The content of its manifest, the manifest's SHA-256, and the content of the network's
          file.

        Raises:
          InputError: there is no bundle of this kind, it has another format, or it is damaged; the
            message says which.
        """
        try:
            text, model = ((folder / name).read_bytes() for name in (self.file, self.model))
        except OSError as error:
            raise InputError(
                f"{folder} is not the bundle of a {self.noun}: {Path(error.filename).name} cannot "
                f"be read ({error.strerror}); {self.command} makes one"
            ) from error
        try:
            content = json.loads(text)
        except (ValueError, RecursionError) as error:
            raise InputError(f"{folder / self.file} is damaged: it is not JSON") from error
        if not isinstance(content, dict) or content.get("format") != self.format:
            raise InputError(
                f"{folder / self.file} is not of the format {self.format!r}; train the {self.noun} "
                f"again with {self.command}"
            )
        for key, kind in (self.keys | {"model_sha256": str, "versions": dict}).items():
            if not isinstance(content.get(key), kind):
                raise InputError(f"{folder / self.file} is damaged: {key} is no {kind.__name__}")
        if hashlib.sha256(model).hexdigest() != content["model_sha256"]:
            raise InputError(
                f"{folder / self.model} is damaged or of another bundle: its hash is not the one "
                f"in {self.file}; train it again with {self.command}"
            )
        return content, hashlib.sha256(text).hexdigest(), model

    def write(
        self,
        folder: Path,
        content: dict[str, typing.Any],
        model: bytes,
        report: str | None = None,
    ) -> None:
        """Writes a bundle; an older one is replaced as a whole.

        Args:
          content: values of `keys`.
          model: content of the network's file.
          report: content of `report.md`, if there is to be one.

        Raises:
          InputError: the folder cannot be written.
        """
        origin = {
            "model_sha256": hashlib.sha256(model).hexdigest(),
            "versions": {
                name: metadata.version(name) for name in ("proxops", "torch", "onnx", "onnxruntime")
            },
        }
        told = {"format": self.format} | content | origin
        with whole_folder(folder) as part:
            (part / self.model).write_bytes(model)
            (part / self.file).write_text(json.dumps(told, indent=2, allow_nan=False) + "\n")
            if report is not None:
                (part / "report.md").write_text(report, encoding="utf-8")


def packed_arrays(arrays: typing.Mapping[str, np.ndarray]) -> bytes:
    """The content of an .npz file of arrays by their names, the same for the same numbers."""
    file = io.BytesIO()
    np.savez(file, allow_pickle=False, **arrays)
    return file.getvalue()


def unpacked_arrays(content: bytes, names: typing.Iterable[str]) -> dict[str, np.ndarray]:
    """Reads arrays that `packed_arrays` packed.

    Raises:
      InputError: it is no such content, or an array is missing.
    """
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as file:
            return {name: np.ascontiguousarray(file[name]) for name in names}
    except Exception as error:  # Those of a damaged archive have no common type.
        raise InputError(f"the network's file cannot be read: {error}") from error


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
