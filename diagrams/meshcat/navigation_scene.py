"""Draws where the navigation believes the spacecraft to be, and how sure it is.

Errors of metres can't be seen beside a body of kilometres, so they are drawn many times as large:
the marker is off from the spacecraft by so many times the error, and the ellipsoid about it is as
many times three standard deviations. If the spacecraft is inside the ellipsoid, the navigation is
right about its own errors.
"""

from __future__ import annotations

import itertools
import typing
from typing import NamedTuple

import numpy as np
import xarray as xr
from pydrake.geometry import Rgba, Sphere
from pydrake.math import RigidTransform, RotationMatrix

from proxops.diagrams.logs import navigation_errors
from proxops.diagrams.meshcat.meshcat_scene import Scene, add_bars
from proxops.systems.common import LARGEST, Values, Vector3, Vectors3

NAVIGATION = Rgba(0.35, 0.95, 0.95)
_REGION = Rgba(0.35, 0.95, 0.95, 0.22)
_DEVIATIONS = 3.0
# Lengths in Meshcat units: about what the median of the ellipsoid's greatest semi-axis is drawn as;
# what no semi-axis is drawn longer than; and what none is drawn shorter than.
_USUAL, _LARGEST, _SMALLEST = 0.12, 0.4, 0.004
# The rotations that map the axes of a frame onto each other, as matrices (24, 3, 3).
_TURNS = np.array(
    [
        matrix
        for order in itertools.permutations(range(3))
        for signs in itertools.product((1.0, -1.0), repeat=3)
        if np.linalg.det(matrix := np.eye(3)[:, order] * signs) > 0.0
    ]
)


class Region(NamedTuple):
    """Where the navigation believes the spacecraft to be, in each of N rows; NaN: nowhere."""

    errors: Vectors3
    """(N, 3) believed less true position, in m in K."""
    semi_axes: Vectors3
    """(N, 3) of the ellipsoid of three standard deviations, in m."""
    axes: np.ndarray
    """(N, 3, 3): the columns are the directions of these, in K: a rotation."""

    @property
    def known(self) -> Values:
        """Tells (N,) in which rows there is a region."""
        return np.asarray(np.isfinite(self.semi_axes).all(axis=1))


def navigation_region(data: xr.Dataset) -> Region:
    """Gives what the navigation of a log believes of the position in each row."""
    errors, _ = navigation_errors(data)
    known = np.asarray(np.isfinite(errors).all(axis=1))
    blocks = np.where(known[:, None, None], data["navigation_covariance"].values[:, :3, :3], np.nan)
    return region_of(-errors[:, :3], blocks)


def return_uses(data: xr.Dataset) -> np.ndarray | None:
    """Gives the `ReturnUse` (N, planes, rays) of a log's returns; None if nothing judged them."""
    name = "navigation_return_use"
    known = name in data and data[name].shape == data["ranges"].shape
    return data[name].values if known else None


def region_of(errors: np.ndarray, covariances: np.ndarray) -> Region:
    """Gives the region of believed less true positions (N, 3), in m in K, from what is believed.

    The axes turn as little as they can from row to row, so that an animation does not spin them.

    Args:
      errors: believed less true positions. covariances: (N, 3, 3) of them, in m^2; NaN: none.
    """
    count = len(errors)
    region = Region(errors, np.full((count, 3), np.nan), np.tile(np.eye(3), (count, 1, 1)))
    known = np.isfinite(errors).all(axis=1) & (np.abs(covariances) < LARGEST).all(axis=(1, 2))
    last = np.eye(3)
    for row in np.flatnonzero(known):
        variances, vectors = np.linalg.eigh(0.5 * (covariances[row] + covariances[row].T))
        vectors[:, 2] *= np.linalg.det(vectors)
        turns = vectors @ _TURNS
        turn = int(np.argmax(np.einsum("kij,ij->k", turns, last)))
        last = turns[turn]
        lengths = np.sqrt(np.maximum(variances, 0.0))
        region.axes[row] = last
        region.semi_axes[row] = _DEVIATIONS * np.abs(_TURNS[turn].T @ lengths)
    return region


def exaggeration(region: Region, unit: float) -> float:
    """Gives how many times too large errors are drawn: a number with one digit.

    Args:
      region: what is drawn.
      unit: length of a Meshcat unit in m.
    """
    largest = region.semi_axes[region.known].max(axis=1, initial=0.0)
    usual = float(np.median(largest)) if largest.size else 0.0
    return float(f"{max(1.0, _USUAL * unit / max(usual, 1e-6 * unit)):.0e}")


def add_navigation(scene: Scene) -> None:
    """Adds the marker and the ellipsoid; see `move_navigation`."""
    scene.meshcat.SetObject("/navigation/region/ball", Sphere(1.0), _REGION)
    add_bars(scene, "/navigation/marker", 0.005, 0.06, NAVIGATION)


def move_navigation(
    scene: Scene,
    position: Vector3,
    region: Region,
    row: int,
    times: float,
    time_in_recording: float | None = None,
) -> None:
    """Moves the marker and the ellipsoid to where they are in a row, or hides them.

    Where the ellipsoid would be larger than 0.4 units, it and the marker's distance from the
    spacecraft are drawn smaller by the same factor.

    Args:
      scene: the scene.
      position: (3,) true position of the spacecraft in K, in m.
      region: what is drawn. row: of it.
      times: how many times too large errors are drawn.
      time_in_recording: time in s in the animation; None: now.
    """
    meshcat = scene.meshcat
    shown = bool(region.known[row])
    meshcat.SetProperty("/navigation", "visible", shown, time_in_recording)
    if not shown:
        return
    semi_axes = region.semi_axes[row] * times / scene.unit
    factor = min(1.0, _LARGEST / max(float(semi_axes.max()), 1e-12))
    place = position + factor * times * region.errors[row]
    meshcat.SetTransform("/navigation/marker", scene.pose(place), time_in_recording)
    # A recording holds transforms without a scale, and the scale as a property.
    turn: typing.Any = RotationMatrix(region.axes[row])
    pose = RigidTransform(turn, scene.pose(place).translation())
    meshcat.SetTransform("/navigation/region", pose, time_in_recording)
    scale = np.maximum(factor * semi_axes, _SMALLEST).tolist()
    meshcat.SetProperty("/navigation/region/ball", "scale", scale, time_in_recording)
