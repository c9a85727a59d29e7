"""The loss of forces, for every network that learns the expert's commands."""

from __future__ import annotations

from torch import Tensor

# Errors of force over the thrust limit. Below the first, the loss is quadratic. Beyond the second,
# which a hybrid's gate refuses, a greater error costs little more: it mostly shows that the expert
# goes the other way around the body.
_SMALL_FORCE, _TAKEN_FORCE = 0.1 / 7.0, 0.8 / 7.0
# Weight of the error's length in the loss.
_LENGTH_SHARE = 1.4


def force_loss(force: Tensor, wanted: Tensor, thrust_limit: float) -> Tensor:
    """Mean loss of forces (N, 3): the length of their errors, and a square of it that saturates.

    The saturating square is that of S. Geman and D. E. McClure, Statistical methods for tomographic
    image reconstruction, Bulletin of the International Statistical Institute 52, 1987.
    """
    squared = ((force - wanted) / thrust_limit).square().sum(1)
    length = (squared + _SMALL_FORCE**2).sqrt()
    return (_LENGTH_SHARE * length + squared / (squared + _TAKEN_FORCE**2)).mean()
