"""What a survey writes: map, its error, body, expected errors, and a scenario of visits."""

from __future__ import annotations

import copy
import dataclasses as dc
import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from proxops.diagrams.new_body import Questions, body_yaml, examine
from proxops.diagrams.scenario import (
    Body,
    Scenario,
    TruthConfig,
    World,
    dispersion_entries,
    dump_changes,
    expected_of,
    survey_errors,
)  # fmt: skip
from proxops.diagrams.surveys.survey_flight import SurveyFlight
from proxops.diagrams.yaml_files import write_yaml
from proxops.systems.common import (
    InputError,
    Matrix3,
    Values,
    Vector3,
    make_folder,
    rotation_matrix,
    write_json,
    write_whole,
)
from proxops.systems.gravity import GRAVITATIONAL_CONSTANT, GravityField, later
from proxops.systems.mapping import Estimated, MapUncertainty, Survey, matched
from proxops.systems.navigation import (
    LidarNavigationConfig,
    MapError,
    MendedMap,
    save_mended_map,
)
from proxops.systems.rotation import TorqueFreeSpinConfig
from proxops.systems.shapes import MeshFile, Polyhedron, areas, mesh_bytes, registered

# What an expected error is at least, over the size or its value: a survey is sure of more than it
# knows.
_LEAST = {"gravity": 1e-3, "pole": 0.01, "spin": 1e-6, "contrast": 3e-3, "surface": 2e-4}
_KM = 1e3
# Places of a facet, each of a quarter of its area, as weights of its corners.
_WITHIN = np.array([[2.0, 2.0, 2.0], [4.0, 1.0, 1.0], [1.0, 4.0, 1.0], [1.0, 1.0, 4.0]]) / 6.0


class Placed(NamedTuple):
    """The truth in the frame K of a survey's map. Only the truth of a scenario may hold it."""

    shape: Polyhedron
    """The true surface."""
    rate: Vector3
    """(3,) in rad/s: the true angular velocity at the end of the survey."""
    centre: Vector3
    """(3,) in m: the true centre of mass."""
    turn: Matrix3
    """(3, 3): from the axes of the frame in which the survey was flown to those of K."""
    shift: Vector3
    """(3,) in m: the place in K of that frame's origin."""


class Surveyed(NamedTuple):
    """What a survey gave, and how far it is from the truth, which nobody on board has."""

    figures: dict[str, Any]
    """What `survey.json` has."""
    flight: SurveyFlight
    found: Estimated
    uncertainty: MapUncertainty
    made: NewMap
    placed: Placed
    visit: Scenario
    """Of `visit.yaml`; its paths are relative to the folder."""
    errors: Values
    """(K,) in m: how far the map lies outside of the true surface, at points all over it."""
    deviations: Values
    """(K,) in m: standard deviations that the survey says of them."""


class NewMap(NamedTuple):
    """A survey's map in a frame K of its own, about its centre of mass, with z the spin axis."""

    shape: Polyhedron
    rotation: np.ndarray
    """R_KB (3, 3): B is the survey's frame of the body."""
    centre: np.ndarray
    """(3,) in m in B: the origin of K."""
    table: np.ndarray
    """(V, M) in m: see `MapError`."""


def new_map(survey: Survey, uncertainty: MapUncertainty, name: str, time: float) -> NewMap:
    """Puts the map into a frame K, with its long axis towards x, and the spin at a time in s as z.

    Raises:
      InputError: the map is not sound.
    """
    shape = Polyhedron(survey.vertices, survey.facets, name)
    centre, upright = shape.centre_of_mass, np.eye(3)
    if survey.tumbling is not None:
        rate = survey.angular_velocity(time)
        upright = Rotation.align_vectors([[0.0, 0.0, 1.0]], [rate])[0].as_matrix()
    flat = (survey.vertices - centre) @ upright.T[:, :2]
    values, vectors = np.linalg.eigh(flat.T @ flat)
    x, y = vectors[:, int(np.argmax(values))]
    if x < 0.0:
        x, y = -x, -y
    rotation = np.array([[x, y, 0.0], [-y, x, 0.0], [0.0, 0.0, 1.0]]) @ upright
    turned = Polyhedron((survey.vertices - centre) @ rotation.T, survey.facets, name)
    return NewMap(turned, rotation, centre, uncertainty.table)


def true_attitude(world: World, time: float) -> Matrix3:
    """R_NK (3, 3) of a survey's flight at a time in s, by the axes N that are believed."""
    phase, believed = np.radians(world.scenario.truth.phase_deg), world.body.spin
    axis = np.array([0.0, 0.0, 1.0])
    if not believed.about_z:  # As `SpinKnowledge` has it.
        axis = believed.rate / np.linalg.norm(believed.rate)
    behind = Rotation.from_rotvec(-phase * axis).as_matrix()
    return behind @ rotation_matrix(world.true_body.spin.attitude(time))


def true_in(made: NewMap, survey: Survey, world: World, time: float) -> Placed:
    """The truth in the frame K of the map, aligned as `registered` does, at a time in s."""
    true = world.true_body
    turn = made.rotation @ survey.body_attitudes(np.zeros(1))[0].T @ true_attitude(world, 0.0)
    moved = (true.shape.vertices - true.axis_point) @ turn.T - made.rotation @ made.centre
    placed = Polyhedron(moved, true.shape.facets, "truth")
    placed = registered(placed, made.shape)
    # The motion is rigid: fit it.
    a, b = true.shape.vertices.mean(axis=0), placed.vertices.mean(axis=0)
    motion = Rotation.align_vectors(placed.vertices - b, true.shape.vertices - a)[0]
    whole, centre = motion.as_matrix(), motion.apply(true.axis_point - a) + b
    rate = whole @ true.spin.angular_velocity(time)
    return Placed(placed, rate, centre, whole, motion.apply(-a) + b)


def body_of(
    made: NewMap, survey: Survey, name: str, craft_mass: float, believed: Body, time: float
) -> Body:
    """Examines the map as `proxops shape` does, with the survey's mass and period.

    Moons are as `believed`, from a time in s on, and the keep-out ellipsoid holds what it held.

    Raises:
      InputError: the map is not sound.
    """
    gm, rate = survey.gm, abs(survey.rate)
    if survey.tumbling is not None:
        rate = float(np.linalg.norm(survey.angular_velocity(time)))
    asked = Questions(
        mass_kg=gm / GRAVITATIONAL_CONSTANT, rotation_period_h=2.0 * np.pi / rate / 3600.0,
        craft_mass_kg=craft_mass,
    )  # fmt: skip
    file = MeshFile(made.shape.vertices, made.shape.facets, name, "km", "OBJ")
    report = examine(file, asked, with_hover=False)
    if report.body is None:
        defects = ", ".join(each.kind for each in report.defects) or "its mass does not fit"
        raise InputError(f"the survey's map is not sound ({defects}): fly it for longer")
    config, moons = report.body.config, believed.config.moons
    config.name, config.mesh = name, "map.obj"
    if survey.tumbling is not None:
        config.rotation = TorqueFreeSpinConfig()
    if not moons:
        return report.body
    axes = survey.body_attitudes(np.array([time]))[0] @ made.rotation.T
    config.moons = [
        dc.replace(later(moon, time, axes), mesh=f"moon_{k}.obj" if moon.mesh else "")
        for k, moon in enumerate(moons)
    ]
    outside = np.maximum(believed.keep_out_semi_axes, report.body.keep_out_semi_axes)
    config.keep_out_semi_axes_m = outside.tolist()
    return dc.replace(report.body, moon_shapes=believed.moon_shapes)


def expected_entries(
    scenario: Scenario, uncertainty: MapUncertainty, survey: Survey, made: NewMap, body: Body
) -> dict[str, object]:
    """Dispersions of what is uncertain after a survey: entries of a file of dispersions."""
    entries = {} if scenario.dispersions is None else dict(dispersion_entries(scenario.dispersions))
    entries.pop("based_on", None)
    entries.pop("spacecraft.mass_kg", None)  # Known on the day.
    entries.pop("lidar.noise_std_m", None)
    size, source = float(made.shape.extents.max()), "the survey's covariance and residuals"
    mounting = survey_errors(scenario, body).mounting

    def normal(mean: float, sigma: float) -> dict[str, object]:
        return {"normal": mean, "three_sigma": float(3.0 * sigma), "source": source}

    deviation = uncertainty.rms
    rough = float(max(1.5 * deviation, _LEAST["surface"] * size))
    # The centre of mass is the origin of B, and the map's centre is where density is uniform.
    trial = GravityField(body.shape, mass=body.config.mass_kg, contrast=0.1).centre_of_mass
    # It was found there, so that is what a contrast has to reach, and what it may be off beside.
    off = np.linalg.norm(made.centre) / 3.0 + np.linalg.norm(uncertainty.centre)
    contrast = 0.1 * float(off) / max(float(np.linalg.norm(trial)), 1e-9)
    entries |= {
        "truth.gravity": normal(1.0, max(uncertainty.gravity, _LEAST["gravity"])),
        "truth.pole_deg": normal(0.0, max(np.degrees(uncertainty.pole), _LEAST["pole"])),
        "truth.spin": normal(1.0, max(uncertainty.rate, _LEAST["spin"])),
        # The map is turned about z by the star tracker's constant error, and takes that along.
        "truth.phase_deg": normal(0.0, math.hypot(0.02, math.degrees(mounting))),
        "truth.density_contrast": normal(0.0, min(max(contrast, _LEAST["contrast"]), 0.3)),
        "truth.surface_rms_m": {
            "half_normal": 0.0, "three_sigma": rough,
            "source": source,
        },
        "truth.surface_correlation_m": {"fixed": float(2.0 * uncertainty.correlation)},
        "truth.size": normal(1.0, 1e-4),
    }  # fmt: skip
    return entries


def visit_scenario(
    scenario: Scenario, flight: SurveyFlight, placed: Placed, body: Body
) -> Scenario:
    """The scenario of visits, with the survey's own map, body and errors.

    `truth` alone holds the truth: the world of the survey, `placed` in the frame of the new map.
    `scenario` says all else. Runtime assurance, if it has any, takes the survey's errors as its
    bounds.
    """
    world, mass = flight.world, body.config.mass_kg
    shape, rate, centre, *_ = placed
    drawn, true = world.scenario.truth, world.true_body
    axis = rate / np.linalg.norm(rate)
    across = np.cross([0.0, 0.0, 1.0], axis)
    sine = float(np.linalg.norm(across))
    pole = across * (np.degrees(np.arcsin(sine)) / sine if sine > 0.0 else 0.0)
    contrast = drawn.density_contrast
    if contrast != 0.0:
        trial = GravityField(shape, mass=mass, contrast=contrast).centre_of_mass
        contrast *= float(np.sign((trial - shape.centre_of_mass) @ (centre - shape.centre_of_mass)))
    truth = dc.replace(
        drawn, gravity=float(true.gravity_field.mass) / mass, density_contrast=contrast,
        mesh="truth.obj", mesh_unit="km", size=1.0, surface_rms_m=0.0,
        spin=float(np.linalg.norm(rate)) / body.spin_rate, pole_deg=[float(x) for x in pole[:2]],
        phase_deg=0.0,
    )  # fmt: skip
    visit = copy.deepcopy(scenario)
    visit.body, visit.truth, visit.dispersions = "body.yaml", truth, None
    if visit.assurance is not None:
        visit.assurance.bounds = "expected.yaml"
    if not visit.is_rigid:
        visit.spacecraft.mass_kg = world.scenario.spacecraft.mass_kg
        visit.lidar.noise_std_m = world.scenario.lidar.noise_std_m
    return visit


def write_survey(
    folder: Path,
    scenario: Scenario,
    visits: Scenario,
    flight: SurveyFlight,
    found: Estimated,
    uncertainty: MapUncertainty,
    times: dict[str, float],
) -> Surveyed:
    """Writes all files of a survey; returns what it gave, with its errors against the truth.

    `scenario` is the survey's, `visits` what flies on the map later. `times` are wall times in s,
    for the figures.
    """
    survey, name = found.survey, f"{flight.world.body.config.name}, surveyed"
    world, end = flight.world, float(flight.returns.times[-1])
    made = new_map(survey, uncertainty, name, end)
    body = body_of(made, survey, name, world.scenario.spacecraft.mass_kg, world.body, end)
    make_folder(folder)
    save_mended_map(MendedMap(made.shape, MapError.known(made.table, 0.0)), folder / "map.obj")
    text = body_yaml(body.config, f"Surveyed by proxops: {len(found.returns.ranges)} returns")
    write_text(folder / "body.yaml", text)
    entries = expected_entries(scenario, uncertainty, survey, made, body)
    remark = "# What the survey may be wrong about: dispersions, for assurance.bounds.\n"
    write_text(folder / "expected.yaml", remark + write_yaml(_plain(entries)))
    placed = true_in(made, survey, world, end)
    visit, true = visit_scenario(visits, flight, placed, body), placed.shape
    told = dc.replace(
        expected_of(visit, body, str(folder / "expected.yaml")),
        relief_rms_m=math.sqrt(uncertainty.rest),
        relief_correlation_m=uncertainty.correlation,
    )
    visit.navigation = LidarNavigationConfig(map="map.obj", map_unit="km", expected=told)
    write_text(folder / "visit.yaml", f"# Visits of {name}, by its survey.\n{dump_changes(visit)}")
    meshes = {"truth.obj": true} | {
        moon.mesh: shape
        for moon, shape in zip(body.config.moons, body.moon_shapes, strict=True)
        if shape is not None
    }
    for file, shape in meshes.items():
        content = mesh_bytes(shape.vertices / _KM, shape.facets, ".obj", "in km")
        write_whole(folder / file, lambda path, content=content: path.write_bytes(content))
    errors = surface_errors(made.shape, true, uncertainty)
    figures = survey_figures(errors, true, flight, uncertainty, visit.truth, found) | times
    figures |= {
        "mass_kg": body.config.mass_kg,
        "rotation_period_h": body.config.rotation_period_h,
        "length_m": float(made.shape.extents.max()),
        "length_error": float(made.shape.extents.max() / true.extents.max()) - 1.0,
    }
    write_json(folder / "survey.json", figures)
    return Surveyed(figures, flight, found, uncertainty, made, placed, visit, *errors[:2])


def survey_figures(
    errors: tuple[Values, Values, Values],
    true: Polyhedron,
    flight: SurveyFlight,
    uncertainty: MapUncertainty,
    truth: TruthConfig,
    found: Estimated,
) -> dict[str, Any]:
    """What a survey found, and how far it is from the truth, by shares of the size and so on.

    `errors` are `surface_errors` of the map.
    """
    size, (off, sigma, shares) = float(true.extents.max()), errors
    return {
        "map_rms_of_size": float(np.sqrt(shares @ off**2)) / size,
        "map_bias_of_size": float(shares @ off) / size,
        "within_3_sigma": float(shares @ (np.abs(off) <= 3.0 * sigma)),
        "deviation_of_size": uncertainty.rms / size,
        "covered": uncertainty.covered,
        "gravity_error": 1.0 / truth.gravity - 1.0,
        "gravity_deviation": uncertainty.gravity,
        "pole_error_deg": math.hypot(*truth.pole_deg),
        "pole_deviation_deg": float(np.degrees(uncertainty.pole)),
        "rate_error": 1.0 / truth.spin - 1.0,
        "rate_deviation": uncertainty.rate,
        "residual_median_m": float(np.median(np.abs(found.solution.residuals))),
        "returns": len(found.returns.ranges),
        "frames": len(found.returns.times),
        "approach_h": flight.orbit_time / 3600.0,
        "delta_v_m_s": flight.delta_v,
        "orbit_delta_v_m_s": float(np.abs(flight.returns.thrusts).sum() * _period(flight)),
        "least_clearance_m": flight.clearance,
        "keep_out_entries": flight.entries,
        "interventions": flight.interventions,
        "hours": flight.hours,
        "collided": flight.collided,
    }


def surface_errors(
    shape: Polyhedron, true: Polyhedron, uncertainty: MapUncertainty
) -> tuple[Values, Values, Values]:
    """How far a map is from the true surface, at four points of each facet.

    Returns:
      Distances (K,) in m, positive where the map lies outwards; the map's own standard deviations
      (K,) in m there; and the shares (K,) of the area for which the points stand.
    """
    corners = shape.vertices[shape.facets]
    points = np.einsum("bc,fci->fbi", _WITHIN, corners).reshape(-1, 3)
    match = matched(points, true.vertices, true.facets)
    feet = np.einsum("kc,kci->ki", match.places, true.vertices[true.facets[match.facets]])
    off = np.linalg.norm(points - feet, axis=1) * np.sign(match.heights)
    sigma = (uncertainty.deviations[shape.facets] @ _WITHIN.T).ravel()
    shares = np.repeat(areas(shape.vertices, shape.facets), len(_WITHIN))
    return off, sigma, shares / shares.sum()


def _period(flight: SurveyFlight) -> float:
    return float(np.median(np.diff(flight.returns.times)))


def _plain(value: object) -> object:
    """Numbers of numpy as those of Python."""
    if isinstance(value, dict):
        return {key: _plain(each) for key, each in value.items()}
    if isinstance(value, list):
        return [_plain(each) for each in value]
    return value.item() if isinstance(value, np.generic) else value


def write_text(path: Path, text: str) -> None:
    """Writes a text into a file, whole or not at all."""
    write_whole(path, lambda file: file.write_text(text, encoding="utf-8"))
