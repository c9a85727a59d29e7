"""From a torch module to an ONNX file, and how far that differs."""

from __future__ import annotations

import logging
import shutil
import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import onnx
import torch
from torch import Tensor, nn

from proxops.systems.common import InputError, whole_folder, write_whole

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
    with whole_folder(out / "bundle") as part:
        shutil.copytree(folder / "bundle", part, dirs_exist_ok=True)
