"""From where a scene is looked at: what shows a flight, near enough to fill the picture."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from proxops.diagrams.meshcat.meshcat_scene import FIELD_OF_VIEW, Scene
from proxops.diagrams.scenario import Body
from proxops.systems.shapes import blocks_segment

# Degrees.
_ELEVATION = 28.0
# Straight up leaves no direction for the top of the picture.
_ABOVE, _SIDE = 89.0, 3.0
# Of the picture's height and width, that much is filled; it is 4:3 or wider.
_FILLED, _ASPECT = 0.8, 4.0 / 3.0


class View(NamedTuple):
    """A camera."""

    eye: np.ndarray
    """Where it is (3,), in m in K."""
    target: np.ndarray
    """What it looks at (3,), in m in K."""


def viewpoints(body: Body, points: np.ndarray) -> dict[str, View]:
    """Views that body and `points` (N, 3), in m in K, fit into: by name, the best one first."""
    azimuth = _best_azimuth(body, points)
    everything = _everything(body, points)
    return {
        "overview": _view(everything, azimuth, _ELEVATION),
        "above": _view(everything, azimuth, _ABOVE),
        "side": _view(everything, azimuth, _SIDE),
    }


def look_at_flight(scene: Scene, points: np.ndarray) -> None:
    """Points camera and sun so that body and `points` (N, 3), in m in K, are in view and lit."""
    azimuth = _best_azimuth(scene.body, points)
    view = _view(_everything(scene.body, points), azimuth, _ELEVATION)
    scene.meshcat.SetCameraPose(view.eye / scene.unit, view.target / scene.unit)
    # From the side and above, so that relief is seen.
    sun = 10.0 * _towards(azimuth + 30.0, 38.0)
    scene.meshcat.SetProperty("/Lights/FillLight/<object>", "position", sun.tolist())


def _best_azimuth(body: Body, points: np.ndarray) -> float:
    """In degrees.

    Of a ring of directions it is the one from which the body hides fewest of the points, the points
    spread widest and most of them are on the near side.
    """
    half = body.shape.extents / 2.0
    everything = _everything(body, points)
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
        # Where the lidar's returns are: on the side that the spacecraft sees.
        before = (sample @ direction).mean() / radius
        return float(seen + spread + before)

    return float(max(np.arange(0.0, 360.0, 15.0), key=score))


def _view(everything: np.ndarray, azimuth: float, elevation: float) -> View:
    """From a direction, as near as fits points (N, 3) into the picture with a margin around it."""
    centre, direction = _middle(everything), _towards(azimuth, elevation)
    right = np.cross([0.0, 0.0, 1.0], direction)
    right /= np.linalg.norm(right)
    up = np.cross(direction, right)
    slope = _FILLED * np.tan(np.radians(FIELD_OF_VIEW / 2.0))
    offsets = everything - centre
    needed = np.maximum(np.abs(offsets @ up), np.abs(offsets @ right) / _ASPECT) / slope
    return View(centre + (needed + offsets @ direction).max() * direction, centre)


def _everything(body: Body, points: np.ndarray) -> np.ndarray:
    return np.vstack([points, body.shape.vertices])


def _middle(points: np.ndarray) -> np.ndarray:
    return (points.min(axis=0) + points.max(axis=0)) / 2.0


def _towards(azimuth: float, elevation: float) -> np.ndarray:
    """Unit vector (3,) in K; angles in degrees."""
    a, e = np.radians([azimuth, elevation])
    return np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
