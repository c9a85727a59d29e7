"""From a torch module to a bundle's folder; all kinds of bundles use this."""

from __future__ import annotations

import glob
import hashlib
import json
import logging
import shutil
import tempfile
import typing
import warnings
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path

import numpy as np
import onnx
import torch
from torch import Tensor, nn

from proxops.systems.common import MODEL_FILE, InputError, make_folder, write_whole

# Greatest difference of an output between the exported network and torch, relative to the greatest
# magnitude of the output. It is not taken value by value: logits near 0 are differences of numbers
# around 100, and in single precision they are uncertain by some 4e-5. The pilot's fit of a position
# differed by 1.4e-5 on one processor, and by a tenth of that on another.
_TOLERANCE = 1e-4


def onnx_bytes(
    network: nn.Module,
    example: tuple[Tensor, ...],
    inputs: Sequence[str],
    outputs: Sequence[str],
    dynamic_shapes: tuple[dict, ...] | None = None,
) -> bytes:
    """Exports a network to an ONNX file; torch.onnx.export explains `dynamic_shapes`."""
    # These modules warn that torchvision is missing, which nothing here needs, and that a constant
    # that is also an output is not merged with equal ones.
    for name in (
        "torch.onnx._internal.exporter._registration",
        "onnx_ir.passes.common.initializer_deduplication",
    ):
        logging.getLogger(name).setLevel(logging.ERROR)
    with warnings.catch_warnings():
        # The exporter uses parts of torch that torch itself calls deprecated.
        warnings.simplefilter("ignore")
        program = torch.onnx.export(
            network.eval(),
            example,
            input_names=inputs,
            output_names=outputs,
            dynamic_shapes=dynamic_shapes,
            dynamo=True,
            verbose=False,
        )
    assert program is not None
    model = program.model_proto
    _tidy(model.graph)
    return model.SerializeToString()


def _tidy(graph: onnx.GraphProto) -> None:
    """Removes the places in the source of each node, which differ from run to run.

    It also gives grid_sample's linear mode the name that ONNX uses since opset 20. The exporter
    does so itself, except in the branches of conditions.
    """
    for item in (graph, *graph.node, *graph.value_info, *graph.input, *graph.output):
        del item.metadata_props[:]
    for node in graph.node:
        for attribute in node.attribute:
            if node.op_type == "GridSample" and attribute.s == b"bilinear":
                attribute.s = b"linear"
            if attribute.type == onnx.AttributeProto.GRAPH:
                _tidy(attribute.g)


def accepted_difference(wanted: np.ndarray, got: np.ndarray) -> float:
    """The greatest difference between outputs of torch and of what flies, relative to their size.

    NaN and infinities must be at the same places in both.

    Raises:
      InputError: it is above 1e-4.
    """
    finite = np.isfinite(wanted)
    difference = np.inf
    if np.array_equal(wanted[~finite], got[~finite], equal_nan=True):
        error = float(np.abs(wanted[finite] - got[finite]).max(initial=0.0))
        difference = error / float(np.abs(wanted[finite]).max(initial=0.0)) if error else 0.0
    if not difference <= _TOLERANCE:
        raise InputError(
            f"the exported network differs from the trained one by {difference:.1e} "
            f"(relative), more than {_TOLERANCE:g}: no bundle is written"
        )
    return difference


def describing(content: dict[str, typing.Any], model: bytes) -> str:
    """The text of a bundle's JSON file: content, hash of the model, and versions of libraries."""
    origin = {
        "model_sha256": hashlib.sha256(model).hexdigest(),
        "versions": {
            name: metadata.version(name) for name in ("proxops", "torch", "onnx", "onnxruntime")
        },
    }
    return json.dumps(content | origin, indent=2, allow_nan=False) + "\n"


def write_bundle_folder(folder: Path, model: bytes, texts: dict[str, str]) -> None:
    """Writes a bundle's model and text files: see `write_folder`."""
    files = {name: text.encode() for name, text in texts.items()}
    write_folder(folder, {MODEL_FILE: model, **files})


def write_folder(folder: Path, files: dict[str, bytes]) -> None:
    """Writes a folder of files by their names; an older folder is replaced.

    The folder appears under its name only when it is complete. What an earlier call left that was
    killed is removed; if it was killed between taking the older folder away and putting the new one
    in its place, the older one is put back first. No two processes may write one folder at once.

    Raises:
      InputError: the folder cannot be written.
    """
    make_folder(folder.parent)
    try:
        _tidy_up(folder)
        part = Path(tempfile.mkdtemp(dir=folder.parent, prefix=f".{folder.name}.", suffix=".part"))
        part.chmod(folder.parent.stat().st_mode & 0o777)
        try:
            for name, content in files.items():
                (part / name).write_bytes(content)
            older = part.with_suffix(".old")
            if folder.exists():
                folder.rename(older)
            part.rename(folder)
            shutil.rmtree(older, ignore_errors=True)
        finally:
            shutil.rmtree(part, ignore_errors=True)
    except OSError as error:
        raise InputError(f"cannot write {folder}: {error.strerror or error}") from error


def _tidy_up(folder: Path) -> None:
    """Removes what calls of `write_folder` left that were killed."""
    name = f".{glob.escape(folder.name)}.*"
    left = [path for end in (".old", ".part") for path in folder.parent.glob(name + end)]
    for path in left:
        if not path.is_dir():
            continue  # `write_whole` is writing a file whose name begins so.
        if path.suffix == ".old" and not folder.exists():
            path.rename(folder)
        else:
            shutil.rmtree(path)


def publish(folder: Path, out: Path, names: Sequence[str]) -> None:
    """Copies files of a training by their names, and its bundle; each appears only when complete.

    Args:
      folder: of the training. out: folder for the copies. names: of files in it.

    Raises:
      InputError: `out` cannot be written.
    """
    for name in names:
        content = (folder / name).read_bytes()
        write_whole(out / name, lambda path, content=content: path.write_bytes(content))
    files = {path.name: path.read_bytes() for path in sorted((folder / "bundle").iterdir())}
    write_folder(out / "bundle", files)
