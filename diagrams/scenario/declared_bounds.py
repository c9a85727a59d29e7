"""What runtime assurance takes as the greatest errors: the ends of what a world may be."""

from __future__ import annotations

import dataclasses as dc
import functools
import math
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from proxops.diagrams.scenario.body import Body
from proxops.diagrams.scenario.quantities import QUANTITY
from proxops.diagrams.scenario.scenario_config import Scenario
from proxops.diagrams.scenario.truth_config import TruthConfig
from proxops.diagrams.scenario.world_differences import differing_values
from proxops.systems.assurance import AssuranceBounds, AssuranceBoundsConfig
from proxops.systems.common import InputError, spread_directions
from proxops.systems.gravity import GravityField
from proxops.systems.navigation import LidarNavigationConfig
from proxops.systems.shapes import Polyhedron, displaced
from proxops.systems.vehicle import (
    STANDARD_GRAVITY,
    ForceNoiseConfig,
    KicksConfig,
    RandomWalkDisturbanceConfig,
)

Reach = Callable[[str], tuple[float, float] | None]
"""Gives the least and the greatest value of a dispersed quantity, from its key; of a list, those of
any of its numbers. None if it is not dispersed. It raises InputError if it has no end."""

# What has a normal distribution at each time, such as a Gauss-Markov process, has no end. It is
# taken to end at so many standard deviations, and the roughness of a surface at its own 3 sigma.
_DEVIATIONS = 4.0
_ROUGHNESS = 3.0
# The velocity change for which propellant is counted, in units of the speed limit. The MPC's
# transits at Kleopatra need up to 5.4.
_SPEEDS = 6.0
# Worlds and places of each in which gravity is compared, and what covers the gaps between them.
_WORLDS, _PLACES, _GAPS = 6, 300, 1.25
# The rotation's errors are bounded up to this distance, in units of the longest semi-axis of the
# keep-out ellipsoid.
_FAR = 2.0
# A surface that is too rough for the mesh is tried with half the roughness, so often.
_MOST_HALVINGS = 6
# Each bound in words, with what it is multiplied by, and the unit.
_WORDS = {
    "gravity": ("gravity", 100.0, " %"),
    "thrust": ("thrust", 100.0, " %"),
    "thrust_direction_deg": ("its direction", 1.0, "°"),
    "mass": ("mass", 100.0, " %"),
    "acceleration_m_s2": ("other acceleration", 1e3, " mm/s²"),
    "position_m": ("position", 1.0, " m"),
    "velocity_m_s": ("velocity", 1.0, " m/s"),
    "surface_m": ("surface", 1e-3, " km"),
    "delay_s": ("delay", 1.0, " s"),
}
# Sections of the world besides `truth`; null, the default, is a world without them.
_SECTIONS = {
    "disturbance": RandomWalkDisturbanceConfig(),
    "force_noise": ForceNoiseConfig(),
    "kicks": KicksConfig(),
}


def bounds_of_dispersions(
    reach: Reach, keys: Iterable[str], scenario: Scenario, body: Body
) -> AssuranceBoundsConfig:
    """Gives bounds for the worlds of dispersions.

    They are the ends of what is drawn, four deviations of what has no end, and samples for gravity.
    Errors of position and velocity are not among them: they are the navigation's to tell.

    Args:
      reach: of the dispersed values.
      keys: the dispersed keys.
      scenario: the scenario before the draw.
      body: the body as believed.

    Raises:
      InputError: a value has no end, or it cannot be bounded.
    """

    def end(key: str) -> float:
        """The greatest error of a quantity."""
        ends, about = reach(key), QUANTITY[key].about
        return 0.0 if ends is None else max(abs(each - about) for each in ends)

    for key in keys:
        if key == "disturbance.max_relative_magnitude":
            _refuse_disturbance(end(key))
        elif QUANTITY[key].bounds is None:
            raise InputError(
                f"{key} has no end that assurance.bounds could hold; give bounds without it, "
                "such as assurance.bounds={}, and know that flights with it may enter the ellipsoid"
            )

    speeds = scenario.spacecraft.speed_limit_m_s
    bounds = AssuranceBoundsConfig(
        gravity=end("truth.gravity"),
        thrust=end("truth.thrusters.scale"),
        thrust_direction_deg=_direction(end, scenario, body),
        mass=_mass(end("truth.mass"), reach("truth.specific_impulse_s"), _SPEEDS * speeds),
        acceleration_m_s2=_acceleration(end, scenario, body),
        surface_m=_ROUGHNESS * end("truth.surface_rms_m")
        + 0.5 * float(body.shape.extents.max()) * end("truth.size"),
    )
    in_si(bounds)  # It refuses what is too great.
    return bounds


def own_values(scenario: Scenario, dispersed: Iterable[str]) -> dict[str, Any]:
    """Gives what a scenario itself says of its world, by key: what differs from what is believed.

    Args:
      scenario: the scenario. Values that were drawn for it are not among its own.
      dispersed: the keys that its dispersions disperse; they are left out.
    """
    drawn = {*scenario.dispersed, *dispersed}
    values = differing_values(scenario)
    for name, default in _SECTIONS.items():
        section = getattr(scenario, name)
        if section is None and any(key.startswith(f"{name}.") for key in drawn):
            section = default  # The draw makes it.
        if section is not None:
            values |= {f"{name}.{key}": value for key, value in dc.asdict(section).items()}
    return {key: value for key, value in values.items() if key not in drawn}


def in_si(bounds: AssuranceBoundsConfig) -> AssuranceBounds:
    """Gives the bounds in SI units.

    Raises:
      InputError: a bound is negative or too great.
    """
    return AssuranceBounds(
        gravity=bounds.gravity,
        thrust=bounds.thrust,
        thrust_direction=math.radians(bounds.thrust_direction_deg),
        mass=bounds.mass,
        acceleration=bounds.acceleration_m_s2,
        position=bounds.position_m,
        velocity=bounds.velocity_m_s,
        surface=bounds.surface_m,
        delay=bounds.delay_s,
    )


def exceeded(declared: AssuranceBoundsConfig, bounds: AssuranceBoundsConfig) -> list[str]:
    """Lists the bounds that what is declared exceeds, each with both values."""
    found = []
    for field in dc.fields(bounds):
        most, bound = getattr(declared, field.name), getattr(bounds, field.name)
        if most > bound * (1.0 + 1e-9):
            found.append(f"{field.name} {bound:.3g} (up to {most:.3g})")
    return found


def described_bounds(scenario: Scenario) -> str:
    """Says in words for which errors a scenario's runtime assurance keeps out; "" without it."""
    assurance = scenario.assurance
    if assurance is None:
        return ""
    if not isinstance(assurance.bounds, AssuranceBoundsConfig):
        return assurance.bounds or "what the scenario declares"
    found = [
        f"{words} {scale * getattr(assurance.bounds, name):.3g}{unit}"
        for name, (words, scale, unit) in _WORDS.items()
        if getattr(assurance.bounds, name)
    ]
    if isinstance(scenario.navigation, LidarNavigationConfig) and assurance.deviations:
        found.append(f"{assurance.deviations:g}σ of the navigation")
    return ", ".join(found) or "no errors"


def _refuse_disturbance(most: float) -> None:
    if most:
        raise InputError(
            f"disturbance.max_relative_magnitude adds up to {most:g} times the command, which "
            "assurance.bounds cannot hold: fly without runtime assurance, or give bounds without "
            "it, such as assurance.bounds={}, and know that flights may enter the ellipsoid"
        )


def _direction(end: Callable[[str], float], scenario: Scenario, body: Body) -> float:
    """The greatest angle in degrees between the commanded force and the one that acts.

    A navigation measures how the axes have turned against the body, so that pole, spin and phase
    leave no error; what it does not know of them is taken to be no more than the star tracker's
    error.
    """
    axes = end("truth.thrusters.direction_deg") + end("truth.attitude.constant_deg")
    axes += _DEVIATIONS * end("truth.attitude.varying_std_deg")
    angle = math.sqrt(3.0) * axes
    if isinstance(scenario.navigation, LidarNavigationConfig):
        return angle
    longest = scenario.arrival.deadline_s + scenario.arrival.dwell_s
    turned = math.degrees(abs(body.spin_rate) * longest * end("truth.spin"))
    # Rotations about two axes that differ by an angle differ by at most twice this angle.
    pole = 2.0 * math.sqrt(2.0) * end("truth.pole_deg")
    return angle + end("truth.phase_deg") + pole + turned


def _mass(error: float, impulses: tuple[float, float] | None, velocity_change: float) -> float:
    """The greatest error of the mass, over it, after as much propellant as a flight may burn."""
    left = 1.0
    if impulses is not None:
        left = math.exp(-velocity_change / (STANDARD_GRAVITY * min(impulses)))
    return max(error, 1.0 - (1.0 - error) * left)


def _acceleration(end: Callable[[str], float], scenario: Scenario, body: Body) -> float:
    """The greatest acceleration in m/s^2 along an axis, other than by gravity's size and thrust."""
    craft, period = scenario.spacecraft, scenario.control_period_s
    forces = end("truth.thrusters.least_impulse_n_s") / period
    forces += 0.5 * end("truth.thrusters.quantum_n") + _DEVIATIONS * end("force_noise.std_n")
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
    gravity *= 1.0 + end("truth.gravity")
    spin = abs(body.spin_rate)
    error = spin * (end("truth.spin") + math.radians(math.sqrt(2.0) * end("truth.pole_deg")))
    far = _FAR * float(body.keep_out_semi_axes.max())
    speed = math.sqrt(3.0) * craft.speed_limit_m_s
    rotation = 2.0 * error * speed + (2.0 * spin + error) * error * far + spin**2 * shift
    return forces / craft.mass_kg + pushes + gravity + rotation


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
    places = spread_directions(_PLACES) * semi_axes
    believed = GravityField(shape, mass=mass).evaluate(places).acceleration
    greatest, shift = 0.0, 0.0
    for seed in range(_WORLDS):
        # All four pairs of ends.
        denser, larger = 1.0 - 2.0 * (seed % 2), 1.0 - 2.0 * (seed // 2 % 2)
        surface = _rough(shape, rms, correlation, seed)
        surface = Polyhedron((1.0 + larger * size) * surface.vertices, surface.facets)
        field = GravityField(surface, mass=mass, contrast=denser * contrast)
        true = field.evaluate(places).acceleration
        greatest = max(greatest, float(np.abs(true - believed).max()))
        shift = max(shift, float(np.linalg.norm(field.centre_of_mass)))
    return _GAPS * greatest, _GAPS * shift


def _rough(shape: Polyhedron, rms: float, correlation: float, seed: int) -> Polyhedron:
    """The roughest surface of a seed that a flight can have: where `rms` is too rough, of less."""
    for halvings in range(_MOST_HALVINGS):
        try:
            return displaced(shape, rms / 2**halvings, correlation, seed)
        except InputError:
            continue
    raise InputError(
        f"truth.surface_rms_m is up to {rms:g} m, with which the surface of {shape.name} is not "
        "sound, so its gravity cannot be bounded: give bounds, such as assurance.bounds={}, or "
        "less roughness"
    )
