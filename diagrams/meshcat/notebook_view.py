"""Shows Meshcat in a notebook: the live server's page if the browser reaches it, else a saved page.

Both pages have Meshcat's own panel at the top right. Under *Animations* it has a slider for time,
and under *Scene* a box to show or hide each layer (body, map, spin_axis, keep_out, path, lidar,
navigation, spacecraft, goal).

This module needs IPython, which the extra `notebook` installs.
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
    add_goal,
    add_spacecraft,
    move_spacecraft,
    prepare_scene,
    quiet_meshcat,
)
from proxops.diagrams.meshcat.replay import add_flight, write_replay
from proxops.diagrams.scenario import Body
from proxops.systems.common import Vector3, Vectors3

_HEIGHT = 480
# Time in s that a browser has to open the live page before the saved page replaces it.
_PATIENCE = 2.0


def show_meshcat(meshcat: Meshcat, page: str | None = None) -> None:
    """Displays a Meshcat under the cell.

    It first shows the live server's page. If no browser has connected to it within two seconds (a
    remote kernel, an exported notebook, a run without a browser), a self-contained page replaces
    it. This page is saved with the notebook.

    Args:
      meshcat: the Meshcat.
      page: HTML of the self-contained page; None: the present scene of the Meshcat.
    """
    from IPython.display import (  # pyright: ignore[reportMissingImports]
        HTML,
        IFrame,
        display,
    )

    before = meshcat.GetNumActiveConnections()
    shown = display(IFrame(meshcat.web_url(), "100%", _HEIGHT), display_id=True)
    until = time.monotonic() + _PATIENCE
    while time.monotonic() < until:
        if meshcat.GetNumActiveConnections() > before:
            return
        time.sleep(0.05)
    if shown is not None:  # It is None outside a notebook.
        shown.update(HTML(embedded(page or meshcat.StaticHtml())))


def embedded(page: str) -> str:
    """Gives the HTML of a frame that contains a whole page, so that it needs no address."""
    frame = f'width="100%" height="{_HEIGHT}" style="border:0" srcdoc="{html.escape(page)}"'
    return f"<div><iframe {frame}></iframe></div>"


def show_flight(log: FlightLog) -> Meshcat:
    """Shows the replay of a flight in a notebook.

    Returns:
      The Meshcat. It serves the live page until it is deleted.
    """
    meshcat = quiet_meshcat()
    add_flight(meshcat, log)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "replay.html"
        write_replay(log, path)
        page = path.read_text(encoding="utf-8")
    show_meshcat(meshcat, page)
    return meshcat


def show_body(body: Body, positions: Vectors3 | None = None) -> Meshcat:
    """Shows a body, its keep-out ellipsoid, and markers at positions (N, 3) in m in K.

    Returns:
      The Meshcat. It serves the live page until it is deleted.
    """
    scene = _scene(body)
    places = np.zeros((0, 3)) if positions is None else positions
    for number, position in enumerate(places, start=1):
        add_goal(scene, position, f"/markers/{number}")
    look_at_flight(scene, np.vstack([places, body.shape.vertices[:1]]))
    show_meshcat(scene.meshcat)
    return scene.meshcat


def show_lidar(
    body: Body, position: Vector3, ranges: np.ndarray, planes: tuple[int, ...] = (0, 1, 2)
) -> Meshcat:
    """Shows some of the lidar's planes, as the first figure of the paper does.

    Args:
      body: the body.
      position: position (3,) of the spacecraft in K, in m.
      ranges: (planes, rays) in m; +inf for a ray without a return.
      planes: numbers of the planes to show.

    Returns:
      The Meshcat. It serves the live page until it is deleted.
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
    return scene
