"""A .npy file that is written in portions and read as a memory map."""

from __future__ import annotations

import hashlib
import os
import typing
from pathlib import Path

import numpy as np

from proxops.systems.common import InputError


class ColumnWriter:
    """Appends rows of one type and length to a .npy file, without holding them in memory."""

    def __init__(self, path: Path, dtype: str, width: int | None):
        """Begins the file.

        Args:
          dtype: numpy's name of the type, with the byte order.
          width: numbers in a row; None: rows are single numbers.
        """
        self._dtype, self._width, self._count = np.dtype(dtype), width, 0
        self._digest = hashlib.sha256()
        self._file = path.open("wb")
        self._header_size = self._write_header()

    def append(self, values: np.ndarray) -> None:
        """Rows (N,) or (N, width)."""
        data = np.ascontiguousarray(values, dtype=self._dtype).tobytes()
        self._file.write(data)
        self._digest.update(data)
        self._count += len(values)

    def close(self) -> dict[str, typing.Any]:
        """Completes the file; returns its description, which `open_column` takes."""
        with self._file:
            self._file.seek(0)
            # numpy leaves room in the header for the count to grow.
            if self._write_header() != self._header_size:
                raise AssertionError("the header of a .npy file has grown into its data")
            self._file.flush()
            os.fsync(self._file.fileno())
        return {
            "dtype": self._dtype.str,
            "shape": list(self._shape()),
            "sha256": self._digest.hexdigest(),
        }

    def abandon(self) -> None:
        """Closes the file without completing it."""
        self._file.close()

    def _shape(self) -> tuple[int, ...]:
        return (self._count,) if self._width is None else (self._count, self._width)

    def _write_header(self) -> int:
        header = {"descr": self._dtype.str, "fortran_order": False, "shape": self._shape()}
        np.lib.format.write_array_header_1_0(self._file, header)
        return self._file.tell()


def open_column(path: Path, described: dict[str, typing.Any], verify: bool) -> np.ndarray:
    """Opens a column as a read-only memory map.

    Args:
      described: the description that `ColumnWriter.close` returned.
      verify: reads all of it to check that no bit has changed.

    Raises:
      InputError: the file is missing, truncated or changed.
    """
    try:
        column = np.load(path, mmap_mode="r", allow_pickle=False)
    except Exception as error:  # A damaged file makes numpy raise errors of many types.
        raise InputError(f"{path} cannot be read: {error}") from error
    found = {"dtype": column.dtype.str, "shape": list(column.shape)}
    wanted = {name: described.get(name) for name in found}
    if found != wanted:
        raise InputError(f"{path} is damaged: it holds {found}, not {wanted}")
    # A plain array on the same memory: numpy is faster with it than with its own memmap class.
    plain = np.asarray(column)
    if verify and hashlib.sha256(plain.data).hexdigest() != described.get("sha256"):
        raise InputError(f"{path} is damaged: its contents do not match their hash")
    return plain
