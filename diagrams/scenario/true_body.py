"""The true body of a flight: its surface, gravity and spin, made from the map and from `truth`."""

from __future__ import annotations

import dataclasses as dc
import functools
import typing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from proxops.diagrams.scenario.body import Body, apparent_gravity
from proxops.diagrams.scenario.scenario_config import TruthConfig
from proxops.systems.common import InputError, Vector3, Vectors3, last_change
from proxops.systems.gravity import FINE_MESH, BodyField, GravityField, ScaledField, TabulatedField
from proxops.systems.rotation import SpinModel, SteadySpin, TorqueFreeSpin
from proxops.systems.shapes import (
    BouldersConfig,
    Polyhedron,
    displaced,
    ellipsoidal_norms,
    registered,
    with_boulders,
    with_lone_boulder,
)

# A mesh whose size differs from the map's by more than this share of the map's is a mistake, unless
# the scenario says that it is meant.
_OTHER_SIZE = 0.5
# A drawn spin axis is this many times as long as the body's greatest extent, so that it sticks out.
_AXIS_LENGTH = 1.2


class UnflyableWorldError(InputError):
    """A flight cannot begin in the world that was drawn for it."""


@dataclass(frozen=True)
class TrueBody:
    """The body as it is. All vectors are in K, which turns with it."""

    shape: Polyhedron
    """The true surface, with its boulders."""
    gravity_field: BodyField
    """Gravity of the true masses; boulders and craters have none."""
    spin: SpinModel
    """How K turns; it is that of the believed body if nothing differs."""
    axis_point: Vector3
    """(3,) in m: the true centre of mass, which is at rest and through which the axis goes."""

    def apparent_gravity(self, positions: Vectors3) -> Vectors3:
        """Acceleration (N, 3) in m/s^2 of what is released at rest in K at the start of a flight.

        `positions` are (N, 3) in m.
        """
        gravity = self.gravity_field.evaluate(positions).acceleration
        return apparent_gravity(gravity, positions - self.axis_point, self.spin)


def make_true_body(body: Body, truth: TruthConfig, shape: Polyhedron | None = None) -> TrueBody:
    """Makes the true body.

    The spin axis goes through the true centre of mass. A survey measures its direction as it turns
    the body, so that the direction at the start differs by `truth.pole_deg` alone. If the body
    tumbles, it does so with the inertia of its true shape, unless the body's file gives one.

    Args:
      body: the body as believed; its shape is the map.
      truth: how the true body differs.
      shape: the true surface without boulders, if it is known already; None: it is made.

    Raises:
      UnflyableWorldError: the displaced surface is not sound.
      InputError: `truth.mesh` cannot be read, is not sound or has another size.
    """
    if shape is None:
        shape = true_shape(body, truth)
    axis_point = np.zeros(3)
    field = body.gravity_field
    if shape is not body.shape or truth.gravity != 1.0 or truth.density_contrast != 0.0:
        field = _true_field(body, truth, shape)
        if shape is not body.shape or truth.density_contrast != 0.0:
            axis_point = field.centre_of_mass
    spin = _true_spin(body, truth, shape)
    return TrueBody(_rocky(shape, truth.boulders), field, spin, axis_point)


def _true_field(body: Body, truth: TruthConfig, shape: Polyhedron) -> BodyField:
    """Gravity of a true shape: of a fine `truth.mesh` from a table of its own, otherwise exact."""
    mass = truth.gravity * body.gravity_field.mass
    drawn = truth.surface_rms_m > 0.0 or truth.density_contrast != 0.0
    if truth.mesh is None or drawn or len(shape.facets) <= FINE_MESH:
        return GravityField(shape, mass=mass, contrast=truth.density_contrast)
    form = true_shape(body, dc.replace(truth, size=1.0))
    table = _table_of(form, body.gravity_field.mass, tuple(body.keep_out_semi_axes.tolist()))
    return ScaledField(table, shape, mass)


@functools.lru_cache(maxsize=2)
def _table_of(shape: Polyhedron, mass: float, axes: tuple[float, ...]) -> TabulatedField:
    """The field outside an ellipsoid of the proportions of `axes` (3,), which holds the shape."""
    held = max(1.0, 1.02 * float(ellipsoidal_norms(np.array(axes), shape.vertices).max()))
    return TabulatedField(GravityField(shape, mass=mass), held * np.array(axes))


def _rocky(shape: Polyhedron, boulders: BouldersConfig) -> Polyhedron:
    """The shape with boulders and craters, if there are any."""
    if boulders.widest_m or boulders.crater_widest_m:
        field = dc.replace(boulders, lone_at_m=())  # Hashable.
        shape = _with_boulders(shape, *dc.astuple(field))
    if boulders.lone_m:
        shape = with_lone_boulder(shape, boulders.lone_m, np.array(boulders.lone_at_m))
    return shape


@functools.lru_cache(maxsize=4)
def _with_boulders(shape: Polyhedron, *boulders: typing.Any) -> Polyhedron:
    return with_boulders(shape, BouldersConfig(*boulders))


def _true_spin(body: Body, truth: TruthConfig, shape: Polyhedron) -> SpinModel:
    """The true rotation of a body of a true shape."""
    tumbles = truth.tumbles or isinstance(body.spin, TorqueFreeSpin)
    turned = any(truth.pole_deg)
    if truth.spin == 1.0 and not (turned or truth.tumbles or (tumbles and shape is not body.shape)):
        return body.spin
    rate = truth.spin * body.spin.rate
    if turned:
        rate = Rotation.from_rotvec([*np.radians(truth.pole_deg), 0.0]).apply(rate)
    return TorqueFreeSpin(body.inertia_of(shape), rate) if tumbles else SteadySpin(rate)


def true_shape(body: Body, truth: TruthConfig) -> Polyhedron:
    """Makes the true surface in K; it is the map itself if the truth does not differ.

    Raises:
      UnflyableWorldError: the displaced surface is not sound.
      InputError: `truth.mesh` cannot be read, is not sound or has another size.
    """
    shape = body.shape
    if truth.mesh is not None:
        path, unit = Path(truth.mesh), truth.mesh_unit
        shape = _other_mesh(body.shape, path, last_change(path), unit, truth.mesh_of_any_size)
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


def turns_the_axes(truth: TruthConfig, body: Body, true_body: TrueBody) -> bool:
    """Tells whether the truth turns the spacecraft's axes S against K."""
    attitude = truth.attitude
    return bool(
        any(attitude.constant_deg)
        or attitude.varying_std_deg > 0.0
        or true_body.spin is not body.spin
        or truth.phase_deg != 0.0
    )


def spin_axes(body: Body, true_body: TrueBody) -> tuple[np.ndarray, np.ndarray] | None:
    """Gives the ends of the believed and of the true spin axis at the start, for a drawing.

    Returns:
      Two arrays (2, 3) in m in K: the ends of the believed axis, and those of the true one. None if
      both are one line that stays where it is, or if the true body does not spin.
    """
    believed, true = body.spin.rate, true_body.spin.rate
    rate = float(np.linalg.norm(true))
    same = not (np.cross(believed, true).any() or np.cross(true, true_body.axis_point).any())
    tumbling = any(isinstance(each.spin, TorqueFreeSpin) for each in (body, true_body))
    if (same and not tumbling) or rate == 0.0:
        return None
    half = 0.5 * _AXIS_LENGTH * float(body.shape.extents.max())
    along = np.array([[-half], [half]])
    return along * believed / np.linalg.norm(believed), true_body.axis_point + along * true / rate
