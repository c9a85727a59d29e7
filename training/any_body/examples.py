"""Examples for the guidance: what it is given at the expert's states, and the expert's force."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from proxops.systems.policy import INPUTS, Surroundings
from proxops.training.data import Labels

# Vectors of a row of inputs: state, goal, and both natural accelerations.
_VECTORS = 5


class Examples(NamedTuple):
    """Rows of inputs and the expert's forces there."""

    given: Tensor
    """(N, 23): `Surroundings.inputs`."""
    force: Tensor
    """(N, 3) over the thrust limit, in K."""


def examples_of(labels: Labels, members: Sequence[Surroundings], mass: Sequence[float]) -> Examples:
    """The examples of labels that say which member of the family they are of.

    Args:
      labels: with the column `member` (N,), an index.
      members: surroundings of each member. mass: of each member's spacecraft in kg.
    """
    count = len(labels["member"])
    given = np.empty((count, INPUTS), dtype=np.float32)
    force = np.empty((count, 3), dtype=np.float32)
    for k, around in enumerate(members):
        rows = np.flatnonzero(labels["member"] == k)
        given[rows] = around.inputs(labels["state"][rows], labels["goal"][rows])
        force[rows] = labels["force"][rows] / (mass[k] * around.acceleration)
    return Examples(torch.from_numpy(given), torch.from_numpy(force))


def mirrored(given: Tensor, force: Tensor, signs: Tensor) -> tuple[Tensor, Tensor]:
    """The same examples at bodies that are mirrored or turned, where the expert flies likewise.

    A body mirrored in its equator spins as before, and so does one that is turned by half a turn
    about its axis: it is at another time.

    Args:
      given, force: (B, 23) and (B, 3).
      signs: (B, 3) of 1 and -1, of the axes; those of x and y are equal.
    """
    vectors = given[:, : 3 * _VECTORS].unflatten(1, (_VECTORS, 3)) * signs[:, None]
    rest = given[:, 3 * _VECTORS :]
    return torch.cat([vectors.flatten(1), rest], dim=1), force * signs
