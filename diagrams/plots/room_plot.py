"""Draws how much room runtime assurance takes around a keep-out ellipsoid."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure
from scipy.spatial import KDTree

from proxops.diagrams.plots.shared_axes import length_unit
from proxops.systems.common import directions_of

# Degrees between the points of the maps, and places from which each is interpolated.
_STEP, _NEIGHBOURS = 2.0, 6
_LEVELS = 20


def plot_room(found: Mapping[str, tuple[np.ndarray, np.ndarray]]) -> Figure:
    """Draws maps of the clearance that a spacecraft needs, one for each box of errors.

    Longitude and latitude are those of the place on the ellipsoid, seen from the centre of mass.
    All maps have one scale. A cross marks the place that needs most, and where nothing is enough
    the map is white.

    Args:
      found: by the title of a map, places (N, 3) of the ellipsoid in m in K and the clearances (N,)
        in m above them, as `BackupBraking.rooms` gives them.
    """
    most = max(float(needed[np.isfinite(needed)].max(initial=1.0)) for _, needed in found.values())
    length, unit = length_unit(max(float(np.abs(places).max()) for places, _ in found.values()))
    levels = np.linspace(0.0, most / length, _LEVELS + 1)
    figure = Figure(figsize=(1.0 + 3.6 * len(found), 3.0), layout="constrained")
    row = figure.subplots(1, len(found), sharey=True, squeeze=False)[0]
    filled = None
    for ax, (title, (places, needed)) in zip(row, found.items(), strict=True):
        longitude, latitude, values = _mapped(places, needed / length)
        filled = ax.contourf(longitude, latitude, values, levels, cmap="viridis")
        worst = places[int(needed.argmax())]
        ax.plot(*_angles(worst), "+", color="white", markersize=9)
        middle, greatest = np.median(needed) / length, needed.max() / length
        ax.set_title(f"{title}\nmedian {middle:.1f}, most {greatest:.1f} {unit}", fontsize="medium")
        ax.set_xticks([-180, -90, 0, 90, 180])
        ax.set_yticks([-90, -45, 0, 45, 90])
        ax.set_xlabel("longitude (°)")
    row[0].set_ylabel("latitude (°)")
    if filled is not None:
        figure.colorbar(filled, ax=list(row), label=f"clearance needed ({unit})", format="%.1f")
    return figure


def _mapped(places: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Longitudes (A,), latitudes (B,) in degrees and interpolated values (B, A) on their grid."""
    longitude = np.arange(-180.0, 180.0 + _STEP, _STEP)
    latitude = np.arange(-90.0, 90.0 + _STEP, _STEP)
    across, up = np.radians(np.meshgrid(longitude, latitude))
    directions = places / np.linalg.norm(places, axis=1)[:, None]
    grid, count = directions_of(across, up), min(_NEIGHBOURS, len(places))
    distance, nearest = KDTree(directions).query(grid, k=count)
    weights = 1.0 / (distance**2 + 1e-6)
    interpolated = np.sum(weights * values[nearest], axis=-1) / weights.sum(axis=-1)
    return longitude, latitude, np.where(np.isfinite(interpolated), interpolated, np.nan)


def _angles(place: np.ndarray) -> tuple[float, float]:
    """Longitude and latitude in degrees of a place (3,)."""
    x, y, z = place
    return float(np.degrees(np.arctan2(y, x))), float(np.degrees(np.arctan2(z, np.hypot(x, y))))
