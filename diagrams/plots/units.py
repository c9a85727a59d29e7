"""The unit in which a plot shows lengths."""

from __future__ import annotations


def length_unit(size: float) -> tuple[float, str]:
    """Gives the unit for lengths up to about `size` (m), in m and by name: km from 5 km up."""
    return (1e3, "km") if size >= 5e3 else (1.0, "m")
