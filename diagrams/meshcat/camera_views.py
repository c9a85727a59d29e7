"""Chooses camera positions that show a whole flight and fill the picture."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from proxops.diagrams.meshcat.meshcat_scene import FIELD_OF_VIEW, Scene
from proxops.systems.common import Vector3, Vectors3, directions_of
from proxops.systems.shapes import blocks_segment

# Elevation of the camera in degrees.
_ELEVATION = 28.0
# Elevations of two more views; at 90 degrees the top of the picture would be undefined.
_ABOVE, _SIDE = 89.0, 3.0
# Share of the picture's height and width that is filled, for a picture of 4:3 or wider.
_FILLED, _ASPECT = 0.8, 4.0 / 3.0


class View(NamedTuple):
    """A camera's position and its target."""

    eye: Vector3
    """Position (3,) of the camera, in m in K."""
    target: Vector3
    """The point (3,) at which it looks, in m in K."""


def viewpoints(scene: Scene, points: Vectors3) -> dict[str, View]:
    """Gives views that contain the body and `points` (N, 3), in m in K, by name, the best first.

    Those of a scene that shows a part of the body contain the points alone.
    """
    azimuth = _best_azimuth(scene, points)
    everything = _everything(scene, points)
    return {
        "overview": _view(everything, azimuth, _ELEVATION),
        "above": _view(everything, azimuth, _ABOVE),
        "side": _view(everything, azimuth, _SIDE),
    }


def look_at_flight(scene: Scene, points: Vectors3) -> None:
    """Sets camera and sun so that what `viewpoints` contain is visible and lit."""
    azimuth = _best_azimuth(scene, points)
    view = _view(_everything(scene, points), azimuth, _ELEVATION)
    scene.meshcat.SetCameraPose(view.eye / scene.unit, view.target / scene.unit)
    # The sun stands to the side and above, so that the relief is visible.
    light_from(scene, _towards(azimuth + 30.0, 38.0))


def light_from(scene: Scene, direction: Vector3, shown: float | None = None) -> None:
    """Places the sun in a direction (3,) in K, at a time of the recording in s; None: now."""
    place = (10.0 * direction).tolist()
    scene.meshcat.SetProperty("/Lights/FillLight/<object>", "position", place, shown)


def _best_azimuth(scene: Scene, points: np.ndarray) -> float:
    """Gives the best azimuth of the camera, in degrees.

    It tries a ring of directions. From the best one, the body hides few of the points, the points
    are spread widely, and most of them are on the near side.
    """
    half = scene.body.shape.extents / 2.0
    everything = _everything(scene, points)
    centre = _middle(everything)
    radius = float(np.linalg.norm(everything - centre, axis=1).max())
    sample = points[:: max(1, len(points) // 40)]

    def score(azimuth: float) -> float:
        direction = _towards(azimuth, _ELEVATION)
        eye = centre + 3.0 * radius * direction
        seen = np.mean([not blocks_segment(half, eye, point) for point in sample])
        across = sample - sample.mean(axis=0)
        across = across - np.outer(across @ direction, direction)
        spread = np.sqrt(np.mean(np.sum(across**2, axis=1))) / radius
        # The lidar's returns are on the side of the body that the spacecraft sees. The way down to
        # a place is seen from beside it.
        before = 0.0 if scene.near else (sample @ direction).mean() / radius
        return float(seen + spread + before)

    return float(max(np.arange(0.0, 360.0, 15.0), key=score))


def _view(everything: np.ndarray, azimuth: float, elevation: float) -> View:
    """Gives the closest view from a direction that contains the points (N, 3) with a margin."""
    centre, direction = _middle(everything), _towards(azimuth, elevation)
    right = np.cross([0.0, 0.0, 1.0], direction)
    right /= np.linalg.norm(right)
    up = np.cross(direction, right)
    slope = _FILLED * np.tan(np.radians(FIELD_OF_VIEW / 2.0))
    offsets = everything - centre
    needed = np.maximum(np.abs(offsets @ up), np.abs(offsets @ right) / _ASPECT) / slope
    return View(centre + (needed + offsets @ direction).max() * direction, centre)


def _everything(scene: Scene, points: np.ndarray) -> np.ndarray:
    return points if scene.near else np.vstack([points, scene.body.shape.vertices])


def _middle(points: np.ndarray) -> np.ndarray:
    return (points.min(axis=0) + points.max(axis=0)) / 2.0


def _towards(azimuth: float, elevation: float) -> np.ndarray:
    """Gives the unit vector (3,) in K of two angles in degrees."""
    return directions_of(*np.radians([azimuth, elevation]))
