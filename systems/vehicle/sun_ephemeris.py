"""Where the Sun is by SPICE kernels, with `spiceypy`, which the extra `spice` brings."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

import numpy as np

from proxops.systems.common import InputError, Vector3, needed

_KM_PER_AU = 149_597_870.7


class SunEphemeris:
    """Directions to the Sun from kernels, in a frame N whose axes are those of a frame at an epoch.

    SPICE keeps what is loaded for the whole process.
    """

    def __init__(self, kernels: str, body: str, epoch: str, frame: str):
        """Takes what SPICE needs.

        Args:
          kernels: path of a meta-kernel, or of one kernel that is enough: of leap seconds, of the
            Sun and of the body, and of the frame if SPICE does not know it by itself.
          body: the body by SPICE's name or number.
          epoch: of the start, as SPICE reads it, such as 2019-05-01T00:00:00.
          frame: its axes at the epoch are those of N: that of a body, or one of the stars'.

        Raises:
          InputError: there is no `spiceypy` or no file, or SPICE finds no answer in them.
        """
        self._spice, self._body = _loaded(kernels), body
        try:
            self._start = float(self._spice.str2et(epoch))
            self._turn = np.array(self._spice.pxform("J2000", frame, self._start))
        except self._spice.utils.exceptions.SpiceyError as error:
            raise InputError(f"sunlight.kernels: {_short(error)}") from error
        self.distance_au = float(np.linalg.norm(self._place(0.0)) / _KM_PER_AU)

    def direction(self, time: float) -> Vector3:
        """Unit vector (3,) from the body to the Sun in N, at a time in s after the epoch."""
        place = self._turn @ self._place(time)
        return place / np.linalg.norm(place)

    def _place(self, time: float) -> Vector3:
        """Of the Sun from the body, in km along J2000, without the time that light takes."""
        try:
            place, _ = self._spice.spkpos("SUN", self._start + time, "J2000", "NONE", self._body)
        except self._spice.utils.exceptions.SpiceyError as error:
            raise InputError(f"sunlight.kernels: {_short(error)}") from error
        return np.array(place)


@functools.lru_cache(maxsize=8)
def sun_ephemeris(kernels: str, body: str, epoch: str, frame: str) -> SunEphemeris:
    """A `SunEphemeris`, made once for the same arguments."""
    return SunEphemeris(kernels, body, epoch, frame)


@functools.lru_cache(maxsize=8)
def _loaded(kernels: str) -> Any:
    """SPICE with these kernels."""
    spice: Any = needed("spiceypy", "spice")
    if not Path(kernels).is_file():
        raise InputError(f"sunlight.kernels: there is no file {kernels}")
    try:
        spice.furnsh(kernels)
    except spice.utils.exceptions.SpiceyError as error:
        raise InputError(f"sunlight.kernels: {_short(error)}") from error
    return spice


def _short(error: Exception) -> str:
    """What SPICE complains about, in one line."""
    return str(getattr(error, "short", error)).strip() or str(error)
