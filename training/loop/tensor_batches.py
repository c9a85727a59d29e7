"""Batches of examples that are tensors in memory; indexing them is faster than any loader."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import torch
from torch import Tensor

from proxops.systems.common import derived_seed


class TensorBatches:
    """Batches of N examples along the first axis of tensors; a batch is a tuple of tensors.

    With `shuffle` the order is a function of the seed and of `epoch`, and each epoch leaves out the
    examples that do not fill a batch.
    """

    def __init__(
        self,
        columns: Sequence[Tensor],
        size: int,
        *,
        shuffle: bool = False,
        seed: int = 0,
        often: Tensor | None = None,
    ):
        """Takes the tensors (N, ...), the size of a batch, and the seed of the order.

        Args:
          often: (K,) indices of examples that each epoch shows twice.
        """
        self.columns, self.epoch = tuple(columns), 0
        self._shuffle, self._seed = shuffle, seed
        everything = torch.arange(len(self.columns[0]))
        self._shown = everything if often is None else torch.cat([everything, often])
        self._size = min(size, len(self._shown))

    def __len__(self) -> int:
        """Number of batches."""
        whole, rest = divmod(len(self._shown), self._size)
        return whole + (rest > 0 and not self._shuffle)

    def __iter__(self) -> Iterator[tuple[Tensor, ...]]:
        """Gives the batches of the epoch."""
        shown = self._shown
        if self._shuffle:
            order = torch.Generator().manual_seed(derived_seed(self._seed, self.epoch))
            shown = shown[torch.randperm(len(shown), generator=order)]
        for batch in range(len(self)):
            chosen = shown[batch * self._size : (batch + 1) * self._size]
            yield tuple(column[chosen] for column in self.columns)
