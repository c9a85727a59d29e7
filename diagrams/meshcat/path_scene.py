"""Makes a page with the paths of several flights of one transit, in three dimensions.

The page is made with Drake's Meshcat and needs no network. On each path a ball moves at 160 times
real time.
"""

from __future__ import annotations

import html
from collections.abc import Mapping

import numpy as np
from pydrake.geometry import Rgba, Sphere

from proxops.diagrams.logs import FlightLog
from proxops.diagrams.meshcat.camera_views import look_at_flight
from proxops.diagrams.meshcat.meshcat_page import FRAMES_PER_SECOND, PLAYBACK_SPEED, page_with
from proxops.diagrams.meshcat.meshcat_scene import (
    Scene,
    add_goal,
    prepare_scene,
    quiet_meshcat,
    set_mesh,
)
from proxops.diagrams.meshcat.replay import tube

_BALL = 0.03  # Radius in Meshcat units.
# A path is cut off beyond this multiple of the first flight's greatest distance from the body,
# because a lost spacecraft flies on without end.
_FARTHEST = 1.5


def paths_page(logs: Mapping[str, FlightLog], colours: Mapping[str, str], title: str) -> str:
    """Makes the page, about 2 MB of HTML.

    Args:
      logs: the logs of one transit by the names to show; the first sets the scale.
      colours: the colour of each log as "#rrggbb", by the same names.
      title: title of the page.
    """
    first = next(iter(logs.values()))
    meshcat = quiet_meshcat()
    scene = Scene(meshcat, first.body)
    prepare_scene(scene)
    goal = first.dataset["target"].values[-1, :3]
    add_goal(scene, goal)
    reach = _FARTHEST * np.linalg.norm(first.dataset["state"].values[:, :3], axis=1).max()
    shown = {name: _positions(log, reach) for name, log in logs.items()}
    for k, (name, positions) in enumerate(shown.items()):
        colour = _rgba(colours[name])
        vertices, facets = tube(_apart(positions / scene.unit))
        set_mesh(meshcat, f"/path/{k:02d}", vertices, facets, colour)
        meshcat.SetObject(f"/ball/{k:02d}", Sphere(_BALL), colour)
        meshcat.SetTransform(f"/ball/{k:02d}", scene.pose(positions[-1]))
    look_at_flight(scene, np.vstack([*shown.values(), goal]))
    meshcat.StartRecording(FRAMES_PER_SECOND, set_visualizations_while_recording=False)
    for k, (name, positions) in enumerate(shown.items()):
        times = logs[name].dataset["time"].values[: len(positions)]
        for time, position in zip(times / PLAYBACK_SPEED, positions, strict=True):
            meshcat.SetTransform(f"/ball/{k:02d}", scene.pose(position), float(time))
    meshcat.PublishRecording()
    return page_with(meshcat, title, _legend(colours, shown, title))


def _positions(log: FlightLog, reach: float) -> np.ndarray:
    """Gives the positions (N, 3) in m until the path leaves a ball; there are at least two."""
    positions = log.dataset["state"].values[:, :3]
    outside = np.linalg.norm(positions, axis=1) > reach
    return positions[: max(2, int(np.argmax(outside)))] if outside.any() else positions


def _apart(points: np.ndarray) -> np.ndarray:
    """Drops each of the points (N, 3) that is too close to the one before to make a tube."""
    kept = [0]
    for row in range(1, len(points)):
        if np.linalg.norm(points[row] - points[kept[-1]]) > _BALL / 10.0:
            kept.append(row)
    return points[kept] if len(kept) > 1 else points[[0, -1]]


def _rgba(code: str) -> Rgba:
    red, green, blue = (int(code[k : k + 2], 16) / 255.0 for k in (1, 3, 5))
    return Rgba(red, green, blue)


def _legend(colours: Mapping[str, str], shown: Mapping[str, np.ndarray], title: str) -> str:
    spans = [
        f'<span style="color:{colours[name]}">&#9679;</span> {html.escape(name)}' for name in shown
    ]
    return (
        '<div style="position:fixed;left:14px;bottom:12px;pointer-events:none;'
        'font:14px/1.5 sans-serif;color:#c8ccd4"><b>'
        f"{html.escape(title)}</b>, {PLAYBACK_SPEED:.0f} times real time"
        f"<br>{' &nbsp; '.join(spans)}</div>\n"
    )
