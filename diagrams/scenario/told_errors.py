"""What the navigation takes its errors to be: as given, as the dispersions say, or the usual."""

from __future__ import annotations

import dataclasses as dc
import functools
import math
from collections.abc import Callable
from typing import TypeVar

import numpy as np

from proxops.diagrams.scenario.body import Body
from proxops.diagrams.scenario.quantities import QUANTITIES
from proxops.diagrams.scenario.scenario_config import Scenario
from proxops.systems.common import InputError, limits_of
from proxops.systems.gravity import GravityField
from proxops.systems.navigation import (
    ExpectedErrors,
    ExpectedErrorsConfig,
    LidarNavigationConfig,
    shift_of_centre,
)
from proxops.systems.shapes import Polyhedron
from proxops.systems.vehicle import (
    STANDARD_GRAVITY,
    ForceNoiseConfig,
    KicksConfig,
    RandomWalkDisturbanceConfig,
)

Spread = Callable[[str], float | None]
"""Gives the root mean square of the error of a dispersed value (see `Quantity.about`), from its
key; None if the value is not dispersed. It must not depend on a draw."""

_Section = TypeVar("_Section", ForceNoiseConfig, KicksConfig, RandomWalkDisturbanceConfig)

# The default of surface_correlation_m is for this greatest extent in m, Kleopatra's.
_SIZE = 218.864e3
# The disturbance along each axis is about this share of the thrust limit, for each unit of its
# greatest relative size: the MPC commands a seventh of the limit in the mean.
_USUAL_COMMAND = 0.05
# Dispersions disperse the roughness of the surface itself. What is told is so many times its root
# mean square: all worlds keep within the third multiple. A surface that is rougher than the
# navigation expects makes it too sure of itself; one that is smoother costs it little.
_ROUGHER = 3.0


def expected_errors(scenario: Scenario, body: Body) -> ExpectedErrors:
    """Gives what the navigation of a scenario takes its errors to be.

    They are those of `navigation.expected`. Where that is null, they are the usual ones. The
    error of the surface adds to that of the centre of mass, which it moves.

    Raises:
      InputError: the scenario has no lidar navigation.
    """
    settings = scenario.navigation
    if not isinstance(settings, LidarNavigationConfig):
        raise InputError("a scenario with navigation: !TrueState expects no errors of navigation")
    given = settings.expected or usual_errors(scenario, body)
    shift = 0.0
    if given.surface_rms_m > 0.0:
        shift = shift_of_centre(body.shape, given.surface_rms_m, given.surface_correlation_m)
    return ExpectedErrors(
        attitude=math.radians(given.attitude_deg),
        attitude_varying=math.radians(given.attitude_varying_deg),
        attitude_correlation=given.attitude_correlation_s,
        pole=math.radians(given.pole_deg),
        spin=given.spin,
        gravity=given.gravity,
        centre_of_mass=math.hypot(given.centre_of_mass_m, shift),
        thrust=given.thrust,
        propellant=given.propellant_s_per_m,
        thrust_direction=math.radians(given.thrust_direction_deg),
        acceleration=given.acceleration_m_s2,
        acceleration_varying=given.acceleration_varying_m_s2,
        acceleration_correlation=given.acceleration_correlation_s,
        surface=given.surface_rms_m,
        surface_correlation=given.surface_correlation_m,
        size=given.size,
        lidar_bias=given.lidar_bias_m,
        lidar_scale=given.lidar_scale,
        beam_width=given.beam_width_rad,
    )


def usual_errors(scenario: Scenario, body: Body) -> ExpectedErrorsConfig:
    """Gives the defaults, lengths in proportion to the body's size.

    What disturbs the command or pushes the spacecraft, if the scenario has it, is an acceleration
    that varies.
    """
    usual = _in_proportion(body)
    _add_disturbances(usual, scenario, lambda key: None)
    return _within_limits(usual)


def errors_of_dispersions(spread: Spread, scenario: Scenario, body: Body) -> ExpectedErrorsConfig:
    """Gives one standard deviation of all that dispersions disperse, and the usual of the rest.

    Args:
      spread: of the dispersed values.
      scenario: the scenario before the draw. A specific impulse that it gives is told, too, because
        engines are known.
      body: the body as believed.

    Raises:
      InputError: errors are greater than the navigation can expect.
    """
    errors, usual = _in_proportion(body), ExpectedErrorsConfig()
    impulse = spread("truth.specific_impulse_s") or scenario.truth.specific_impulse_s
    contrast = spread("truth.density_contrast")
    for name in {each.tunes: None for each in QUANTITIES if each.tunes}:
        found = [spread(each.key) for each in QUANTITIES if each.tunes == name]
        found = [deviation for deviation in found if deviation is not None]
        if found:  # Independent errors add as squares.
            setattr(errors, name, math.hypot(*found))
    # Most worlds have a smoother surface, but some one that is nearly as rough.
    errors.surface_rms_m *= _ROUGHER
    # It is estimated in flight, so a generous value costs little.
    errors.attitude_deg = max(errors.attitude_deg, usual.attitude_deg)
    if impulse is not None:
        errors.propellant_s_per_m = 1.0 / (STANDARD_GRAVITY * impulse)
    if contrast is not None:
        errors.centre_of_mass_m = _shift(body.shape, body.gravity_field.mass, contrast)
    _add_disturbances(errors, scenario, spread)
    return _within_limits(errors)


def _in_proportion(body: Body) -> ExpectedErrorsConfig:
    usual = ExpectedErrorsConfig()
    usual.surface_correlation_m *= float(body.shape.extents.max()) / _SIZE
    return usual


def _add_disturbances(errors: ExpectedErrorsConfig, scenario: Scenario, spread: Spread) -> None:
    """Adds disturbance, force noise and kicks to the acceleration that varies, in place.

    Each is taken as a Gauss-Markov process, and their sum as one with the same variance and the
    same effect on the velocity over long times.
    """
    craft, period = scenario.spacecraft, scenario.control_period_s
    parts = [(errors.acceleration_varying_m_s2, errors.acceleration_correlation_s)]
    noise = _expected_section(scenario, spread, "force_noise", ForceNoiseConfig())
    if noise is not None:
        parts.append((noise.std_n / craft.mass_kg, max(noise.correlation_time_s, 0.5 * period)))
    walk = _expected_section(scenario, spread, "disturbance", RandomWalkDisturbanceConfig())
    if walk is not None:
        force = walk.max_relative_magnitude * _USUAL_COMMAND * craft.thrust_limit_n
        parts.append((force / craft.mass_kg, 0.5 * walk.reset_period_s))
    kicks = _expected_section(scenario, spread, "kicks", KicksConfig())
    if kicks is not None:
        pushes = kicks.velocity_std_m_s / math.sqrt(kicks.mean_interval_s * period)
        parts.append((pushes, 0.5 * period))
    variance = sum(std**2 for std, _ in parts)
    if len(parts) > 1 and variance > 0.0:
        errors.acceleration_varying_m_s2 = math.sqrt(variance)
        errors.acceleration_correlation_s = sum(std**2 * time for std, time in parts) / variance


def _expected_section(
    scenario: Scenario, spread: Spread, name: str, default: _Section
) -> _Section | None:
    """Gives a section of the scenario with what its dispersed values are expected to be."""
    drawn = {field.name: spread(f"{name}.{field.name}") for field in dc.fields(default)}
    drawn = {key: value for key, value in drawn.items() if value is not None}
    section = getattr(scenario, name)
    if section is None and not drawn:
        return None
    return dc.replace(section or default, **drawn)


@functools.lru_cache(maxsize=4)
def _shift(shape: Polyhedron, mass: float, contrast: float) -> float:
    """How far in m a contrast in density moves the centre of mass; see `GravityField`."""
    return float(np.linalg.norm(GravityField(shape, mass=mass, contrast=contrast).centre_of_mass))


def _within_limits(errors: ExpectedErrorsConfig) -> ExpectedErrorsConfig:
    """Raises what is below its limit to it.

    Raises:
      InputError: a value is above its limit: with less, the navigation would be too sure of itself.
    """
    for field in dc.fields(errors):
        low, high = limits_of(field) or (-math.inf, math.inf)
        value = getattr(errors, field.name)
        if value > high:
            raise InputError(
                f"the navigation would have to expect {field.name} of {value:.4g}, and can expect "
                f"at most {high:g}: narrow what the scenario or its dispersions spread, or fly "
                "with navigation: !TrueState {}"
            )
        setattr(errors, field.name, max(value, low))
    return errors
