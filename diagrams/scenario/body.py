"""The body: its constants, its shape about the centre of mass, and its gravity."""

import dataclasses as dc
from functools import cached_property
from pathlib import Path
from typing import Self

import numpy as np

from proxops.assets import ASSETS
from proxops.diagrams.scenario.typed_yaml import is_yaml_path, load_typed, read_mapping
from proxops.systems.common import InputError, Vector3, check_limits, html_table, number
from proxops.systems.gravity import BodyField, GravityField, TabulatedField
from proxops.systems.shapes import Polyhedron

# The least and the greatest semi-axis (m) of a keep-out ellipsoid.
_AXES = (1e-3, 1e9)
_LONGEST_NAME = 200


@dc.dataclass(slots=True)
class BodyConfig:
    """The keys of a body's YAML file; all of them are required."""

    name: str = ""
    # Mesh file (OBJ, PLY, STL or PDS .tab); its path is relative to the body's YAML file.
    mesh: str = ""
    # Unit of the numbers in the mesh file: "km" or "m".
    mesh_unit: str = ""
    mass_kg: float = number(0.0, at_least=1e-3, at_most=1e25, unit="kg")
    rotation_period_h: float = number(0.0, at_least=1e-3, at_most=1e7, unit="h")
    # Semi-axes along x, y, z of the keep-out ellipsoid about the centre of mass.
    keep_out_semi_axes_m: list[float] = dc.field(default_factory=list)


@dc.dataclass(frozen=True)
class Body:
    """A rigid body of uniform density that spins uniformly about the body-fixed z axis.

    `shape` and every position are in the frame K, which is fixed in the body. The origin of K is
    the centre of mass.
    """

    config: BodyConfig
    shape: Polyhedron
    gravity: str = "exact"
    """How `gravity_field` computes gravity: `exact`, or `table`."""

    @property
    def spin_rate(self) -> float:
        """Angular velocity about z in rad/s."""
        return 2.0 * np.pi / (self.config.rotation_period_h * 3600.0)

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
        return GravityField(self.shape, mass=self.config.mass_kg)

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


def load_body(name_or_path: str | Path) -> Body:
    """Loads the body that ships under a name ("kleopatra") or that a YAML file describes.

    Raises:
      InputError: there is no such body; a key is missing or unknown, or has a value beyond its
        limits; the mesh is not sound; the mass does not fit the volume; or the mesh sticks out of
        the keep-out ellipsoid.
    """
    shipped = ASSETS / name_or_path / f"{name_or_path}.yaml"
    path = Path(name_or_path)
    if not is_yaml_path(name_or_path):
        if not shipped.is_file():
            known = sorted(
                p.parent.name for p in ASSETS.glob("*/*.yaml") if p.stem == p.parent.name
            )
            raise InputError(
                f"body {name_or_path!r} does not ship with proxops ({', '.join(known)} does); "
                "for another body give the path of its .yaml file"
            )
        path = shipped
    tree = read_mapping(path)
    config = load_typed(BodyConfig, tree, str(path))
    missing = [field.name for field in dc.fields(BodyConfig) if field.name not in tree]
    if missing:
        raise InputError(f"{path}: these keys are missing: {', '.join(missing)}")
    shape = Polyhedron.load(path.parent / config.mesh, config.mesh_unit)
    body = Body(config, shape.recentred())
    check_body(body, str(path))
    return body


def check_constants(config: BodyConfig, source: str) -> None:
    """Raises `InputError` if a body's constants are beyond their limits."""
    if config.rotation_period_h < 0.0:
        raise InputError(
            f"{source}: rotation_period_h must be positive, got {config.rotation_period_h}: a body "
            "spins about its +z axis. For a body that spins the other way, give the period as a "
            "positive number and turn the mesh half a turn: proxops shape FILE --fix NEW --flip"
        )
    check_limits(config, source)
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
    level = np.linalg.norm(body.shape.vertices / axes, axis=1)
    if level.max() >= 1.0:
        raise InputError(
            f"{source}: vertex {level.argmax()} of the mesh sticks out of the keep-out ellipsoid; "
            f"semi-axes that are {level.max():.3f} times as long would contain it"
        )
