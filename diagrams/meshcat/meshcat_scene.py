"""Draws the objects of a flight in Drake's Meshcat; replay and live view use these functions.

The scene is in the body-fixed frame K. The length of a Meshcat unit depends on the body, so that
a body of any size fills the picture. Spacecraft, goal, arrows and points have fixed sizes in units.
At Kleopatra a unit is 100 km, and the spacecraft is drawn about a thousand times too large.
"""

from __future__ import annotations

import logging
import typing
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from pydrake.geometry import Box, Meshcat, MeshcatParams, Rgba, Sphere
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.perception import PointCloud
from scipy.spatial.transform import Rotation

from proxops.diagrams.scenario import Body, TrueBody, spin_axes
from proxops.systems.common import Vector3, Vectors3, directions_of
from proxops.systems.gravity import moon_axes, moon_position
from proxops.systems.navigation import ReturnUse
from proxops.systems.rotation import TorqueFreeSpin

_BODY = Rgba(0.62, 0.57, 0.51)
_KEEP_OUT = Rgba(0.35, 0.55, 0.95, 0.12)
# Meshcat ignores the alpha of lines, so these lines are dark instead of translucent.
_GRATICULE = Rgba(0.16, 0.23, 0.40)
GOAL = Rgba(0.30, 1.00, 0.45)
HULL = Rgba(0.92, 0.92, 0.95)
_PANELS = Rgba(0.20, 0.32, 0.75)
THRUST = Rgba(1.00, 0.85, 0.20)
RETURNS = Rgba(1.00, 0.10, 0.30)
# Where a navigation judges the returns: what it makes of them.
RETURN_USES = {
    ReturnUse.USED: Rgba(0.40, 0.95, 0.00),
    ReturnUse.REJECTED: RETURNS,
    ReturnUse.NOT_USED: Rgba(0.70, 0.55, 0.95),
}
_PLAN = Rgba(0.55, 0.85, 1.00)
MAP = Rgba(0.45, 0.80, 0.95)
TRUE_AXIS = Rgba(1.00, 0.35, 0.70)
BELIEVED_AXIS = Rgba(0.90, 0.95, 1.00)
# Lengths in Meshcat units.
_ARROW_LENGTH = 0.40
_POINT_SIZE, _REJECTED_SIZE = 0.022, 0.04
# How much farther away the true surface is drawn where the map is drawn over it, in steps of the
# depth buffer.
_BEHIND = 2000.0

FIELD_OF_VIEW = 40.0
"""Vertical field of view of the camera, in degrees."""

SPACECRAFT_SIZE = 0.145
"""Greatest extent of the spacecraft in Meshcat units."""


@dataclass(frozen=True)
class Scene:
    """A Meshcat and the body that it shows."""

    meshcat: Meshcat
    body: Body
    """The body as believed."""
    true_body: TrueBody | None = None
    """The body as it is; None: as believed."""
    near: float | None = None
    """How large the part of the body is that is shown, in m; None: all of it."""

    @cached_property
    def unit(self) -> float:
        """Metres per Meshcat unit: half of what is shown, rounded to one digit."""
        return float(f"{(self.near or self.body.shape.extents.max()) / 2.0:.0e}")

    def pose(self, position: Vector3) -> RigidTransform:
        """Gives the pose, in Meshcat units, at a position (3,) in m."""
        scaled: typing.Any = position / self.unit
        return RigidTransform(scaled)


def quiet_meshcat() -> Meshcat:
    """Makes a Meshcat for pages: it listens on a free port and prints no message about it."""
    logger = logging.getLogger("drake")
    level = logger.level
    logger.setLevel(logging.WARNING)
    try:
        # Port 0 lets the system choose, so that any number of processes can do this at once.
        return Meshcat(MeshcatParams(host="localhost", port=0))
    finally:
        logger.setLevel(level)


def prepare_scene(scene: Scene) -> None:
    """Sets background, lights and camera, and adds the body and its keep-out ellipsoid."""
    _light_scene(scene)
    add_body(scene)
    add_moons(scene)
    add_keep_out(scene)


def _light_scene(scene: Scene) -> None:
    """Sets background, lights and camera: dark, without grid or axes, and with one sun.

    `look_at_flight` sets the place of the sun.
    """
    meshcat = scene.meshcat
    meshcat.SetProperty("/Grid", "visible", False)
    meshcat.SetProperty("/Axes", "visible", False)
    meshcat.SetProperty("/Background/<object>", "top_color", [0.015, 0.018, 0.035])
    meshcat.SetProperty("/Background/<object>", "bottom_color", [0.03, 0.035, 0.06])
    for light in ("SpotLight", "PointLightNegativeX", "PointLightPositiveX"):
        meshcat.SetProperty(f"/Lights/{light}", "visible", False)
    meshcat.SetProperty("/Lights/AmbientLight/<object>", "intensity", 0.5)
    meshcat.SetProperty("/Lights/FillLight/<object>", "intensity", 3.2)
    meshcat.SetCamera(
        Meshcat.PerspectiveCamera(fov=FIELD_OF_VIEW, aspect=1.0, near=0.01, far=200.0)
    )


def add_body(scene: Scene) -> None:
    """Adds the true body with smooth shading and, where it differs, what is believed of it.

    The map is then drawn over the true body, as a net of its edges, and so are the true and the
    believed spin axes.
    """
    meshcat, unit = scene.meshcat, scene.unit
    for leftover in ("/body", "/map", "/spin_axis", "/moon"):  # Of an earlier flight.
        meshcat.Delete(leftover)
    believed = scene.body.shape
    shape = believed if scene.true_body is None else scene.true_body.shape
    set_mesh(meshcat, "/body", shape.vertices / unit, shape.facets, _BODY)
    if shape is not believed:
        # Lines, because they are not shaded as a wireframe of facets is.
        ends: typing.Any = believed.vertices[believed.edges[0]] / unit
        meshcat.SetLineSegments("/map", ends[:, 0].T, ends[:, 1].T, 1.0, MAP)
        # The true surface is drawn as if it were farther away, so that a net just below it is seen.
        meshcat.SetProperty("/body/<object>", "material.polygonOffset", True)
        meshcat.SetProperty("/body/<object>", "material.polygonOffsetUnits", _BEHIND)
    axes = scene.true_body and spin_axes(scene.body, scene.true_body)
    if axes:
        for name, line, colour in zip(
            ("believed", "true"), axes, (BELIEVED_AXIS, TRUE_AXIS), strict=True
        ):
            points: typing.Any = line.T / unit
            meshcat.SetLine(f"/spin_axis/{name}", points, 2.0, colour)


def move_axes(scene: Scene, time: float, shown: float | None = None) -> None:
    """Turns the spin axes of a body that tumbles to where they are at a time in s of the flight.

    `shown` is the time of the recording in s; None: now.
    """
    if scene.true_body is None:
        return
    bodies = (("believed", scene.body.spin, np.zeros(3)),
              ("true", scene.true_body.spin, scene.true_body.axis_point))  # fmt: skip
    for name, spin, centre in bodies:
        if isinstance(spin, TorqueFreeSpin):
            way = Rotation.align_vectors(spin.angular_velocity(time), spin.rate)[0].as_matrix()
            moved: typing.Any = (centre - way @ centre) / scene.unit
            pose = RigidTransform(RotationMatrix(way), moved)
            scene.meshcat.SetTransform(f"/spin_axis/{name}", pose, shown)


def add_moons(scene: Scene) -> None:
    """Adds the moons of the body: their meshes, or balls that are large enough to be seen."""
    shapes = scene.body.moon_shapes or (None,) * len(scene.body.config.moons)
    for number, (moon, shape) in enumerate(zip(scene.body.config.moons, shapes, strict=True)):
        if shape is not None:
            points = shape.vertices / scene.unit
            set_mesh(scene.meshcat, f"/moon/{number}", points, shape.facets, _BODY)
            continue
        radius = max(moon.radius_m / scene.unit, _POINT_SIZE)
        scene.meshcat.SetObject(f"/moon/{number}", Sphere(radius), _BODY)


def move_moons(scene: Scene, time: float, shown: float | None = None) -> None:
    """Moves the moons to where they are at a time in s of the flight.

    `shown` is the time of the recording in s; None: now.
    """
    spin = (scene.true_body or scene.body).spin
    for number, moon in enumerate(scene.body.config.moons):
        turn: typing.Any = moon_axes(moon, time, spin)
        place: typing.Any = moon_position(moon, time, spin) / scene.unit
        pose = RigidTransform(RotationMatrix(turn), place)
        scene.meshcat.SetTransform(f"/moon/{number}", pose, shown)


def add_keep_out(scene: Scene) -> None:
    """Adds the translucent keep-out ellipsoid, with meridians and parallels every 15 degrees."""
    meshcat = scene.meshcat
    axes = scene.body.keep_out_semi_axes / scene.unit
    turns, rises = np.linspace(0.0, 2.0 * np.pi, 97), np.linspace(-np.pi / 2.0, np.pi / 2.0, 49)
    turn, rise = np.meshgrid(turns, rises)
    points = axes * directions_of(turn, rise)
    facets = grid_facets(*turn.shape)
    # Only facets that face the viewer are drawn; otherwise the far side shows through in patches.
    side = Meshcat.SideOfFaceToRender.kFrontSide
    set_mesh(meshcat, "/keep_out/surface", points.reshape(-1, 3), facets, _KEEP_OUT, side)
    meridians, parallels = points[:, ::4], points[4:-4:4]
    start = [meridians[:-1].reshape(-1, 3), parallels[:, :-1].reshape(-1, 3)]
    end = [meridians[1:].reshape(-1, 3), parallels[:, 1:].reshape(-1, 3)]
    starts: typing.Any = np.concatenate(start).T
    ends: typing.Any = np.concatenate(end).T
    meshcat.SetLineSegments("/keep_out/graticule", starts, ends, 1.0, _GRATICULE)


def add_goal(scene: Scene, position: Vector3, name: str = "/goal") -> None:
    """Adds a marker at a position (3,) in m in K: a ball with three long thin bars through it."""
    meshcat = scene.meshcat
    meshcat.SetObject(f"{name}/ball", Sphere(0.022), GOAL)
    add_bars(scene, name, 0.004, 0.16, GOAL)
    meshcat.SetTransform(name, scene.pose(position))


def add_bars(scene: Scene, name: str, width: float, length: float, colour: Rgba) -> None:
    """Adds three crossed bars along the axes, of a width and a length in Meshcat units."""
    for axis in range(3):
        edges = np.full(3, width)
        edges[axis] = length
        scene.meshcat.SetObject(f"{name}/bar_{axis}", Box(*edges), colour)


def add_spacecraft(scene: Scene) -> None:
    """Adds a hull with two panels and an arrow of thrust along each axis; see `move_spacecraft`."""
    meshcat = scene.meshcat
    meshcat.SetObject("/spacecraft/hull", Box(0.030, 0.030, 0.030), HULL)
    for side in (-1.0, 1.0):
        name = f"/spacecraft/panel_{'left' if side < 0 else 'right'}"
        meshcat.SetObject(name, Box(0.022, 0.055, 0.003), _PANELS)
        beside: typing.Any = [0.0, side * 0.045, 0.0]
        meshcat.SetTransform(name, RigidTransform(beside))
    # The arrow along x is a surface of revolution; cyclic permutation gives the other two.
    along = _ARROW_LENGTH * np.array([0.0, 0.0, 0.72, 0.72, 1.0])
    points, facets = revolved(along, np.array([0.0, 0.005, 0.005, 0.016, 0.0]))
    for axis, letter in enumerate("xyz"):
        rolled = np.roll(points, axis, axis=1)
        set_mesh(meshcat, f"/spacecraft/thrust_{letter}", rolled, facets, THRUST)


def revolved(along: np.ndarray, out: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Turns a line about x: points (13 N, 3) and facets (F, 3) of the surface.

    Args:
      along: (N,) along x. out: (N,) distances from x.
    """
    turn = np.linspace(0.0, 2.0 * np.pi, 13)
    rings = along[:, None], np.outer(out, np.cos(turn)), np.outer(out, np.sin(turn))
    points = np.stack(np.broadcast_arrays(*rings), axis=-1).reshape(-1, 3)
    return points, grid_facets(len(along), len(turn))


def move_spacecraft(
    scene: Scene,
    position: Vector3,
    force: Vector3,
    thrust_limit: float,
    time_in_recording: float | None = None,
) -> None:
    """Moves the spacecraft, and sets its arrows to a force.

    Each arrow points in the direction of its component of the force. At `thrust_limit` it is 0.4
    units long. Its length is proportional to the square root of the component, so that small forces
    are visible too.

    Args:
      scene: the scene.
      position: (3,) in K, in m.
      force: (3,) in N; it is drawn along the axes of K.
      thrust_limit: greatest force per axis in N.
      time_in_recording: time in s in the animation; None: now.
    """
    meshcat = scene.meshcat
    meshcat.SetTransform("/spacecraft", scene.pose(position), time_in_recording)
    for letter, share in zip("xyz", force / thrust_limit, strict=True):
        # A negative scale reverses the arrow without a rotation in the animation. A scale of zero
        # would leave the surface without normals.
        scale = float(np.sign(share) * np.sqrt(abs(share))) if abs(share) > 1e-4 else 0.01
        name = f"/spacecraft/thrust_{letter}"
        meshcat.SetProperty(name, "scale", [scale] * 3, time_in_recording)


def add_returns(
    scene: Scene,
    name: str,
    position: Vector3,
    ranges: np.ndarray,
    directions: np.ndarray,
    use: np.ndarray | None = None,
) -> None:
    """Adds the returns of a lidar frame as points.

    Args:
      scene: the scene.
      name: path of the points in the Meshcat.
      position: position (3,) of the spacecraft in K, in m.
      ranges: (planes, rays) in m; +inf for a ray without a return.
      directions: (planes * rays, 3) of the rays in K.
      use: (planes, rays) `ReturnUse`, which gives their colours; None: all have the same.
    """
    flat = ranges.reshape(-1)
    hit = np.isfinite(flat)
    places = position + flat[hit, None] * directions[hit]
    if use is None:
        add_points(scene, name, places, RETURNS, _POINT_SIZE)
        return
    for kind, colour in RETURN_USES.items():
        chosen = use.reshape(-1)[hit] == kind
        size = _REJECTED_SIZE if kind == ReturnUse.REJECTED else _POINT_SIZE
        add_points(scene, f"{name}/{kind.name.lower()}", places[chosen], colour, size)


def add_points(scene: Scene, name: str, places: np.ndarray, colour: Rgba, size: float) -> None:
    """Adds points at places (N, 3) in m in K."""
    cloud = PointCloud(len(places))
    cloud.mutable_xyzs()[:] = (places / scene.unit).T
    scene.meshcat.SetObject(name, cloud, size, colour)


def set_mesh(
    meshcat: Meshcat,
    name: str,
    points: Vectors3,
    facets: Vectors3,
    colour: Rgba,
    side: Meshcat.SideOfFaceToRender = Meshcat.SideOfFaceToRender.kDoubleSide,
) -> None:
    """Adds a mesh of points (N, 3) in Meshcat units and facets (F, 3), with smooth shading."""
    vertices: typing.Any = points.T  # The type stubs of Drake do not know array shapes.
    faces: typing.Any = facets.astype(np.int32).T
    meshcat.SetTriangleMesh(name, vertices, faces, colour, side=side)
    meshcat.SetProperty(f"{name}/<object>", "material.flatShading", False)


def add_plan(scene: Scene, positions: Vectors3) -> None:
    """Draws the planned path through positions (N, 3) in m in K; it replaces the last plan."""
    points: typing.Any = (positions / scene.unit).T
    scene.meshcat.SetLine("/plan", points, 1.0, _PLAN)


def grid_facets(rows: int, columns: int) -> np.ndarray:
    """Gives the triangles (2 (rows-1) (columns-1), 3) of a grid of points numbered row by row."""
    number = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = (
        number[:-1, :-1].ravel(),
        number[:-1, 1:].ravel(),
        number[1:, 1:].ravel(),
        number[1:, :-1].ravel(),
    )
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
