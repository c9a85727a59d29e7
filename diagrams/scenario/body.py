"""The body: its constants, its shape about the centre of mass, and its gravity."""

import dataclasses as dc
import functools
from functools import cached_property
from pathlib import Path
from typing import Self

import numpy as np

from proxops.assets import ASSETS
from proxops.diagrams.yaml_files import file_of, load_typed, read_mapping
from proxops.systems.common import (
    InputError,
    Matrix3,
    Values,
    Vector3,
    Vectors3,
    check_limits,
    html_table,
    last_change,
    number,
)
from proxops.systems.gravity import (
    BodyField,
    GravityField,
    Moon,
    MoonConfig,
    TabulatedField,
    ball,
    moon_position,
)
from proxops.systems.rotation import (
    SpinModel,
    SteadySpin,
    SteadySpinConfig,
    TorqueFreeSpin,
    TorqueFreeSpinConfig,
)
from proxops.systems.shapes import Polyhedron, clearances, mass_properties

# The least and the greatest semi-axis (m) of a keep-out ellipsoid.
_AXES = (1e-3, 1e9)
_LONGEST_NAME = 200
_SHIPPED = {
    path.stem: path for path in sorted(ASSETS.glob("*/*.yaml")) if path.stem == path.parent.name
}
# Turns of a body over which its rotation is looked at, and at how many times.
_TURNS, _TIMES = 20.0, 2001
_REQUIRED = (
    "name", "mesh", "mesh_unit", "mass_kg", "rotation_period_h", "keep_out_semi_axes_m",
)  # fmt: skip


@dc.dataclass(slots=True)
class BodyConfig:
    """The keys of a body's YAML file; all but `rotation` and `moons` are required."""

    name: str = ""
    # Mesh file (OBJ, PLY, STL or PDS .tab); its path is relative to the body's YAML file.
    mesh: str = ""
    # Unit of the numbers in the mesh file: "km" or "m".
    mesh_unit: str = ""
    mass_kg: float = number(0.0, at_least=1e-3, at_most=1e25, unit="kg")
    rotation_period_h: float = number(0.0, at_least=1e-3, at_most=1e7, unit="h")
    # Semi-axes along x, y, z of the keep-out ellipsoid about the centre of mass.
    keep_out_semi_axes_m: list[float] = dc.field(default_factory=list)
    # About which axis it turns, and how; it may be left out, and so may moons.
    rotation: SteadySpinConfig | TorqueFreeSpinConfig = dc.field(default_factory=SteadySpinConfig)
    moons: list[MoonConfig] = dc.field(default_factory=list)


@dc.dataclass(frozen=True)
class Body:
    """A rigid body of uniform density, as it is believed.

    `shape` and every position are in the frame K, which is fixed in the body. The origin of K is
    the centre of mass.
    """

    config: BodyConfig
    shape: Polyhedron
    gravity: str = "exact"
    """How `gravity_field` computes gravity: `exact`, or `table`."""
    moon_shapes: tuple[Polyhedron | None, ...] = ()
    """The mesh of each moon that has one, in its own axes."""

    @property
    def spin_rate(self) -> float:
        """Rate of the rotation in rad/s, at the start of a flight."""
        return 2.0 * np.pi / (self.config.rotation_period_h * 3600.0)

    @cached_property
    def spin(self) -> SpinModel:
        """How K turns."""
        rotation = self.config.rotation
        axis = np.array(rotation.axis)
        rate = self.spin_rate * (axis / np.linalg.norm(axis))
        if isinstance(rotation, SteadySpinConfig):
            return SteadySpin(rate)
        return TorqueFreeSpin(self.inertia_of(self.shape), rate)

    @cached_property
    def spin_about_z(self) -> float:
        """The mean rate in rad/s about z: that of the steady spin about z that is the nearest."""
        if self.spin.about_z:
            return float(self.spin.rate[2])
        return float(self.spin.angular_velocity(self.times_of_turns)[:, 2].mean())

    @property
    def times_of_turns(self) -> Values:
        """Times in s over many turns, at which the rotation as a whole is looked at."""
        return np.linspace(0.0, _TURNS * 2.0 * np.pi / self.spin_rate, _TIMES)

    @cached_property
    def moons(self) -> tuple[Moon, ...]:
        """The moons that have a surface: a mesh, or the ball of their radius."""
        shapes = self.moon_shapes or (None,) * len(self.config.moons)
        found = []
        for config, shape in zip(self.config.moons, shapes, strict=True):
            if shape is not None or config.radius_m > 0.0:
                found.append(Moon(config, shape or ball(config.radius_m)))
        return tuple(found)

    @cached_property
    def moon_depths(self) -> list[float]:
        """How far in m the centre of each moon is inside the keep-out ellipsoid at least.

        0 where a moon's ball is not always inside. Its way is looked at over many turns.
        """
        depths = []
        for moon in self.config.moons:
            way = np.array([moon_position(moon, t, self.spin) for t in self.times_of_turns])
            depth = -float(clearances(self.keep_out_semi_axes, way).max())
            depths.append(depth if depth > moon.radius_m else 0.0)
        return depths

    def inertia_of(self, shape: Polyhedron) -> Matrix3:
        """The inertia (3, 3) of a body of a shape, up to a factor, about its centre of mass in K.

        It is the one that the body's file gives, otherwise that of a uniform density.
        """
        rotation = self.config.rotation
        if isinstance(rotation, TorqueFreeSpinConfig) and rotation.inertia:
            xx, yy, zz, xy, xz, yz = rotation.inertia
            return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        return mass_properties(shape.vertices, shape.facets).inertia

    @property
    def keep_out_semi_axes(self) -> Vector3:
        """Semi-axes (3,) in m along x, y, z of the keep-out ellipsoid."""
        return np.array(self.config.keep_out_semi_axes_m)

    @cached_property
    def gravity_field(self) -> BodyField:
        """Gravity of the body; it is built at the first use."""
        if self.gravity == "table":
            return TabulatedField(self.exact_field, self.keep_out_semi_axes)
        return self.exact_field

    @cached_property
    def exact_field(self) -> GravityField:
        """Gravity by the sums over the polyhedron."""
        return _field_of(self.shape, self.config.mass_kg)

    @property
    def gravity_table_is_kept(self) -> bool:
        """Whether this machine has the gravity table already; to make it takes time."""
        return TabulatedField.is_kept(self.exact_field, self.keep_out_semi_axes)

    def with_gravity(self, gravity: str) -> Self:
        """Gives this body with gravity computed in this way, `exact` or `table`."""
        if gravity == self.gravity:
            return self
        other = dc.replace(self, gravity=gravity)
        other.__dict__["exact_field"] = self.exact_field  # Built once for both.
        return other

    def _repr_html_(self) -> str:
        config, sizes = self.config, " × ".join(f"{x:.4g}" for x in self.shape.extents)
        rows = {
            "extents (m)": sizes,
            "mass (kg)": f"{config.mass_kg:.4g}",
            "rotation period (h)": f"{config.rotation_period_h:g}",
            "keep-out semi-axes (m)": " × ".join(f"{x:g}" for x in config.keep_out_semi_axes_m),
            "facets": len(self.shape.facets),
            "gravity": self.gravity,
        }
        return html_table(config.name, rows)


def apparent_gravity(gravity: Vectors3, arms: Vectors3, spin: SpinModel) -> Vectors3:
    """Acceleration (N, 3) in m/s^2 of what is released at rest in K at the start of a flight.

    Args:
      gravity: (N, 3) in m/s^2. arms: (N, 3) from the centre of mass in m. spin: of K.
    """
    rate, change = spin.rate, spin.angular_acceleration(0.0)
    return gravity - np.cross(rate, np.cross(rate, arms)) - np.cross(change, arms)


def load_body(name_or_path: str | Path) -> Body:
    """Loads the body that ships under a name ("kleopatra") or that a YAML file describes.

    Raises:
      InputError: there is no such body; a key is missing or unknown, or has a value beyond its
        limits; the mesh is not sound; the mass does not fit the volume; or the mesh sticks out of
        the keep-out ellipsoid.
    """
    path = file_of(name_or_path, _SHIPPED, "body")
    tree = read_mapping(path)
    config = load_typed(BodyConfig, tree, str(path))
    missing = [name for name in _REQUIRED if name not in tree]
    if missing:
        raise InputError(f"{path}: these keys are missing: {', '.join(missing)}")
    shape = _recentred(path.parent / config.mesh, config.mesh_unit)
    moons = tuple(
        _recentred(path.parent / moon.mesh, config.mesh_unit) if moon.mesh else None
        for moon in config.moons
    )
    body = Body(config, shape, moon_shapes=moons)
    check_body(body, str(path))
    return body


def _recentred(path: Path, unit: str) -> Polyhedron:
    """The mesh of a file, about its centre of mass."""
    return _read_once(path, unit, last_change(path))


@functools.lru_cache(maxsize=8)
def _read_once(path: Path, unit: str, _changed: int) -> Polyhedron:
    """Many flights of a process load the same file: then so are its field and its rays."""
    return Polyhedron.load(path, unit).recentred()


@functools.lru_cache(maxsize=8)
def _field_of(shape: Polyhedron, mass: float) -> GravityField:
    return GravityField(shape, mass=mass)


def check_constants(config: BodyConfig, source: str) -> None:
    """Raises `InputError` if a body's constants are beyond their limits."""
    if config.rotation_period_h < 0.0:
        raise InputError(
            f"{source}: rotation_period_h must be positive, got {config.rotation_period_h}: a body "
            "spins about its +z axis. For a body that spins the other way, give the period as a "
            "positive number and turn the mesh half a turn: proxops shape FILE --fix NEW --flip"
        )
    check_limits(config, source)
    for k, moon in enumerate(config.moons):
        check_limits(moon, f"{source}: moons[{k}]")
    rotation = config.rotation
    if not any(rotation.axis):
        raise InputError(f"{source}: rotation.axis has no direction, got {rotation.axis}")
    if isinstance(rotation, TorqueFreeSpinConfig) and len(rotation.inertia) not in (0, 6):
        raise InputError(
            f"{source}: rotation.inertia must be six of xx, yy, zz, xy, xz, yz, or be left out, "
            f"got {len(rotation.inertia)}"
        )
    if not (0 < len(config.name) <= _LONGEST_NAME and config.name.isprintable()):
        raise InputError(
            f"{source}: name must be 1 to {_LONGEST_NAME} characters that can be printed"
        )
    axes = config.keep_out_semi_axes_m
    low, high = _AXES
    if len(axes) != 3 or not all(low <= axis <= high for axis in axes):
        raise InputError(
            f"{source}: keep_out_semi_axes_m must be three positive lengths, got {axes}"
        )


def check_body(body: Body, source: str) -> None:
    """Raises `InputError` if the constants are beyond their limits or do not fit the shape."""
    axes = body.config.keep_out_semi_axes_m
    check_constants(body.config, source)
    # The body keeps its field. It is built here, so that a wrong mass or unit is reported now.
    _ = body.gravity_field
    try:
        _ = body.spin
    except InputError as error:
        raise InputError(f"{source}: rotation.inertia: {error}") from error
    for k, moon in enumerate(body.moons):
        reach = float(np.linalg.norm(moon.shape.vertices, axis=1).max())
        if reach > (1.0 + 1e-9) * moon.config.radius_m:
            raise InputError(
                f"{source}: moons[{k}]: the mesh sticks out of the ball of radius_m, which must be "
                f"at least {reach:.6g}"
            )
    level = np.linalg.norm(body.shape.vertices / axes, axis=1)
    if level.max() >= 1.0:
        raise InputError(
            f"{source}: vertex {level.argmax()} of the mesh sticks out of the keep-out ellipsoid; "
            f"semi-axes that are {level.max():.3f} times as long would contain it"
        )
