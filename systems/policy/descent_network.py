"""`DescentNetwork`: what a network adds to the law of a descent, and its bundle."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from proxops.systems.common import (
    BundleKind,
    InputError,
    Values,
    Vectors3,
    packed_arrays,
    unpacked_arrays,
)

DESCENT_INPUTS = 22
"""Of a row: see `proxops.systems.touch.descent_inputs`."""
DESCENT_BUNDLE = BundleKind(
    noun="descent",
    file="descent.json",
    format="proxops descent 1",
    keys={"recipe": str, "data_sha256": str, "metrics": dict, "kernel_difference": float},
    command="proxops train --recipe descent",
    model="weights.npz",
)  # fmt: skip


class DescentNetwork(NamedTuple):
    """Three layers on arsinh of the inputs, two of them followed by SiLU; arrays are float32."""

    weights_1: np.ndarray
    """(width, 22)"""
    biases_1: np.ndarray
    """(width,)"""
    weights_2: np.ndarray
    """(width, width)"""
    biases_2: np.ndarray
    """(width,)"""
    weights_3: np.ndarray
    """(3, width)"""
    biases_3: np.ndarray
    """(3,)"""

    def correction(self, given: Values) -> Vectors3:
        """What is added to the law (..., 3), for rows of inputs (..., 22)."""
        one = _silu(np.arcsinh(given) @ self.weights_1.T + self.biases_1)
        two = _silu(one @ self.weights_2.T + self.biases_2)
        return two @ self.weights_3.T + self.biases_3

    def to_bytes(self) -> bytes:
        """The content of an .npz file, the same for the same numbers."""
        return packed_arrays(self._asdict())

    @classmethod
    def from_bytes(cls, content: bytes) -> DescentNetwork:
        """Reads what `to_bytes` made.

        Raises:
          InputError: it is not such a file, or an array has another shape or is not finite.
        """
        network = cls(**unpacked_arrays(content, cls._fields))
        width = network.biases_1.size
        shapes = (width, DESCENT_INPUTS), (width,), (width, width), (width,), (3, width), (3,)
        for (name, array), shape in zip(network._asdict().items(), shapes, strict=True):
            if array.shape != shape or array.dtype != np.float32 or not np.isfinite(array).all():
                raise InputError(f"{name} is not finite float32 numbers of the shape {shape}")
        return network


def _silu(values: np.ndarray) -> np.ndarray:
    return values / (1.0 + np.exp(-values))


@dataclass(frozen=True)
class DescentBundle:
    """A descent's network that was read from its folder."""

    path: Path
    sha256: str
    """Hash of `descent.json`, which holds the network's hash. It identifies the bundle."""
    network: DescentNetwork = field(repr=False)

    @classmethod
    def load(cls, path: str | Path) -> DescentBundle:
        """Reads a bundle's folder.

        Raises:
          InputError: there is no bundle, it has another format, or it is damaged; the message says
            which.
        """
        folder = Path(path)
        _, sha256, weights = DESCENT_BUNDLE.read(folder)
        try:
            return cls(folder, sha256, DescentNetwork.from_bytes(weights))
        except InputError as error:
            raise InputError(f"{folder} is no descent: {error}") from error
