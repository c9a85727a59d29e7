"""`ShapeReport`: the findings about a mesh, as a dataclass and as JSON."""

from __future__ import annotations

import typing
from dataclasses import dataclass, field

import numpy as np

from proxops.diagrams.scenario import Body
from proxops.systems.common import Values
from proxops.systems.gravity import synchronous_radius
from proxops.systems.shapes import Defect, EnclosingEllipsoid, MassProperties, MeshFile

SLIVER_ANGLE = 1.0
"""A facet with an angle below this, in degrees, is a sliver."""


@dataclass(frozen=True)
class Questions:
    """What the user says about the body besides its mesh.

    Findings that need a value that is None are left out.
    """

    mass_kg: float | None = None
    density_kg_m3: float | None = None
    rotation_period_h: float | None = None
    craft_mass_kg: float = 100.0
    margin: float = 0.05
    """Share that is added to each semi-axis of the keep-out ellipsoid."""
    torque_free: bool = False
    """Whether the body turns as its inertia makes it, about z at the start."""


@dataclass(frozen=True)
class HoverMap:
    """A map of the greatest force per axis that hovering over the keep-out ellipsoid takes."""

    craft_mass_kg: float
    longitudes: Values
    """Longitudes (M,) in degrees. They and the latitudes are angles after the ellipsoid is scaled
    to a sphere."""
    latitudes: Values
    """Latitudes (N,) in degrees."""
    forces: np.ndarray
    """Forces (N, M) in N."""


@dataclass(frozen=True)
class ShapeReport:
    """The findings about a mesh. Figures that defects make meaningless are None."""

    file: MeshFile
    questions: Questions
    defects: list[Defect]
    remarks: list[str]
    angles: Values
    """The smallest angle (F,) of each facet in degrees; empty if they were not measured."""
    shells: int | None = None
    crossings: np.ndarray | None = None
    """Pairs (N, 2) of facets that cut or touch each other; None: they were not searched for."""
    solid: MassProperties | None = None
    keep_out: EnclosingEllipsoid | None = None
    body: Body | None = field(default=None, repr=False)
    """The body with mass, period and keep-out ellipsoid; None if the mesh is not sound or mass or
    period is unknown."""
    hover: HoverMap | None = field(default=None, repr=False)

    @property
    def sound(self) -> bool:
        """Whether the mesh has no defect."""
        return not self.defects

    @property
    def slivers(self) -> int:
        """Number of facets that are slivers: see `SLIVER_ANGLE`."""
        return int(np.sum(self.angles < SLIVER_ANGLE))

    @property
    def mass(self) -> float | None:
        """Mass in kg, given or from density and volume; None if unknown."""
        asked = self.questions
        if asked.mass_kg is not None or asked.density_kg_m3 is None or self.solid is None:
            return asked.mass_kg
        return asked.density_kg_m3 * self.solid.volume

    @property
    def density(self) -> float | None:
        """Density in kg/m^3, given or from mass and volume; None if unknown."""
        asked = self.questions
        if asked.density_kg_m3 is not None or asked.mass_kg is None or self.solid is None:
            return asked.density_kg_m3
        return asked.mass_kg / self.solid.volume

    @property
    def synchronous_radius(self) -> float | None:
        """Radius in m of the circular orbit about a point mass that takes one rotation."""
        if self.mass is None or self.questions.rotation_period_h is None:
            return None
        spin = 2.0 * np.pi / (3600.0 * self.questions.rotation_period_h)
        return synchronous_radius(self.mass, spin)

    def to_dict(self) -> dict[str, typing.Any]:
        """Gives all findings as values that JSON can hold; lengths are in m."""
        file, solid, keep_out, hover = self.file, self.solid, self.keep_out, self.hover
        finite = file.vertices[np.isfinite(file.vertices).all(axis=1)]
        figures: dict[str, typing.Any] = {
            "file": file.name,
            "format": file.format,
            "unit": file.unit,
            "vertices": len(file.vertices),
            "facets": len(file.facets),
            "sound": self.sound,
            "defects": [
                {"kind": d.kind, "text": d.about(), "count": len(d.facets), "first": d.facets[:20]}
                for d in self.defects
            ],
            "remarks": self.remarks,
            "shells": self.shells,
            "self_intersections": None if self.crossings is None else len(self.crossings),
            "smallest_angle_deg": self.angles.min() if self.angles.size else None,
            "slivers": self.slivers,
            "sliver_angle_deg": SLIVER_ANGLE,
            "extents_m": np.ptp(finite, axis=0) if len(finite) else None,
            "mass_kg": self.mass,
            "density_kg_m3": self.density,
            "rotation_period_h": self.questions.rotation_period_h,
            "synchronous_radius_m": self.synchronous_radius,
        }
        if solid is not None:
            density = self.density
            figures |= {
                "volume_m3": solid.volume,
                "area_m2": solid.area,
                "equivalent_diameter_m": solid.equivalent_diameter,
                "centre_of_mass_m": solid.centre_of_mass,
                "principal_axes": solid.principal_axes,
                "principal_moments_m5": solid.principal_moments,
                "principal_moments_kg_m2": density and density * solid.principal_moments,
                "spin_axis_off_principal_deg": spin_axis_error(solid),
            }
        if keep_out is not None:
            figures["keep_out"] = {
                "semi_axes_m": keep_out.semi_axes,
                "margin": keep_out.margin,
                "largest_level": keep_out.level,
                "farthest_vertex": keep_out.farthest,
                "volume_m3": keep_out.volume,
                "volume_over_least_possible": keep_out.volume_over_bound,
            }
        if hover is not None:
            figures["hover_on_keep_out"] = {
                "craft_mass_kg": hover.craft_mass_kg,
                "least_n": hover.forces.min(),
                "greatest_n": hover.forces.max(),
                "longitudes_deg": hover.longitudes,
                "latitudes_deg": hover.latitudes,
                "greatest_force_per_axis_n": hover.forces,
            }
        return _plain(figures)


def spin_axis_error(solid: MassProperties) -> float:
    """Computes the angle in degrees between z and the axis of the greatest moment of inertia."""
    return float(np.degrees(np.arccos(min(1.0, abs(solid.principal_axes[2, 2])))))


def _plain(value: typing.Any) -> typing.Any:
    """Converts arrays and numpy numbers to lists and Python numbers."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_plain(item) for item in value]
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value
