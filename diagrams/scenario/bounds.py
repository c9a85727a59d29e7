"""The uncertainty set of runtime assurance: the greatest errors within which it keeps out.

It is as the scenario gives it, or the ends of what the scenario's worlds may be.
"""

from __future__ import annotations

import dataclasses as dc
import functools
import itertools
import math
import typing
import warnings
from pathlib import Path

import numpy as np

from proxops.diagrams.scenario.body import Body
from proxops.diagrams.scenario.dispersions import BASE, Dispersion, Dispersions
from proxops.diagrams.scenario.distributions import Choice
from proxops.diagrams.scenario.keys import differing_values, value_at
from proxops.diagrams.scenario.quantities import QUANTITIES, QUANTITY
from proxops.diagrams.scenario.scenario_config import Scenario, TruthConfig
from proxops.diagrams.scenario.sky import greatest_from_sky
from proxops.diagrams.scenario.spacecraft_model import RigidBodyConfig, load_spacecraft
from proxops.diagrams.scenario.true_body import true_shape
from proxops.diagrams.yaml_files import is_yaml_path, load_typed, read_mapping
from proxops.systems.assurance import AssuranceBounds, AssuranceConfig
from proxops.systems.common import InputError, check_limits, spread_directions, values_in_words
from proxops.systems.gravity import GravityField
from proxops.systems.navigation import LidarNavigationConfig
from proxops.systems.shapes import HEIGHT, Polyhedron, greatest_gap, roughened
from proxops.systems.vehicle import STANDARD_GRAVITY

# What has a normal distribution at each time, such as a Gauss-Markov process, has no end. It is
# cut at this many standard deviations, and the roughness of a surface at its own 3 sigma.
_DEVIATIONS = 4.0
_ROUGHNESS = 3.0
# The velocity change for which propellant is counted, in units of the speed limit. The MPC's
# transits at Kleopatra need up to 5.4.
_SPEEDS = 6.0
_DISTURBANCE = "disturbance.max_relative_magnitude"
# Worlds and places of each in which gravity is compared, and what covers the gaps between them.
_WORLDS, _PLACES, _GAPS = 6, 300, 1.25
# A surface that is too rough for its gravity is tried with half the roughness, so often.
_MOST_HALVINGS = 6


def uncertainty_set(scenario: Scenario, body: Body) -> AssuranceBounds:
    """Gives the errors within which a scenario's runtime assurance keeps its promise.

    Without runtime assurance, and without bounds, everything is as believed.

    Raises:
      InputError: see `AssuranceBounds` and `load_dispersions`; or dispersions that the bounds name
        have a value without an end.
    """
    bounds = AssuranceBounds()
    if scenario.assurance is not None:
        bounds = _bounds(scenario.assurance, Dispersions.of(scenario, body))
    beside = tumbling(body, scenario.spacecraft.speed_limit_m_s)
    return dc.replace(bounds, acceleration_m_s2=bounds.acceleration_m_s2 + beside)


def tumbling(body: Body, speed: float) -> float:
    """What a believed rotation does beside that of a steady spin at its mean rate about z.

    That is what runtime assurance and the hybrid's reach know of it.

    Args:
      body: as believed. speed: limit per axis in m/s.

    Returns:
      The greatest acceleration along an axis in m/s^2, by Coriolis, centrifugal and Euler force, up
      to where errors of the rotation are bounded. 0 of a body that spins steadily about z.
    """
    if body.spin.about_z:
        return 0.0
    times = body.times_of_turns
    rates = body.spin.angular_velocity(times)
    change = float(np.linalg.norm(body.spin.angular_acceleration(times), axis=1).max())
    size = float(np.linalg.norm(rates, axis=1).max())
    error = float(np.linalg.norm(rates - [0.0, 0.0, body.spin_about_z], axis=1).max())
    far = _farthest(body)
    rotation = 2.0 * error * math.sqrt(3.0) * speed + 2.0 * size * error * far + change * far
    return _GAPS * rotation


def _farthest(body: Body) -> float:
    """The distance in m up to which errors are bounded."""
    return 2.0 * float(body.keep_out_semi_axes.max())


def with_bounds(dispersions: Dispersions) -> AssuranceConfig | None:
    """Gives a scenario's runtime assurance with bounds that are values.

    It warns of what scenario and dispersions declare beyond them.

    Raises:
      InputError: see `uncertainty_set`.
    """
    assurance = dispersions.scenario.assurance
    if assurance is None:
        return None
    bounds = _bounds(assurance, dispersions)
    # Unless it was drawn before.
    if assurance.bounds is not None and not dispersions.scenario.dispersed:
        _warn_of_exceeded(bounds, dispersions)
    return dc.replace(assurance, bounds=bounds)


def described_bounds(scenario: Scenario) -> str:
    """Says for which errors a scenario's runtime assurance keeps out; "" without it."""
    assurance = scenario.assurance
    if assurance is None:
        return ""
    if not isinstance(assurance.bounds, AssuranceBounds):
        return assurance.bounds or "what the scenario declares"
    found = [values_in_words(assurance.bounds)]
    if isinstance(scenario.navigation, LidarNavigationConfig) and assurance.deviations:
        found.append(f"{assurance.deviations:g}σ of the navigation")
    return ", ".join(filter(None, found)) or "no errors"


def _bounds(assurance: AssuranceConfig, dispersions: Dispersions) -> AssuranceBounds:
    """Gives the bounds of runtime assurance: given, named, or what the scenario declares."""
    if assurance.bounds is None:
        return _declared(dispersions)
    if isinstance(assurance.bounds, str):
        return _named(assurance.bounds, dispersions.scenario, dispersions.body)
    return assurance.bounds


def _named(name: str, scenario: Scenario, body: Body) -> AssuranceBounds:
    """Reads bounds: their values in a YAML file, or dispersions."""
    if is_yaml_path(name):
        tree = read_mapping(Path(name))
        if not any("." in key for key in tree) and BASE not in tree:
            bounds = load_typed(AssuranceBounds, tree, name)
            check_limits(bounds, name)
            return bounds
    try:
        return _of_dispersions(Dispersions.of(scenario, body, name))
    except InputError as error:
        raise InputError(f"assurance.bounds: {error}") from error


def _warn_of_exceeded(bounds: AssuranceBounds, dispersions: Dispersions) -> None:
    beyond = []
    try:
        declared = _declared(dispersions)
    except InputError as error:
        beyond.append(str(error))
    else:
        for field in dc.fields(bounds):
            most, bound = getattr(declared, field.name), getattr(bounds, field.name)
            if most > bound * (1.0 + 1e-9):
                told = f"declared up to {most:.3g}, assurance.bounds say {bound:.3g}"
                beyond.append(f"{field.name}: {told}")
    if beyond:
        own, given = _own_values(dispersions), dispersions.scenario.assurance
        surveyed = given is not None and str(given.bounds).endswith("expected.yaml")
        usual = " (surface_m often does after a survey: docs/method/mapping.md)" if surveyed else ""
        sources = [dispersions.scenario.dispersions, "the scenario" if own else None]
        warnings.warn(
            f"{' and '.join(filter(None, sources))} may exceed assurance.bounds, so runtime "
            f"assurance does not promise to keep out: {'; '.join(beyond)}{usual}",
            stacklevel=2,
        )


def _declared(dispersions: Dispersions) -> AssuranceBounds:
    """Gives the bounds for the worlds that a scenario and its dispersions declare."""
    own = [
        Dispersion(key, Choice(tuple(value) if isinstance(value, list) else (value,)))
        for key, value in _own_values(dispersions).items()
    ]
    return _of_dispersions(dc.replace(dispersions, each=[*dispersions.each, *own]))


def _of_dispersions(dispersions: Dispersions) -> AssuranceBounds:
    """Gives bounds for the worlds of dispersions.

    They are the ends of what is drawn, four deviations of what has no end, and samples for gravity.
    Errors of position and velocity are not among them: they are the navigation's to tell.

    Raises:
      InputError: a value has no end, or it cannot be bounded.
    """
    error, scenario, body = dispersions.greatest_error, dispersions.scenario, dispersions.body
    for key in dispersions.keys:
        if key == _DISTURBANCE:
            if most := error(key):
                raise InputError(
                    f"{key} adds up to {most:g} times the command, which assurance.bounds cannot "
                    "hold: fly without runtime assurance, or give bounds without it, such as "
                    "assurance.bounds={}, and know that flights may enter the ellipsoid"
                )
        elif QUANTITY[key].bounds is None:
            raise InputError(
                f"{key} has no end that assurance.bounds could hold; give bounds without it, "
                "such as assurance.bounds={}, and know that flights with it may enter the ellipsoid"
            )
    gap, differing, shift = _mesh_differences(dispersions)
    velocity_change = _SPEEDS * scenario.spacecraft.speed_limit_m_s
    bounds = AssuranceBounds(
        gravity=error("truth.gravity"),
        thrust=error("truth.thrusters.scale")
        + _DEVIATIONS * error("truth.rigid_body.thruster_scale_std"),
        thrust_direction_deg=_direction(dispersions),
        mass=_mass(
            error("truth.mass"), dispersions.ends("truth.specific_impulse_s"), velocity_change
        ),
        acceleration_m_s2=_acceleration(dispersions, differing, shift),
        surface_m=gap
        + _ROUGHNESS * error("truth.surface_rms_m")
        + HEIGHT * error("truth.boulders.widest_m")
        + 0.5 * float(body.shape.extents.max()) * error("truth.size"),
    )
    check_limits(bounds, dispersions.name or "the scenario's world")
    # What is left of the mass is now known to be above 0.
    least, far = (1.0 - bounds.mass) * scenario.spacecraft.mass_kg, _farthest(body)
    moons, sun = greatest_from_sky(scenario, body, least, far)
    if moons == math.inf:
        raise InputError(
            f"a moon of {body.config.name} comes within {far:g} m of it and is not always inside "
            "the keep-out ellipsoid, which alone runtime assurance keeps out of: give the body an "
            "ellipsoid that holds its orbit, or fly without assurance"
        )
    # Nobody on board is told where they are.
    bounds.acceleration_m_s2 += moons
    bounds.acceleration_m_s2 += sun
    return bounds


def _own_values(dispersions: Dispersions) -> dict[str, typing.Any]:
    """What a scenario itself says of its world, by key: what differs from what is believed.

    Values that are drawn, or were, are not among its own.
    """
    scenario = dispersions.scenario
    drawn = {*scenario.dispersed, *dispersions.keys}
    drawn_sections = {key.partition(".")[0] for key in drawn}  # The draw makes them.
    values = differing_values(scenario)
    for each in QUANTITIES:
        section = each.key.partition(".")[0]
        if section == "truth" or each.known:
            continue
        if section in drawn_sections or getattr(scenario, section) is not None:
            values[each.key] = value_at(scenario, each.key)
    return {key: value for key, value in values.items() if key not in drawn}


def _direction(dispersions: Dispersions) -> float:
    """The greatest angle in degrees between the commanded force and the one that acts.

    A navigation measures how the axes have turned against the body, so that pole, spin and phase
    leave no error; what it does not know of them is taken to be no more than the star tracker's
    error.
    """
    end, scenario = dispersions.greatest_error, dispersions.scenario
    axes = end("truth.thrusters.direction_deg") + end("truth.attitude.constant_deg")
    axes += _DEVIATIONS * end("truth.attitude.varying_std_deg")
    axes += _DEVIATIONS * end("truth.rigid_body.thruster_direction_std_deg")
    angle = math.sqrt(3.0) * axes
    if isinstance(craft := scenario.spacecraft, RigidBodyConfig):
        tracker = load_spacecraft(craft.model).config.star_tracker
        angle += math.sqrt(3.0) * _DEVIATIONS * tracker.noise_deg
        if craft.pointing.mode != "hold":
            # A pulse goes where S has been turned to at its end.
            angle += craft.pointing.slew_deg_s * scenario.attitude_period_s
    if isinstance(scenario.navigation, LidarNavigationConfig):
        return angle
    longest = scenario.arrival.deadline_s + scenario.arrival.dwell_s
    turned = math.degrees(abs(dispersions.body.spin_rate) * longest * end("truth.spin"))
    # Rotations about two axes that differ by an angle differ by at most twice this angle.
    pole = 2.0 * math.sqrt(2.0) * end("truth.pole_deg")
    return angle + end("truth.phase_deg") + pole + turned


def _mass(error: float, impulses: tuple[float, float] | None, velocity_change: float) -> float:
    """The greatest error of the mass, over it, after as much propellant as a flight may burn."""
    left = 1.0
    if impulses is not None:
        left = math.exp(-velocity_change / (STANDARD_GRAVITY * min(impulses)))
    return max(error, 1.0 - (1.0 - error) * left)


def _acceleration(dispersions: Dispersions, differing: float, moved: float) -> float:
    """The greatest acceleration in m/s^2 along an axis, but for gravity's size, thrust and sky.

    `differing` and `moved` are of the true meshes: see `_mesh_differences`.
    """
    end, body = dispersions.greatest_error, dispersions.body
    craft, period = dispersions.scenario.spacecraft, dispersions.scenario.control_period_s
    forces = end("truth.thrusters.least_impulse_n_s") / period
    forces += 0.5 * end("truth.thrusters.quantum_n") + _DEVIATIONS * end("force_noise.std_n")
    if isinstance(craft, RigidBodyConfig):
        layout = load_spacecraft(craft.model).thrusters
        # Each may owe a pulse that is too short to be given.
        along = np.abs(layout.directions) * layout.forces[:, None]
        forces += float(along.sum(axis=0).max()) * layout.least_on_time / period
    pushes = end("truth.acceleration.constant_m_s2")
    pushes += _DEVIATIONS * end("truth.acceleration.varying_std_m_s2")
    pushes += _DEVIATIONS * end("kicks.velocity_std_m_s") / period
    correlation = end("truth.surface_correlation_m") or TruthConfig().surface_correlation_m
    gravity, shift = _gravity_differences(
        body.shape,
        body.gravity_field.mass,
        tuple(body.keep_out_semi_axes.tolist()),
        end("truth.density_contrast"),
        end("truth.surface_rms_m"),
        correlation,
        end("truth.size"),
    )
    gravity, shift = gravity + differing, shift + moved
    gravity *= 1.0 + end("truth.gravity")
    spin = abs(body.spin_rate)
    error = spin * (end("truth.spin") + math.radians(math.sqrt(2.0) * end("truth.pole_deg")))
    far = _farthest(body)
    speed = math.sqrt(3.0) * craft.speed_limit_m_s
    rotation = 2.0 * error * speed + (2.0 * spin + error) * error * far + spin**2 * shift
    return forces / craft.mass_kg + pushes + gravity + rotation


def _mesh_differences(dispersions: Dispersions) -> tuple[float, float, float]:
    """How far true meshes are from the map in m, and how their gravity and centre of mass differ.

    The latter as `_gravity_differences` gives them, for the meshes themselves.
    """
    truth, body = dispersions.scenario.truth, dispersions.body
    axes = tuple(body.keep_out_semi_axes.tolist())
    found = [(0.0, 0.0, 0.0)]
    units = dispersions.values_of("truth.mesh_unit") or [truth.mesh_unit]
    any_size = any(dispersions.values_of("truth.mesh_of_any_size")) or truth.mesh_of_any_size
    for mesh, unit in itertools.product(dispersions.values_of("truth.mesh"), units):
        if mesh is not None:
            other = TruthConfig(mesh=mesh, mesh_unit=unit, mesh_of_any_size=any_size)
            shape = true_shape(body, other)
            found.append(_mesh_difference(body.shape, body.gravity_field.mass, axes, shape))
    gap, gravity, shift = np.max(found, axis=0).tolist()
    return gap, gravity, shift


@functools.lru_cache(maxsize=4)
def _mesh_difference(
    believed: Polyhedron, mass: float, semi_axes: tuple[float, float, float], true: Polyhedron
) -> tuple[float, float, float]:
    own, other = GravityField(believed, mass=mass), GravityField(true, mass=mass)
    return greatest_gap(true, believed), *_differences(own, semi_axes, [other])


@functools.lru_cache(maxsize=4)
def _gravity_differences(
    shape: Polyhedron,
    mass: float,
    semi_axes: tuple[float, float, float],
    contrast: float,
    rms: float,
    correlation: float,
    size: float,
) -> tuple[float, float]:
    """How gravity differs along an axis, at the same mass, and how far the centre of mass moves.

    In m/s^2, the greatest on the keep-out ellipsoid in some worlds at the ends of all that is
    dispersed; and in m.
    """
    if contrast == rms == size == 0.0:
        return 0.0, 0.0
    fields = []
    for seed in range(_WORLDS):
        # All four pairs of ends.
        denser, larger = 1.0 - 2.0 * (seed % 2), 1.0 - 2.0 * (seed // 2 % 2)
        fields.append(
            _rough_field(
                shape, mass, denser * contrast, 1.0 + larger * size, (rms, correlation, seed)
            )
        )
    return _differences(GravityField(shape, mass=mass), semi_axes, fields)


def _rough_field(
    shape: Polyhedron,
    mass: float,
    contrast: float,
    size: float,
    rough: tuple[float, float, int],
) -> GravityField:
    """Gravity of a rough surface; where it cannot be cut in two any more, of one less rough."""
    rms, correlation, seed = rough
    for _ in range(_MOST_HALVINGS):
        try:
            surface = roughened(shape, rms, correlation, seed)
            surface = Polyhedron(size * surface.vertices, surface.facets)
            return GravityField(surface, mass=mass, contrast=contrast)
        except InputError:
            rms *= 0.5
    raise InputError(
        f"truth.surface_rms_m is up to {rough[0]:g} m, with which the surface of {shape.name} is "
        "not sound, so its gravity cannot be bounded: give bounds, such as assurance.bounds={}, or "
        "less roughness"
    )


def _differences(
    believed: GravityField, semi_axes: tuple[float, float, float], worlds: list[GravityField]
) -> tuple[float, float]:
    """How gravity in some worlds differs from the believed one: see `_gravity_differences`."""
    places = spread_directions(_PLACES) * semi_axes
    there = believed.evaluate(places).acceleration
    off = [np.abs(field.evaluate(places).acceleration - there).max() for field in worlds]
    shifts = [np.linalg.norm(field.centre_of_mass) for field in worlds]
    return _GAPS * float(max(off)), _GAPS * float(max(shifts))
