"""Meshcat inline in a notebook: its live server where the browser reaches it, else a saved page.

Both have Meshcat's own panel at the top right: under *Animations* a slider for time, under *Scene*
a box to switch each layer on and off (body, keep_out, path, lidar, spacecraft, goal).

Needs IPython, which every notebook has: the extra `notebook`.
"""

from __future__ import annotations

import html
import tempfile
import time
from pathlib import Path

import numpy as np
from pydrake.geometry import Meshcat

from proxops.diagrams.logs import FlightLog
from proxops.diagrams.meshcat.camera_views import look_at_flight
from proxops.diagrams.meshcat.lidar_scene import add_planes, plane_edges
from proxops.diagrams.meshcat.meshcat_scene import (
    Scene,
    add_body,
    add_goal,
    add_keep_out,
    add_spacecraft,
    move_spacecraft,
    prepare_scene,
    quiet_meshcat,
)
from proxops.diagrams.meshcat.replay import add_flight, write_replay
from proxops.diagrams.scenario import Body

_HEIGHT = 480
# How long a browser may take to open the live page before the saved one takes its place, in s.
_PATIENCE = 2.0


def show_meshcat(meshcat: Meshcat, page: str | None = None, patience: float = _PATIENCE) -> None:
    """Displays a Meshcat under the cell.

    It shows the live server's page first. If no browser has connected to that within `patience`
    seconds (a remote kernel, an exported notebook, a run without a browser), a page that holds
    everything takes its place, and stays when the notebook is saved.

    Args:
      page: HTML to embed in that case; None: what the Meshcat shows now.
    """
    from IPython.display import (  # pyright: ignore[reportMissingImports]
        HTML,
        IFrame,
        display,
    )

    before = meshcat.GetNumActiveConnections()
    shown = display(IFrame(meshcat.web_url(), "100%", _HEIGHT), display_id=True)
    until = time.monotonic() + patience
    while time.monotonic() < until:
        if meshcat.GetNumActiveConnections() > before:
            return
        time.sleep(0.05)
    if shown is not None:  # None outside of a notebook.
        shown.update(HTML(embedded(page or meshcat.StaticHtml())))


def embedded(page: str) -> str:
    """HTML of a frame that holds a whole page, for where there is no address to load it from."""
    frame = f'width="100%" height="{_HEIGHT}" style="border:0" srcdoc="{html.escape(page)}"'
    return f"<div><iframe {frame}></iframe></div>"


def show_flight(log: FlightLog) -> Meshcat:
    """A flight, to be played again; live or as its replay page.

    Returns:
      The Meshcat: it serves the live page for as long as it is kept.
    """
    meshcat = quiet_meshcat()
    add_flight(meshcat, log)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "replay.html"
        write_replay(log, path)
        page = path.read_text(encoding="utf-8")
    show_meshcat(meshcat, page)
    return meshcat


def show_body(body: Body, positions: np.ndarray | None = None) -> Meshcat:
    """A body, its keep-out ellipsoid, and markers at positions (N, 3) in m in K.

    Returns:
      The Meshcat: it serves the live page for as long as it is kept.
    """
    scene = _scene(body)
    places = np.zeros((0, 3)) if positions is None else positions
    for number, position in enumerate(places, start=1):
        add_goal(scene, position, f"/markers/{number}")
    look_at_flight(scene, np.vstack([places, body.shape.vertices[:1]]))
    show_meshcat(scene.meshcat)
    return scene.meshcat


def show_lidar(
    body: Body, position: np.ndarray, ranges: np.ndarray, planes: tuple[int, ...] = (0, 1, 2)
) -> Meshcat:
    """Some of the lidar's planes at a position (3,) in m in K, as in the paper's first figure.

    Args:
      ranges: (planes, rays) in m, +inf where nothing returned.
      planes: numbers of those to show.

    Returns:
      The Meshcat: it serves the live page for as long as it is kept.
    """
    scene = _scene(body)
    add_spacecraft(scene)
    move_spacecraft(scene, position, np.zeros(3), 1.0)
    add_planes(scene, position, ranges, planes)
    edges = [plane_edges(position, ranges, plane) for plane in planes]
    look_at_flight(scene, np.concatenate([position[None], *edges]))
    show_meshcat(scene.meshcat)
    return scene.meshcat


def _scene(body: Body) -> Scene:
    scene = Scene(quiet_meshcat(), body)
    prepare_scene(scene)
    add_body(scene)
    add_keep_out(scene)
    return scene
