"""`GuidanceNetwork`: the numbers of a guidance for any body, and what it answers."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from proxops.systems.common import InputError, packed_arrays, unpacked_arrays
from proxops.systems.policy import _guidance_kernel as kernel
from proxops.systems.policy.surroundings import INPUTS

# Inputs of the first layer: those of the guidance, and what is computed from them.
_FEATURES = INPUTS + 37


class GuidanceNetwork(NamedTuple):
    """A law of least effort that a network corrects; all arrays are float32 of rows and columns.

    `proxops.training.networks.AnyBodyGuidance` explains and trains it. The network has three layers
    of one width, each followed by SiLU, and a last one for the six corrections.
    """

    weights_1: np.ndarray
    """(width, 60)"""
    biases_1: np.ndarray
    """(width,)"""
    weights_2: np.ndarray
    """(width, width)"""
    biases_2: np.ndarray
    """(width,)"""
    weights_3: np.ndarray
    """(width, width)"""
    biases_3: np.ndarray
    """(width,)"""
    weights_4: np.ndarray
    """(6, width)"""
    biases_4: np.ndarray
    """(6,)"""
    bends: np.ndarray
    """(9,) scales of the vector to the goal, twice, and of the velocity."""
    instead: np.ndarray
    """(23,) what the network sees instead of an input; NaN: the input itself."""
    law: np.ndarray
    """(2,) the law's acceleration and the square of its least time, both at a pace of 1."""

    def least_time(self, pace: float) -> float:
        """The least time of the law at a pace, in the unit of `Surroundings`."""
        return math.sqrt(self.law[1] / pace)

    def run(self, given: np.ndarray, longest: float = math.inf) -> np.ndarray:
        """The force (3,) over the thrust limit, without limits, for inputs (23,) float32.

        Args:
          given: see `Surroundings.inputs`.
          longest: the law's time is at most so long, in the unit of `Surroundings`.
        """
        force = np.empty(3)
        kernel.run(given, self, longest, force)
        return force

    def to_bytes(self) -> bytes:
        """The content of an .npz file, the same for the same numbers."""
        return packed_arrays(self._asdict())

    @classmethod
    def from_bytes(cls, content: bytes) -> GuidanceNetwork:
        """Reads what `to_bytes` made.

        Raises:
          InputError: it is not such a file, or an array has another shape or is not finite.
        """
        network = cls(**unpacked_arrays(content, cls._fields))
        network.check()
        return network

    def check(self) -> None:
        """Raises `InputError` if an array has another shape or type, or is not finite."""
        width = len(self.biases_1) if self.biases_1.ndim == 1 else 0
        square, last = (width, width), (6, width)
        shapes = (
            (width, _FEATURES), (width,), square, (width,), square, (width,), last, (6,),
            (9,), (INPUTS,), (2,),
        )  # fmt: skip
        for (name, array), shape in zip(self._asdict().items(), shapes, strict=True):
            if width == 0 or array.shape != shape or array.dtype != np.float32:
                raise InputError(f"{name} is {array.dtype} {array.shape}, not float32 {shape}")
            finite = np.isfinite(array) | (np.isnan(array) & (name == "instead"))
            if not finite.all():
                raise InputError(f"{name} has numbers that are not finite")
        if not (self.bends > 0.0).all() or not (self.law > 0.0).all():
            raise InputError("bends and law must be positive")
