"""What the navigation takes its errors to be: as given, as the dispersions say, or the usual."""

from __future__ import annotations

import dataclasses as dc
import functools
import math
from collections.abc import Callable

import numpy as np

from proxops.diagrams.scenario.body import Body
from proxops.diagrams.scenario.limits import limits_of
from proxops.diagrams.scenario.navigation_config import ExpectedErrorsConfig, LidarNavigationConfig
from proxops.diagrams.scenario.scenario_config import Scenario
from proxops.systems.common import InputError
from proxops.systems.gravity import GravityField
from proxops.systems.navigation import ExpectedErrors
from proxops.systems.shapes import Polyhedron
from proxops.systems.vehicle import STANDARD_GRAVITY

Spread = Callable[[str, float], float | None]
"""Gives the root mean square of what a dispersed value differs by from a number, from the value's
key and the number; None if the value is not dispersed. It must not depend on a draw."""

# The defaults of ExpectedErrorsConfig are for this greatest extent in m and this thrust limit over
# mass in m/s^2, those of Kleopatra and of the default spacecraft.
_SIZE, _THRUST_ACCELERATION = 218.864e3, 0.07
# The key of truth behind each expected error that has one, and what is believed of its value.
_KEYS = {
    "attitude_varying_deg": ("truth.attitude.varying_std_deg", 0.0),
    "attitude_correlation_s": ("truth.attitude.correlation_time_s", 0.0),
    "pole_deg": ("truth.pole_deg", 0.0),
    "spin": ("truth.spin", 1.0),
    "gravity": ("truth.gravity", 1.0),
    "thrust_direction_deg": ("truth.thrusters.direction_deg", 0.0),
    "acceleration_m_s2": ("truth.acceleration.constant_m_s2", 0.0),
    "acceleration_varying_m_s2": ("truth.acceleration.varying_std_m_s2", 0.0),
    "acceleration_correlation_s": ("truth.acceleration.correlation_time_s", 0.0),
    "surface_rms_m": ("truth.surface_rms_m", 0.0),
    "surface_correlation_m": ("truth.surface_correlation_m", 0.0),
    "size": ("truth.size", 1.0),
    "lidar_bias_m": ("truth.lidar.bias_m", 0.0),
    "lidar_scale": ("truth.lidar.scale_error", 0.0),
    "beam_width_rad": ("truth.lidar.beam_width_rad", 0.0),
}


def expected_errors(scenario: Scenario, body: Body) -> ExpectedErrors:
    """Gives what the navigation of a scenario takes its errors to be.

    They are those of `navigation.expected`. Where that is null, they are the usual ones.

    Raises:
      InputError: the scenario has no lidar navigation.
    """
    settings = scenario.navigation
    if not isinstance(settings, LidarNavigationConfig):
        raise InputError("a scenario with navigation: !TrueState expects no errors of navigation")
    given = settings.expected or usual_errors(scenario, body)
    return ExpectedErrors(
        attitude=math.radians(given.attitude_deg),
        attitude_varying=math.radians(given.attitude_varying_deg),
        attitude_correlation=given.attitude_correlation_s,
        pole=math.radians(given.pole_deg),
        spin=given.spin,
        gravity=given.gravity,
        centre_of_mass=given.centre_of_mass_m,
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
    """Gives the defaults, lengths and accelerations in proportion to body and spacecraft."""
    usual, craft = ExpectedErrorsConfig(), scenario.spacecraft
    usual.acceleration_m_s2 *= craft.thrust_limit_n / craft.mass_kg / _THRUST_ACCELERATION
    usual.surface_correlation_m *= float(body.shape.extents.max()) / _SIZE
    return _within_limits(usual)


def errors_of_dispersions(spread: Spread, scenario: Scenario, body: Body) -> ExpectedErrorsConfig:
    """Gives one standard deviation of all that dispersions disperse, and the usual of the rest.

    Args:
      spread: of the dispersed values.
      scenario: the scenario before the draw.
      body: the body as believed.
    """
    errors = usual_errors(scenario, body)
    for name, (key, believed) in _KEYS.items():
        found = spread(key, believed)
        if found is not None:
            setattr(errors, name, found)
    # It is estimated in flight, so a generous value costs little.
    turned = _together(spread("truth.attitude.constant_deg", 0.0), spread("truth.phase_deg", 0.0))
    errors.attitude_deg = max(errors.attitude_deg, turned or 0.0)
    thrust = _together(spread("truth.thrusters.scale", 1.0), spread("truth.mass", 1.0))
    errors.thrust = errors.thrust if thrust is None else thrust
    impulse = spread("truth.specific_impulse_s", 0.0) or scenario.truth.specific_impulse_s
    if impulse is not None:
        errors.propellant_s_per_m = 1.0 / (STANDARD_GRAVITY * impulse)
    contrast = spread("truth.density_contrast", 0.0)
    if contrast is not None:
        errors.centre_of_mass_m = _shift(body.shape, body.gravity_field.mass, contrast)
    return _within_limits(errors)


def _together(*parts: float | None) -> float | None:
    """The root of the sum of squares of independent errors; None if there is none."""
    found = [part for part in parts if part is not None]
    return math.hypot(*found) if found else None


@functools.lru_cache(maxsize=4)
def _shift(shape: Polyhedron, mass: float, contrast: float) -> float:
    """How far in m a contrast in density moves the centre of mass; see `GravityField`."""
    return float(np.linalg.norm(GravityField(shape, mass=mass, contrast=contrast).centre_of_mass))


def _within_limits(errors: ExpectedErrorsConfig) -> ExpectedErrorsConfig:
    for field in dc.fields(errors):
        low, high = limits_of(field) or (-math.inf, math.inf)
        setattr(errors, field.name, min(max(getattr(errors, field.name), low), high))
    return errors
