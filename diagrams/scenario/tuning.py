"""Filter tuning: one standard deviation of all that navigation or a survey may be wrong about.

It is as the scenario gives it, else as the dispersions say, else the usual, in proportion to the
body.
"""

from __future__ import annotations

import copy
import dataclasses as dc
import functools
import math
import typing

import numpy as np

from proxops.diagrams.scenario.body import Body
from proxops.diagrams.scenario.dispersions import Dispersions
from proxops.diagrams.scenario.keys import set_value
from proxops.diagrams.scenario.quantities import QUANTITIES
from proxops.diagrams.scenario.scenario_config import Scenario, TruthConfig
from proxops.diagrams.scenario.sky import greatest_from_sky
from proxops.diagrams.scenario.spacecraft_model import RigidBodyConfig, load_spacecraft
from proxops.systems.attitude import settled_noise
from proxops.systems.common import LONG, InputError, limits_of
from proxops.systems.gravity import GRAVITATIONAL_CONSTANT, GravityField
from proxops.systems.navigation import ExpectedErrors, LidarNavigationConfig, shift_of_centre
from proxops.systems.shapes import Polyhedron, relief_of
from proxops.systems.vehicle import STANDARD_GRAVITY

if typing.TYPE_CHECKING:
    from proxops.systems.mapping import Expected

# The default of surface_correlation_m is for this greatest extent in m, Kleopatra's.
_SIZE = 218.864e3
# The disturbance along each axis is about this share of the thrust limit, for each unit of its
# greatest relative size: the MPC commands a seventh of the limit in the mean.
_USUAL_COMMAND = 0.05
# Dispersions draw the roughness of the surface itself, so the filter is tuned to this multiple of
# its root mean square, which no world exceeds. A surface that is rougher than declared makes the
# filter overconfident; a smoother one costs little.
_ROUGHER = 3.0
# Sections whose dispersed values are taken as they are, not as errors.
_AS_DISPERSED = ("disturbance.", "force_noise.", "kicks.", "truth.boulders.")
# Of what is not dispersed, a survey still expects so much.
_LEAST = {
    "truth.gravity": 1e-2,
    "truth.pole_deg": 0.1,
    "truth.spin": 1e-6,
    "truth.attitude.constant_deg": 1e-3,
    "truth.attitude.varying_std_deg": 1e-4,
}


def filter_tuning(scenario: Scenario, body: Body) -> ExpectedErrors:
    """Gives the filter tuning of a scenario's navigation (1σ).

    They are those of `navigation.expected`. Where that is null, they are the usual ones. The
    error of the surface adds to that of the centre of mass, which it moves.

    Raises:
      InputError: the scenario has no lidar navigation.
    """
    settings = scenario.navigation
    if not isinstance(settings, LidarNavigationConfig):
        raise InputError("a scenario with navigation: !TrueState expects no errors of navigation")
    given = settings.expected or expected_errors(Dispersions(scenario, body))
    if given.surface_rms_m <= 0.0:
        return given
    shift = shift_of_centre(body.shape, given.surface_rms_m, given.surface_correlation_m)
    return dc.replace(given, centre_of_mass_m=math.hypot(given.centre_of_mass_m, shift))


def expected_of(scenario: Scenario, body: Body, dispersions: str) -> ExpectedErrors:
    """Gives one standard deviation of what a file of dispersions, or those of a name, disperse."""
    return expected_errors(Dispersions.of(scenario, body, dispersions))


def expected_errors(dispersions: Dispersions) -> ExpectedErrors:
    """Gives one standard deviation of all that dispersions disperse, and the usual of the rest.

    What disturbs the command or pushes the spacecraft is an acceleration that varies.

    Raises:
      InputError: errors are greater than the navigation can expect.
    """
    scenario, body, usual = dispersions.scenario, dispersions.body, ExpectedErrors()
    errors = ExpectedErrors()
    errors.surface_correlation_m *= float(body.shape.extents.max()) / _SIZE
    for name in {each.tunes: None for each in QUANTITIES if each.tunes}:
        found = [dispersions.rms(each.key) for each in QUANTITIES if each.tunes == name]
        found = [deviation for deviation in found if deviation is not None]
        if found:  # Independent errors add as squares.
            setattr(errors, name, math.hypot(*found))
    # Most worlds have a smoother surface, but some one that is nearly as rough.
    errors.surface_rms_m *= _ROUGHER
    world = _expected_world(dispersions)
    relief = relief_of(world.truth.boulders, body.shape)
    if any(relief):
        errors.relief_rms_m, errors.relief_correlation_m = relief
    craft = scenario.spacecraft
    if not (isinstance(craft, RigidBodyConfig) and errors.attitude_deg):
        # It is estimated in flight, so a generous value costs little. But near a body that is as
        # round as a top, it is the star tracker that tells where the spacecraft is.
        errors.attitude_deg = max(errors.attitude_deg, usual.attitude_deg)
    # A specific impulse that the scenario gives is told, too, because engines are known.
    impulse = dispersions.rms("truth.specific_impulse_s") or scenario.true_specific_impulse_s
    if impulse is not None:
        errors.propellant_s_per_m = 1.0 / (STANDARD_GRAVITY * impulse)
    if isinstance(craft, RigidBodyConfig):
        errors.least_impulse_n_s = 0.0  # Its thrusters owe what is too little.
        noise = load_spacecraft(craft.model).noise
        std, alike = settled_noise(noise, scenario.attitude_period_s, scenario.attitude_steps)
        errors.attitude_noise_deg = math.degrees(std)
        errors.attitude_noise_correlation_s = alike
        if craft.pointing.mode != "hold":
            # What is constant along S varies along K, where it is estimated.
            across = math.radians(errors.thrust_direction_deg)
            errors.thrust_varying = math.hypot(errors.thrust, across)
        # Which thrusters push changes; what they have in common on the whole remains.
        own = errors.thruster_direction_deg
        errors.thrust = math.hypot(errors.thrust, errors.thruster, math.radians(own))
        errors.thrust_direction_deg = math.hypot(errors.thrust_direction_deg, own)
    contrast = dispersions.rms("truth.density_contrast")
    if contrast is not None:
        errors.centre_of_mass_m = _shift(body.shape, body.gravity_field.mass, contrast)
    _add_disturbances(errors, world, body)
    return _within_limits(errors)


def _expected_world(dispersions: Dispersions) -> Scenario:
    """The scenario as believed, with disturbances and boulders as large as they are dispersed."""
    world = copy.deepcopy(dispersions.scenario)
    world.truth = TruthConfig()
    for key in dispersions.keys:
        rms = dispersions.rms(key)
        if key.startswith(_AS_DISPERSED) and rms is not None:
            set_value(world, key, rms)
    return world


def _add_disturbances(errors: ExpectedErrors, world: Scenario, body: Body) -> None:
    """Adds disturbance, force noise, kicks and sunlight to the acceleration that varies, in place.

    Each is taken as a Gauss-Markov process, and their sum as one with the same variance and the
    same effect on the velocity over long times.
    """
    craft, period = world.spacecraft, world.control_period_s
    noise, walk, kicks = world.force_noise, world.disturbance, world.kicks
    parts = [(errors.acceleration_varying_m_s2, errors.acceleration_correlation_s)]
    if noise is not None:
        parts.append((noise.std_n / craft.mass_kg, max(noise.correlation_time_s, 0.5 * period)))
    if walk is not None:
        force = walk.max_relative_magnitude * _USUAL_COMMAND * craft.thrust_limit_n
        parts.append((force / craft.mass_kg, 0.5 * walk.reset_period_s))
    if kicks is not None:
        pushes = kicks.velocity_std_m_s / math.sqrt(kicks.mean_interval_s * period)
        parts.append((pushes, 0.5 * period))
    # In K the Sun and moons go round with the spin: what is constant there would be trusted.
    far, turn = float(body.keep_out_semi_axes.max()), min(1.0 / body.spin_rate, LONG)
    pushes_of_sky = greatest_from_sky(world, body, craft.mass_kg, far)
    parts += [(push, turn) for push in pushes_of_sky if push > 0.0]
    variance = sum(std**2 for std, _ in parts)
    if len(parts) > 1 and variance > 0.0:
        errors.acceleration_varying_m_s2 = math.sqrt(variance)
        errors.acceleration_correlation_s = sum(std**2 * time for std, time in parts) / variance


def survey_errors(scenario: Scenario, body: Body) -> Expected:
    """Gives one standard deviation of what a survey may be wrong about: see `Expected`."""
    from proxops.systems.mapping import Expected  # Slow to import, and few flights are surveys.

    dispersions = Dispersions.of(scenario, body)

    def rms(key: str) -> float:
        return max(dispersions.rms(key) or 0.0, _LEAST.get(key, 0.0))

    usual = Expected()
    gm, radius = body.gravity_field.mass * GRAVITATIONAL_CONSTANT, float(body.shape.extents.max())
    times = dispersions.ends("truth.acceleration.correlation_time_s")
    turning = dispersions.ends("truth.attitude.correlation_time_s")
    return Expected(
        gravity=rms("truth.gravity"),
        pole=math.radians(rms("truth.pole_deg")),
        rate=rms("truth.spin"),
        mounting=math.radians(rms("truth.attitude.constant_deg")),
        turning=math.radians(rms("truth.attitude.varying_std_deg")),
        turning_time=turning[1] if turning else usual.turning_time,
        noise=scenario.lidar.noise_std_m,
        bias=rms("truth.lidar.bias_m"),
        scale=rms("truth.lidar.scale_error"),
        beam=0.5 * rms("truth.lidar.beam_width_rad"),
        acceleration=rms("truth.acceleration.constant_m_s2"),
        # A path of a few knots is never more exact than this share of gravity.
        varying=math.hypot(rms("truth.acceleration.varying_std_m_s2"), 1e-4 * gm / radius**2),
        varying_time=times[1] if times else usual.varying_time,
        thrust=math.hypot(
            rms("truth.thrusters.scale"), math.radians(rms("truth.thrusters.direction_deg")), 1e-2
        ),
        # A rigid spacecraft's thrusters owe what is too little.
        least_impulse=0.0 if scenario.is_rigid else rms("truth.thrusters.least_impulse_n_s"),
    )


@functools.lru_cache(maxsize=4)
def _shift(shape: Polyhedron, mass: float, contrast: float) -> float:
    """How far in m a contrast in density moves the centre of mass; see `GravityField`."""
    return float(np.linalg.norm(GravityField(shape, mass=mass, contrast=contrast).centre_of_mass))


def _within_limits(errors: ExpectedErrors) -> ExpectedErrors:
    """Raises what is below its limit to it.

    Raises:
      InputError: a value is above its limit: with less, the filter would be overconfident.
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
