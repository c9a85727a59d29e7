"""The true body of a flight: its surface, gravity and spin, made from the map and from `truth`."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from proxops.diagrams.scenario.body import Body
from proxops.diagrams.scenario.scenario_config import Scenario, TruthConfig
from proxops.diagrams.scenario.transits import Transit, UnflyableWorldError
from proxops.systems.common import InputError, Vector3, Vectors3
from proxops.systems.gravity import BodyField, GravityField
from proxops.systems.shapes import Polyhedron, displaced, registered

# A mesh whose size differs from the map's by more than this share of the map's is a mistake, unless
# the scenario says that it is meant.
_OTHER_SIZE = 0.5
# A drawn spin axis is this many times as long as the body's greatest extent, so that it sticks out.
_AXIS_LENGTH = 1.2


@dataclass(frozen=True)
class TrueBody:
    """The body as it is. All vectors are in K, which turns with it."""

    shape: Polyhedron
    """The true surface."""
    gravity_field: BodyField
    """Gravity of the true masses."""
    spin: Vector3
    """Angular velocity (3,) in rad/s."""
    axis_point: Vector3
    """(3,) in m: the true centre of mass, through which the spin axis goes."""

    def apparent_gravity(self, positions: Vectors3) -> Vectors3:
        """Acceleration (N, 3) in m/s^2 of a body released at rest in K at positions (N, 3) in m."""
        arms = positions - self.axis_point
        centrifugal = np.cross(self.spin, np.cross(self.spin, arms))
        return self.gravity_field.evaluate(positions).acceleration - centrifugal


def make_true_body(body: Body, truth: TruthConfig, shape: Polyhedron | None = None) -> TrueBody:
    """Makes the true body.

    The spin axis goes through the true centre of mass. A survey measures its direction as it turns
    the body, so that the direction differs from K's z by `truth.pole_deg` alone.

    Args:
      body: the body as believed; its shape is the map.
      truth: how the true body differs.
      shape: the true surface, if it is known already; None: it is made.

    Raises:
      UnflyableWorldError: the displaced surface is not sound.
      InputError: `truth.mesh` cannot be read, is not sound or has another size.
    """
    if shape is None:
        shape = true_shape(body, truth)
    axis_point = np.zeros(3)
    field = body.gravity_field
    if shape is not body.shape or truth.gravity != 1.0 or truth.density_contrast != 0.0:
        mass = truth.gravity * body.gravity_field.mass
        field = GravityField(shape, mass=mass, contrast=truth.density_contrast)
        if shape is not body.shape or truth.density_contrast != 0.0:
            axis_point = field.centre_of_mass
    spin = np.array([0.0, 0.0, truth.spin * body.spin_rate])
    if any(truth.pole_deg):
        spin = Rotation.from_rotvec([*np.radians(truth.pole_deg), 0.0]).apply(spin)
    return TrueBody(shape, field, spin, axis_point)


def true_shape(body: Body, truth: TruthConfig) -> Polyhedron:
    """Makes the true surface in K; it is the map itself if the truth does not differ.

    Raises:
      UnflyableWorldError: the displaced surface is not sound.
      InputError: `truth.mesh` cannot be read, is not sound or has another size.
    """
    shape = body.shape
    if truth.mesh is not None:
        path = Path(truth.mesh)
        changed = path.stat().st_mtime_ns if path.is_file() else 0
        shape = _other_mesh(body.shape, path, changed, truth.mesh_unit, truth.mesh_of_any_size)
    if truth.surface_rms_m > 0.0:
        try:
            shape = displaced(
                shape, truth.surface_rms_m, truth.surface_correlation_m, truth.surface_seed
            )
        except InputError as error:
            raise UnflyableWorldError(f"truth.surface_rms_m: {error}") from error
    if truth.size != 1.0:
        shape = Polyhedron(truth.size * shape.vertices, shape.facets, shape.name)
    return shape


@functools.lru_cache(maxsize=4)
def _other_mesh(
    map_shape: Polyhedron, path: Path, changed: int, unit: str, any_size: bool
) -> Polyhedron:
    """The mesh in a file that was last changed at a time, moved onto the map."""
    mesh = Polyhedron.load(path, unit).recentred()
    ratio = float(mesh.extents.max() / map_shape.extents.max())
    if abs(ratio - 1.0) > _OTHER_SIZE and not any_size:
        raise InputError(
            f"truth.mesh: {path} is {ratio:.3g} times as long as the map: check truth.mesh_unit "
            f"(now {unit}), or set truth.mesh_of_any_size if this is meant"
        )
    return registered(mesh, map_shape)


def check_flyable(true_body: TrueBody, transit: Transit, scenario: Scenario) -> None:
    """Checks that a spacecraft can be at rest at both ends of a transit in the true world.

    Raises:
      UnflyableWorldError: the start or the goal is inside the true body, or hovering there takes
        more than the true thrust; the message says which.
    """
    truth, craft = scenario.truth, scenario.spacecraft
    ends = np.stack([transit.start, transit.goal])
    inside = true_body.gravity_field.evaluate(ends).inside
    need = truth.mass * craft.mass_kg * np.abs(true_body.apparent_gravity(ends))
    limit = craft.thrust_limit_n * np.array(truth.thrusters.scale)
    for k, name in enumerate(("start", "goal")):
        if inside[k]:
            raise UnflyableWorldError(f"the {name} is inside the true body")
        axis = int(np.argmax(need[k] - limit))
        if need[k][axis] > limit[axis]:
            raise UnflyableWorldError(
                f"hovering at the {name} takes {need[k][axis]:.3g} N along {'xyz'[axis]}, but the "
                f"true thrusters give {limit[axis]:.3g} N"
            )


def turns_the_axes(truth: TruthConfig) -> bool:
    """Tells whether the truth turns the spacecraft's axes S against K."""
    attitude = truth.attitude
    return bool(
        any(attitude.constant_deg)
        or attitude.varying_std_deg > 0.0
        or any(truth.pole_deg)
        or truth.spin != 1.0
        or truth.phase_deg != 0.0
    )


def spin_axes(body: Body, true_body: TrueBody) -> tuple[np.ndarray, np.ndarray] | None:
    """Gives the ends of the believed and of the true spin axis, for a drawing.

    Returns:
      Two arrays (2, 3) in m in K: the ends of the believed axis, which is K's z, and those of the
      true one. None if both are one line, or if the true body does not spin.
    """
    rate = float(np.linalg.norm(true_body.spin))
    same = not (true_body.spin[:2].any() or true_body.axis_point[:2].any())
    if same or rate == 0.0:
        return None
    half = 0.5 * _AXIS_LENGTH * float(body.shape.extents.max())
    along = np.array([[-half], [half]])
    true = true_body.axis_point + along * true_body.spin / rate
    return along * [0.0, 0.0, 1.0], true
