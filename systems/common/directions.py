"""Directions: of a longitude and a latitude, and spread evenly about the sphere."""

from __future__ import annotations

import math

import numpy as np


def directions_of(longitude: np.ndarray | float, latitude: np.ndarray | float) -> np.ndarray:
    """Unit vectors (..., 3) of longitudes from x about z and of latitudes, (...) in radians."""
    across = np.cos(latitude)
    return np.stack(
        [across * np.cos(longitude), across * np.sin(longitude), np.sin(latitude)], axis=-1
    )


def spread_directions(count: int) -> np.ndarray:
    """Unit vectors (count, 3) along the Fibonacci spiral: each has an equal share of the sphere."""
    k = np.arange(count) + 0.5
    z, turn = 1.0 - 2.0 * k / count, math.pi * (1.0 + math.sqrt(5.0)) * k
    across = np.sqrt(1.0 - z**2)
    return np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=1)
