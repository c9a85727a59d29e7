"""Paths of several flights of one transit in three dimensions, as one page for any browser.

Made with Drake's Meshcat like a replay, and needs no network either. What flies is a ball on each
path, all at 160 times real time.
"""

from __future__ import annotations

import html
from collections.abc import Mapping

import numpy as np
from pydrake.geometry import Rgba, Sphere

from proxops.diagrams.logs import FlightLog
from proxops.diagrams.meshcat.camera_views import look_at_flight
from proxops.diagrams.meshcat.meshcat_scene import (
    Scene,
    add_body,
    add_goal,
    add_keep_out,
    prepare_scene,
    quiet_meshcat,
    set_mesh,
)
from proxops.diagrams.meshcat.replay import FRAMES_PER_SECOND, PLAYBACK_SPEED, tube

_BALL = 0.03  # Radius in Meshcat units.
# Beyond this many times the MPC's farthest point a path is cut off: who is lost flies on for ever.
_FARTHEST = 1.5


def paths_page(logs: Mapping[str, FlightLog], colours: Mapping[str, str], title: str) -> str:
    """The page, HTML of some 2 MB.

    Args:
      logs: of one transit, by what each is called; the first is the one that sets the scale.
      colours: of each, as "#rrggbb".
    """
    first = next(iter(logs.values()))
    meshcat = quiet_meshcat()
    scene = Scene(meshcat, first.body)
    prepare_scene(scene)
    add_body(scene)
    add_keep_out(scene)
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
    page = meshcat.StaticHtml()
    page = page.replace("<title>Drake MeshCat</title>", f"<title>{html.escape(title)}</title>", 1)
    head, end_of_body, tail = page.rpartition("</body>")
    return head + _legend(colours, shown, title) + end_of_body + tail


def _positions(log: FlightLog, reach: float) -> np.ndarray:
    """Positions (N, 3) in m until the path leaves a ball, at least two of them."""
    positions = log.dataset["state"].values[:, :3]
    outside = np.linalg.norm(positions, axis=1) > reach
    return positions[: max(2, int(np.argmax(outside)))] if outside.any() else positions


def _apart(points: np.ndarray) -> np.ndarray:
    """Points (N, 3) without those that are too near the one before to make a tube."""
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
