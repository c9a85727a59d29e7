"""Examines a mesh: its defects, the properties of the solid, and the force to hover there."""

from __future__ import annotations

import dataclasses

import numpy as np

from proxops.diagrams.new_body.shape_report import (
    SLIVER_ANGLE,
    HoverMap,
    Questions,
    ShapeReport,
    spin_axis_error,
)
from proxops.diagrams.scenario import Body, BodyConfig, hover_force
from proxops.systems.common import InputError, Progress, directions_of, part_of, silent
from proxops.systems.gravity import PLAUSIBLE_DENSITY
from proxops.systems.rotation import SteadySpinConfig, TorqueFreeSpin, TorqueFreeSpinConfig
from proxops.systems.shapes import (
    Defect,
    MassProperties,
    MeshFile,
    Polyhedron,
    find_defects,
    flat_facets,
    mass_properties,
    metres_per,
    nested_shells,
    self_intersections,
    shell_labels,
    smallest_angles,
    smallest_ellipsoid,
)

# Least and greatest length (m) of a small body: a boulder and Pluto.
_PLAUSIBLE_LENGTH = (1.0, 2.5e6)
# A mesh that is shorter (m) may be in km: that of a body of 20 km is 20 long.
_LEAST_VISITED = 30.0
# A period beyond so many hours is a remark.
_SLOWEST, _YEAR = 2000.0, 8766.0
# Grid of the hover map over the keep-out ellipsoid, in degrees.
_MAP_STEP = 5.0
# Places of it whose gravity is computed at a time, between reports of progress.
_PLACES = 512
# A spin axis that is off by less than this (degrees) is not worth a remark.
_OFF_AXIS = 5.0


def examine(
    file: MeshFile, asked: Questions, progress: Progress = silent, *, with_hover: bool = True
) -> ShapeReport:
    """Examines a mesh as far as its defects permit.

    The solid and its keep-out ellipsoid need a mesh whose only defects, if any, are facets that cut
    each other. The body and the hover map need a mesh without defects.

    Args:
      file: the mesh.
      asked: mass, density, period and margins, as far as they are known.
      progress: called with the share done; a million facets take minutes.
      with_hover: whether to make the hover map, which takes most of them.

    Raises:
      InputError: the mass, density or period is not positive, the margin is negative, or mass and
        density are both given.
    """
    _check(asked)
    vertices, facets = file.vertices, file.facets
    progress(0.0, "looking for defects")
    defects = find_defects(vertices, facets)
    report = ShapeReport(file, asked, defects, [], np.empty(0))
    kinds = {defect.kind for defect in defects}
    if kinds & {"shape", "not finite", "no such vertex"}:
        return report
    progress(0.1, "looking for facets that cut each other")
    report = _look_at_facets(report, "duplicate vertices" in kinds)
    progress(0.4, "measuring the solid")
    if defects:
        return report
    # The volume is defined even if facets cut each other.
    report = _look_at_solid(report)
    if report.defects:
        return report
    body = _body(report)
    report = dataclasses.replace(report, body=body)
    if body is None or not with_hover:
        return report
    within = part_of(progress, 0.5, 1.0)
    return dataclasses.replace(report, hover=hover_map(body, asked.craft_mass_kg, progress=within))


def _look_at_facets(report: ShapeReport, unwelded: bool) -> ShapeReport:
    vertices, facets = report.file.vertices, report.file.facets
    defects, remarks = list(report.defects), list(report.remarks)
    report = dataclasses.replace(report, angles=smallest_angles(vertices, facets))
    crossings = None
    if not unwelded:  # Otherwise all neighbours would be found to touch each other.
        some = np.setdiff1d(np.arange(len(facets)), flat_facets(vertices, facets))
        crossings = some[self_intersections(vertices, facets[some])]
        if len(crossings):
            defects.append(_crossing_defect(facets, len(vertices), crossings))
    if report.slivers:
        remarks.append(
            f"{report.slivers} facets are slivers, with an angle below {SLIVER_ANGLE:g} degree"
        )
    shells, _ = shell_labels(facets, len(vertices))
    if shells > 1:
        remarks.append(f"{shells} separate shells")
    if shells > 1 and not report.defects:
        found = nested_shells(vertices, facets)
        for void in np.flatnonzero(found.volumes < 0.0):
            share = 100.0 * found.share(int(void))
            remarks.append(
                f"a void of {share:.3g} % of the body: the shell of facet "
                f"{np.argmax(found.labels == void)} winds inwards"
            )
    unused = len(vertices) - len(np.unique(facets))
    if unused:
        remarks.append(f"{unused} vertices belong to no facet")
    return dataclasses.replace(
        report, defects=defects, remarks=remarks, shells=shells, crossings=crossings
    )


def _crossing_defect(facets: np.ndarray, vertex_count: int, crossings: np.ndarray) -> Defect:
    """The defect of facets that meet in pairs (N, 2), with the way out, if there is one."""
    first, second = crossings[0]
    text = (
        f": {len(crossings)} pairs of facets cut or touch each other, the first facets "
        f"{first} and {second}"
    )
    _, labels = shell_labels(facets, vertex_count)
    if (labels[crossings[:, 0]] != labels[crossings[:, 1]]).all():
        text += ", all of different shells; if these are lobes that overlap, --fix joins them"
    return Defect("self-intersection", text, np.unique(crossings))


def _look_at_solid(report: ShapeReport) -> ShapeReport:
    vertices, facets = report.file.vertices, report.file.facets
    solid = mass_properties(vertices, facets)
    about_centre = vertices - solid.centre_of_mass
    keep_out = smallest_ellipsoid(about_centre, report.questions.margin)
    remarks = list(report.remarks)
    size = float(np.ptp(vertices, axis=0).max())
    if report.file.unit == "m" and size < _LEAST_VISITED and report.questions.mass_kg is None:
        remarks.append(f"the body is {size:.3g} m long: if its mesh is in km, give --unit km")
    period = report.questions.rotation_period_h or 0.0
    if period > _SLOWEST:
        remarks.append(
            f"a period of {period:g} h is {period / _YEAR:.2g} years: if it is in seconds, give "
            f"--period {period / 3600.0:.4g}"
        )
    offset = float(np.linalg.norm(solid.centre_of_mass))
    if offset > 1e-3 * size:
        remarks.append(f"the centre of mass is {offset:.4g} m from the origin")
    remarks += _about_axis(solid, report.questions)
    report = dataclasses.replace(report, solid=solid, keep_out=keep_out)
    reach = float(np.linalg.norm(about_centre[:, :2], axis=1).max())
    synchronous = report.synchronous_radius
    if synchronous is not None and synchronous < reach:
        remarks.append(
            f"the synchronous radius, {synchronous:.4g} m, is inside the body ({reach:.4g} m): "
            "loose material at the ends may fly off"
        )
    defects = report.defects + _unit_defects(report, size)
    return dataclasses.replace(report, defects=defects, remarks=remarks)


def _about_axis(solid: MassProperties, asked: Questions) -> list[str]:
    """Says if z is no axis that a body of uniform density would go on turning about."""
    error = spin_axis_error(solid)
    text = (
        f"z, the spin axis, is {error:.3g} degrees off the axis of the greatest moment of inertia"
    )
    if asked.rotation_period_h is None:
        # If the two greater moments are nearly equal, their axes are hardly determined.
        distinct = solid.principal_moments[1] < 0.98 * solid.principal_moments[2]
        return [text] if distinct and error > _OFF_AXIS else []
    rate = np.array([0.0, 0.0, 2.0 * np.pi / (3600.0 * asked.rotation_period_h)])
    spin = TorqueFreeSpin(solid.inertia, rate)
    if spin.period == np.inf:
        return []
    rates = spin.angular_velocity(np.linspace(0.0, spin.period, 721))
    off = np.degrees(np.arccos(rates[:, 2] / np.linalg.norm(rates, axis=1))).max()
    if off < _OFF_AXIS:
        return []
    text += (
        f": at uniform density it would tumble, the axis up to {off:.3g} degrees off z and back in "
        f"{spin.period / 3600.0:.4g} h"
    )
    return [text if asked.torque_free else f"{text}; --torque-free makes a body that does"]


def hover_map(
    body: Body, craft_mass_kg: float, grow: float = 0.0, progress: Progress = silent
) -> HoverMap:
    """Computes the force that hovering over the keep-out ellipsoid takes.

    Args:
      body: the body.
      craft_mass_kg: mass of the spacecraft.
      grow: length in m that is added to each semi-axis of the ellipsoid.
      progress: called with the share done.
    """
    longitudes = np.arange(-180.0, 180.0 + _MAP_STEP, _MAP_STEP)
    latitudes = np.arange(-90.0, 90.0 + _MAP_STEP, _MAP_STEP)
    a, b = np.meshgrid(np.radians(longitudes), np.radians(latitudes))
    places = directions_of(a, b).reshape(-1, 3) * (body.keep_out_semi_axes + grow)
    forces = np.empty(len(places))
    for start in range(0, len(places), _PLACES):
        progress(start / len(places), "gravity over the keep-out ellipsoid")
        some = slice(start, start + _PLACES)
        forces[some] = hover_force(places[some], craft_mass_kg, body)
    return HoverMap(craft_mass_kg, longitudes, latitudes, forces.reshape(a.shape))


def _check(asked: Questions) -> None:
    if asked.mass_kg is not None and asked.density_kg_m3 is not None:
        raise InputError("give the mass or the density, not both")
    period = asked.rotation_period_h
    if period is not None and period < 0.0:
        raise InputError(
            f"a period of {period:g} h is that of a body which spins about -z: give {-period:g} h, "
            "and --fix FILE --flip, which turns the mesh so that the body spins about +z"
        )
    for name in ("mass_kg", "density_kg_m3", "rotation_period_h", "craft_mass_kg"):
        value = getattr(asked, name)
        if value is not None and not (np.isfinite(value) and value > 0.0):
            raise InputError(f"{name} must be positive, got {value}")
    if not asked.margin >= 0.0:
        raise InputError(f"margin must not be negative, got {asked.margin}")


def _unit_defects(report: ShapeReport, size: float) -> list[Defect]:
    """Finds whether the mesh's unit does not fit the mass or the size of a small body (m)."""
    unit, density = report.file.unit, report.density
    low, high = PLAUSIBLE_DENSITY if density is not None else _PLAUSIBLE_LENGTH
    if low <= (size if density is None else density) <= high:
        return []
    proposal = ""
    for other in ("m", "km", "cm", "mm"):
        factor = metres_per(other) / metres_per(unit)
        fits = size * factor if density is None else density / factor**3
        # A density that was given does not say how large the body is.
        if low <= fits <= high and (density is None or report.questions.mass_kg is not None):
            value = f"{fits:.4g} m" if density is None else f"{fits:.4g} kg/m^3"
            proposal = f"; in {other} it would be {value}: try --unit {other}"
            break
    if density is None:
        text = f" is {size:.3g} m long in {unit}, which no small body is"
    else:
        text = f": {density:.3g} kg/m^3 in {unit} is no body's density"
    text += f"{proposal}; of a model without a scale, say --size or --diameter METRES"
    return [Defect("unit", text, np.empty(0, dtype=int))]


def _body(report: ShapeReport) -> Body | None:
    """Makes the body as its YAML file will define it, or None if mass or period is unknown."""
    mass, period = report.mass, report.questions.rotation_period_h
    if mass is None or period is None or report.keep_out is None:
        return None
    # Semi-axes are rounded up, as they will be written, so that all vertices stay inside.
    steps = 10.0 ** (np.floor(np.log10(report.keep_out.semi_axes)) - 5.0)
    axes = np.ceil(report.keep_out.semi_axes / steps) * steps
    config = BodyConfig(
        name=report.file.name.rpartition(".")[0],
        mesh=report.file.name,
        mesh_unit=report.file.unit,
        mass_kg=float(f"{mass:.6g}"),
        rotation_period_h=period,
        keep_out_semi_axes_m=[float(f"{axis:.6g}") for axis in axes],
        rotation=TorqueFreeSpinConfig() if report.questions.torque_free else SteadySpinConfig(),
    )
    shape = Polyhedron(report.file.vertices, report.file.facets, report.file.name)
    return Body(config, shape.recentred())
