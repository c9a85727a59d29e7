"""Makes the replay of a flight: one HTML page with Drake's Meshcat, which needs no network.

A replay runs at 160 times real time, so a flight of 80 min takes 30 s. It has 16 frames a second,
one for each control step of 10 s. The survey of a mission runs faster. `meshcat_scene` draws its
objects, and `replay_panel` makes the panel below them.
"""

from __future__ import annotations

import typing
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import xarray as xr
from pydrake.geometry import Meshcat, Rgba

from proxops.diagrams.logs import FlightLog, flown_by, legend_of
from proxops.diagrams.meshcat.camera_views import light_from, look_at_flight, viewpoints
from proxops.diagrams.meshcat.meshcat_page import FRAMES_PER_SECOND, page_with
from proxops.diagrams.meshcat.meshcat_scene import (
    Scene,
    add_goal,
    add_returns,
    add_spacecraft,
    grid_facets,
    move_axes,
    move_moons,
    move_spacecraft,
    prepare_scene,
    quiet_meshcat,
    set_mesh,
)
from proxops.diagrams.meshcat.navigation_scene import (
    add_navigation,
    exaggeration,
    move_navigation,
    navigation_region,
    return_uses,
)
from proxops.diagrams.meshcat.replay_panel import panel
from proxops.diagrams.meshcat.rigid_scene import RigidView, record_flight
from proxops.diagrams.meshcat.site_scene import add_site, part_shown
from proxops.diagrams.meshcat.survey_chapter import (
    record_survey,
    shown_times,
    survey_rows,
    with_survey_rows,
)
from proxops.systems.common import Vectors3, write_whole

# Greatest number of lidar frames that a replay shows.
LIDAR_FRAMES = 40
# Greatest number of pieces of the path, not counting those that changes of colour add.
PATH_PIECES = 240

_ROUTE = Rgba(0.45, 0.45, 0.50)
_PATH_RADIUS = 0.007  # Meshcat units.
_SIDES = 6  # Of the tube that is the path.
_TINY = 1e-12  # It avoids a division by zero where a path reverses.


def write_replay(log: FlightLog, path: str | Path) -> None:
    """Writes the flight as one HTML page of about 4 MB that any browser shows without a network.

    Raises:
      InputError: the folder does not exist or cannot be written.
    """
    page = replay_page(log)
    write_whole(Path(path), lambda name: name.write_text(page, encoding="utf-8"))


def replay_page(log: FlightLog, addition: str = "") -> str:
    """Gives the page of `write_replay`, with more HTML after its panel."""
    meshcat, log = quiet_meshcat(), with_survey_rows(log)
    add_flight(meshcat, log)
    title = f"{log.body.config.name}, {log.dataset.attrs['controller']}"
    scene = Scene(meshcat, log.body, near=part_shown(log.scenario))
    below = panel(log, title, viewpoints(scene, _shown(log)), scene.unit)
    return page_with(meshcat, title, below + addition)


def add_flight(meshcat: Meshcat, log: FlightLog) -> None:
    """Adds the whole flight to a Meshcat, as an animation that starts to play by itself."""
    data = log.dataset
    times, positions = data["time"].values, data["state"].values[:, :3]
    goal = data["target"].values[-1, :3]
    # An earlier flight or the live view left them.
    for leftover in ("/path", "/lidar", "/plan", "/navigation", "/spacecraft", "/site", "/survey"):
        meshcat.Delete(leftover)
    scene = Scene(meshcat, log.body, log.differing_body, part_shown(log.scenario))
    prepare_scene(scene)
    add_goal(scene, goal)
    add_site(scene, log.scenario)
    rigid = RigidView(scene, log.scenario) if log.scenario.is_rigid else None
    legend = legend_of(data)
    colours = [legend[who].colour for who in flown_by(data).tolist()]
    pieces = add_path(scene, positions, colours)
    frames = _add_returns(scene, log, rigid) if "ranges" in data else []
    look_at_flight(scene, _shown(log))

    # A page that does not play shows the end of the flight.
    for name, _ in frames[:-1]:
        meshcat.SetProperty(name, "visible", False)
    meshcat.StartRecording(FRAMES_PER_SECOND, set_visualizations_while_recording=False)
    shown = shown_times(data)
    if rigid is None:
        _record_point(scene, log, shown)
    else:
        record_flight(rigid, data, shown)
    record_survey(scene, log, shown)
    for time, at in zip(times.tolist(), shown.tolist(), strict=True):
        move_axes(scene, time, at)
        move_moons(scene, time, at)
    if "sun_direction" in data:
        for direction, at in zip(data["sun_direction"].values, shown.tolist(), strict=True):
            if np.isfinite(direction).all():  # A survey does not log it.
                light_from(scene, direction, at)
    for name, row in pieces:
        meshcat.SetProperty(name, "visible", False, 0.0)
        meshcat.SetProperty(name, "visible", True, float(shown[row]))
    ends = [row for _, row in frames[1:]]
    for number, (name, row) in enumerate(frames):
        meshcat.SetProperty(name, "visible", shown[row] == 0.0, 0.0)
        meshcat.SetProperty(name, "visible", True, float(shown[row]))
        if number < len(ends):
            meshcat.SetProperty(name, "visible", False, float(shown[ends[number]]))
    if "navigation_state" in data:
        _record_navigation(scene, data, shown)
    meshcat.PublishRecording()


def _record_point(scene: Scene, log: FlightLog, shown: np.ndarray) -> None:
    """Adds a spacecraft that is a point, and records its motion at the times shown (N,) in s."""
    positions, forces = log.dataset["state"].values[:, :3], log.dataset["force"].values
    limit = log.scenario.spacecraft.thrust_limit_n
    add_spacecraft(scene)
    move_spacecraft(scene, positions[-1], np.zeros(3), limit)
    for row, time in enumerate(shown):
        force = np.nan_to_num(forces[row])
        move_spacecraft(scene, positions[row], force, limit, float(time))


def _record_navigation(scene: Scene, data: xr.Dataset, shown: np.ndarray) -> None:
    """Adds what the navigation believes, and records its motion at the times shown (N,) in s."""
    region, positions = navigation_region(data), data["state"].values[:, :3]
    times = exaggeration(region, scene.unit)
    add_navigation(scene)
    move_navigation(scene, positions[-1], region, len(shown) - 1, times)
    for row, time in enumerate(shown):
        move_navigation(scene, positions[row], region, row, times, float(time))


def add_path(
    scene: Scene, positions: Vectors3, colours: Sequence[tuple[float, float, float]]
) -> list[tuple[str, int]]:
    """Draws the whole path as a thin line, and the flown path as pieces of tube.

    Args:
      scene: the scene.
      positions: (N, 3) in m in K.
      colours: N colours, each of the path from one position to the next.

    Returns:
      For each piece its name, and the row at which the spacecraft reaches its end.
    """
    meshcat, points = scene.meshcat, positions / scene.unit
    if len(points) > 1:
        route: typing.Any = points.T  # The type stubs of Drake do not know array shapes.
        meshcat.SetLine("/path/route", route, 1.0, _ROUTE)
    # Rows that are too close together to make a tube are skipped, as while holding at the goal.
    rows = [0]
    for row in range(1, len(points)):
        if np.linalg.norm(points[row] - points[rows[-1]]) > _PATH_RADIUS / 4.0:
            rows.append(row)
    longest = -(-len(rows) // PATH_PIECES)
    pieces: list[tuple[str, int]] = []
    begin = 0
    for end in range(1, len(rows)):
        colour = colours[rows[begin]]
        last = end == len(rows) - 1
        if end - begin < longest and not last and colours[rows[end]] == colour:
            continue
        name = f"/path/piece_{len(pieces):03d}"
        points_of_tube, facets = tube(points[rows[begin : end + 1]])
        set_mesh(meshcat, name, points_of_tube, facets, Rgba(*colour))
        pieces.append((name, rows[end]))
        begin = end
    return pieces


def _shown(log: FlightLog) -> np.ndarray:
    """Gives the points (N, 3) in m in K that the camera should see."""
    data = log.dataset
    return np.vstack([data["state"].values[:, :3], data["target"].values[-1, :3]])


def _add_returns(scene: Scene, log: FlightLog, rigid: RigidView | None) -> list[tuple[str, int]]:
    """Adds evenly spaced lidar frames of a log; gives the name and row of each."""
    data, rays = log.dataset, log.scenario.lidar_geometry.directions
    ranges, positions = data["ranges"].values, data["state"].values[:, :3]
    uses = return_uses(data)
    frames = []
    first = survey_rows(data)
    for row in np.unique(np.linspace(first, len(ranges) - 1, LIDAR_FRAMES).astype(int)):
        name = f"/lidar/row_{row:04d}"
        if rigid is not None:
            rays = rigid.rays(data["attitude"].values[row])
        use = None if uses is None else uses[row]
        add_returns(scene, name, positions[row], ranges[row], rays, use)
        frames.append((name, int(row)))
    return frames


def tube(points: Vectors3) -> tuple[np.ndarray, np.ndarray]:
    """Makes a tube of six sides about a polyline.

    Args:
      points: (N, 3) in Meshcat units; successive points must differ.

    Returns:
      Vertices (7 N, 3) in Meshcat units, and facets (F, 3).
    """
    tangents = np.gradient(points, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True) + _TINY
    aside = np.eye(3)[np.argmin(np.abs(tangents.mean(axis=0)))]
    first = np.cross(tangents, aside)
    first /= np.linalg.norm(first, axis=1, keepdims=True) + _TINY
    second = np.cross(tangents, first)
    turn = np.linspace(0.0, 2.0 * np.pi, _SIDES + 1)[None, :, None]
    rings = points[:, None] + _PATH_RADIUS * (
        np.cos(turn) * first[:, None] + np.sin(turn) * second[:, None]
    )
    return rings.reshape(-1, 3), grid_facets(len(points), _SIDES + 1)
