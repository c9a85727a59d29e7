"""Shows Meshcat's scenes in a notebook: whole pages, which stay when the notebook is saved.

Each page has Meshcat's own panel at the top right. Under *Animations* it has a slider for time, and
under *Scene* a box to show or hide each layer (body, map, spin_axis, keep_out, path, lidar,
navigation, spacecraft, goal).

This module needs IPython, which the extra `notebook` installs.
"""

from __future__ import annotations

import html

import numpy as np

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
from proxops.diagrams.meshcat.replay import replay_page
from proxops.diagrams.scenario import Body
from proxops.systems.common import InputError, Vector3, Vectors3

_HEIGHT = 480


def show_page(page: str) -> None:
    """Displays a page of HTML under the cell; it is saved with the notebook.

    Raises:
      InputError: IPython is not installed.
    """
    try:
        from IPython.display import HTML, display  # pyright: ignore[reportMissingImports]
    except ModuleNotFoundError as error:
        raise InputError(
            "show_flight, show_body and show_lidar are for notebooks (make lab); elsewhere, "
            "write_replay writes a flight as a page"
        ) from error

    display(HTML(embedded(page)))


def embedded(page: str) -> str:
    """Gives the HTML of a frame that contains a whole page, so that it needs no address."""
    frame = f'width="100%" height="{_HEIGHT}" style="border:0" srcdoc="{html.escape(page)}"'
    return f"<div><iframe {frame}></iframe></div>"


def show_flight(log: FlightLog) -> None:
    """Shows the replay of a flight in a notebook."""
    show_page(replay_page(log))


def show_body(body: Body, positions: Vectors3 | None = None) -> None:
    """Shows a body, its keep-out ellipsoid, and markers at positions (N, 3) in m in K."""
    scene = _scene(body)
    places = np.zeros((0, 3)) if positions is None else positions
    for number, position in enumerate(places, start=1):
        add_goal(scene, position, f"/markers/{number}")
    look_at_flight(scene, np.vstack([places, body.shape.vertices[:1]]))
    show_page(scene.meshcat.StaticHtml())


def show_lidar(
    body: Body, position: Vector3, ranges: np.ndarray, planes: tuple[int, ...] = (0, 1, 2)
) -> None:
    """Shows some of the lidar's planes, as the first figure of the paper does.

    Args:
      body: the body.
      position: position (3,) of the spacecraft in K, in m.
      ranges: (planes, rays) in m; +inf for a ray without a return.
      planes: numbers of the planes to show.
    """
    scene = _scene(body)
    add_spacecraft(scene)
    move_spacecraft(scene, position, np.zeros(3), 1.0)
    add_planes(scene, position, ranges, planes)
    edges = [plane_edges(position, ranges, plane) for plane in planes]
    look_at_flight(scene, np.concatenate([position[None], *edges]))
    show_page(scene.meshcat.StaticHtml())


def _scene(body: Body) -> Scene:
    scene = Scene(quiet_meshcat(), body)
    prepare_scene(scene)
    return scene
