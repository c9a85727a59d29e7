"""Makes the systems that a scenario configures: controllers, navigation, backup and lidar."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from pydrake.systems.framework import DiagramBuilder, System
from pydrake.systems.primitives import ConstantVectorSource

from proxops.diagrams.flight.estimate_feedback import EstimateFeedback
from proxops.diagrams.scenario import (
    AssuranceConfig,
    Body,
    LidarConfig,
    LidarNavigationConfig,
    Scenario,
    uncertainty_set,
)
from proxops.systems import (
    AssuranceBounds,
    BackupBraking,
    ErrorWeights,
    ExpectedErrors,
    FlightLimits,
    GuidanceBundle,
    GuidancePolicy,
    Horizon,
    InputError,
    LearnedLidar,
    Lidar,
    LidarFrames,
    LidarNavigation,
    MapError,
    ModelPredictiveController,
    NeuralPolicy,
    PlanarLidar,
    PointMassField,
    Polyhedron,
    ProportionalDerivative,
    Surroundings,
    TransitProgram,
    WeightedProgram,
)
from proxops.systems.common import Vector3
from proxops.systems.gravity import BodyField, Moon
from proxops.systems.lidar import LidarWithMoons
from proxops.systems.navigation import load_map
from proxops.systems.policy import DescentBundle, load_policy
from proxops.systems.rotation import SpinModel
from proxops.systems.vehicle import FlightEvents

# The navigation takes the lidar's noise for at least this share of the body's size, 2 m at
# Kleopatra: its arithmetic begins with a position that is known to a few sizes.
_LEAST_NOISE = 1e-5
# A map whose size differs by more than this share from the body's is a mistake.
_OTHER_SIZE = 0.5
# Margins of a policy for any body, over the MPC's. Alone it cuts corners by a few hundredths of the
# size. In a hybrid the MPC sees to that, and agrees more often if the policy flies no wider.
_ALONE, _CHECKED = 3.0, 1.5


def make_mpc(scenario: Scenario, body: Body) -> ModelPredictiveController:
    """Makes the MPC that the scenario configures."""
    mpc = scenario.mpc
    field = PointMassField(body.gravity_field.mass) if mpc.point_mass else body.gravity_field
    limits = _limits(scenario, body.keep_out_semi_axes + mpc.keep_out_margin_m)
    horizon = Horizon(
        intervals=mpc.intervals,
        interval_growth=mpc.interval_growth,
        nominal_acceleration=mpc.nominal_acceleration_m_s2,
        fuel_weight=mpc.fuel_weight,
        minimum=mpc.min_horizon_s,
    )
    if mpc.cost == "weighted":
        weights = ErrorWeights(mpc.weighted.position_error_m, mpc.weighted.speed_error_m_s)
        horizon = replace(horizon, minimum=mpc.weighted.horizon_s)
        program = WeightedProgram(field, body.spin, limits, horizon, weights)
    else:
        program = TransitProgram(field, body.spin, limits, horizon)
    return ModelPredictiveController(
        program,
        period=scenario.control_period_s,
        cold_iterations=mpc.cold_iterations,
        estimator_gain=mpc.estimator_gain,
        delay=mpc.solve_delay_s,
        latest=_latest(scenario, horizon.minimum),
    )


def make_policy(
    bundle: Path, scenario: Scenario, body: Body, checked: bool = False
) -> NeuralPolicy | GuidancePolicy:
    """Makes the learned policy of a bundle's folder; `checked`: for a hybrid.

    Raises:
      InputError: the bundle does not exist, is damaged, or was made for another body, lidar or
        control period, or for other proportions of body and spacecraft.
    """
    thrust, period = scenario.spacecraft.thrust_limit_n, scenario.control_period_s
    policy = load_policy(bundle)
    if isinstance(policy, DescentBundle):
        raise InputError(f"the policy in {bundle} flies descents: task: !TouchAndGo {{}} has one")
    if isinstance(policy, GuidanceBundle):
        around = surroundings(scenario, body, checked)
        beyond = scenario.policy.beyond_family
        latest = _latest(scenario, scenario.mpc.min_horizon_s)
        return GuidancePolicy(policy, around, thrust, beyond_family=beyond, latest=latest)
    return NeuralPolicy(
        policy, thrust, period, scenario.lidar_geometry, shape_sha256=body.shape.sha256
    )


def _latest(scenario: Scenario, least: float) -> float:
    """When in s motion should have ended that takes a `least` time in s even next to the goal."""
    return max(scenario.arrival.deadline_s - least, least)


def surroundings(scenario: Scenario, body: Body, checked: bool = False) -> Surroundings:
    """Gives what a guidance is told of body and spacecraft, alone or where the MPC checks it."""
    craft, margin = scenario.spacecraft, scenario.policy.margin_m
    if margin is None:
        margin = (_CHECKED if checked else _ALONE) * scenario.mpc.keep_out_margin_m
    return Surroundings(
        field=body.gravity_field,
        mass=body.gravity_field.mass,
        spin=body.spin,
        semi_axes=body.keep_out_semi_axes + margin,
        acceleration=craft.thrust_limit_n / craft.mass_kg,
        speed_limit=craft.speed_limit_m_s,
        period=scenario.control_period_s,
        nominal_acceleration=scenario.mpc.nominal_acceleration_m_s2,
    )


def make_proportional_derivative(scenario: Scenario) -> ProportionalDerivative:
    """Makes the PD controller; its gains follow from mass, limits and control period."""
    craft = scenario.spacecraft
    return ProportionalDerivative(
        craft.mass_kg, craft.thrust_limit_n, craft.speed_limit_m_s, scenario.control_period_s
    )


def make_zero() -> System:
    """Makes the controller whose force is always zero."""
    builder = DiagramBuilder()
    zero = builder.AddNamedSystem("zero", ConstantVectorSource(np.zeros(3)))
    builder.ExportOutput(zero.get_output_port(), "force")
    return builder.Build()


def make_estimate_feedback(
    kind: str, bundle: Path, scenario: Scenario, body: Body
) -> EstimateFeedback:
    """Makes the MPC or the PD controller on the state that a bundle's policy estimates.

    Args:
      kind: `mpc` or `pd`.
      bundle: folder of the bundle.
      scenario: the scenario.
      body: the body.

    Raises:
      InputError: see `make_policy`; or the policy makes no estimate.
    """
    policy = make_policy(bundle, scenario, body)
    if kind == "mpc":
        return EstimateFeedback(policy, make_mpc(scenario, body))
    return EstimateFeedback(policy, make_proportional_derivative(scenario))


def make_backup(scenario: Scenario, body: Body, assurance: AssuranceConfig) -> BackupBraking:
    """Makes the backup braking of runtime assurance for the bounds that it declares.

    Raises:
      InputError: see `uncertainty_set`; or the thrust cannot hold the spacecraft everywhere
        outside the ellipsoid.
    """
    bounds = uncertainty_set(replace(scenario, assurance=assurance), body)
    return bounded_backup(scenario, body, bounds)


def bounded_backup(scenario: Scenario, body: Body, bounds: AssuranceBounds) -> BackupBraking:
    """Makes the backup braking for declared errors.

    Raises:
      InputError: see `BackupBraking`.
    """
    limits, period = _limits(scenario, body.keep_out_semi_axes), scenario.control_period_s
    return BackupBraking(body.exact_field, body.spin_about_z, limits, bounds, period)


def _limits(scenario: Scenario, keep_out_semi_axes: Vector3) -> FlightLimits:
    craft = scenario.spacecraft
    return FlightLimits(
        craft.mass_kg, craft.thrust_limit_n, craft.speed_limit_m_s, keep_out_semi_axes
    )


def make_lidar(
    scenario: Scenario,
    shape: Polyhedron,
    seed: int,
    moons: Sequence[Moon] = (),
    spin: SpinModel | None = None,
) -> PlanarLidar:
    """Makes the true lidar of a scenario.

    Args:
      scenario: the scenario.
      shape: the true surface.
      seed: seed of the lidar's noise.
      moons: those that it sees, unless it is a learned one. spin: the true one, if there are any.

    Raises:
      InputError: the bundle of a learned lidar is damaged, or was made for another body or
        geometry.
    """
    sensor = scenario.lidar
    errors = scenario.truth.lidar.errors(sensor.noise_std_m)
    geometry, period = scenario.lidar_geometry, scenario.control_period_s
    if isinstance(sensor, LidarConfig):
        errors = replace(errors, max_incidence=np.radians(sensor.max_incidence_deg))
        if moons and spin is not None:
            return LidarWithMoons(shape, moons, spin, errors, geometry, period, seed)
        return Lidar(shape, errors, geometry, period, seed)
    return LearnedLidar(
        sensor.bundle,
        errors,
        geometry,
        period,
        seed,
        hit_probability=sensor.hit_probability,
        shape_sha256=shape.sha256,
    )


def make_events(
    scenario: Scenario, body: Body, field: BodyField, spin: SpinModel | None = None
) -> FlightEvents:
    """Makes what follows arrival, violations and collision at a body with a true field.

    `spin` is the true one; None: as believed.
    """
    arrival = scenario.arrival
    return FlightEvents(
        field,
        body.keep_out_semi_axes,
        radius=arrival.radius_m,
        speed=arrival.speed_m_s,
        dwell=arrival.dwell_s,
        moons=body.moons,
        spin=spin or body.spin,
    )


def make_navigation(scenario: Scenario, body: Body, expected: ExpectedErrors) -> LidarNavigation:
    """Makes the navigation that the scenario configures, from map and data sheets alone.

    Args:
      scenario, body: as believed.
      expected: what it may be wrong about: see `World.filter_tuning`.

    Raises:
      InputError: the scenario has no lidar navigation, or its `navigation.map` cannot be used.
    """
    assert isinstance(scenario.navigation, LidarNavigationConfig)
    shape, map_error = _navigation_map(scenario.navigation, body)
    if map_error is not None:
        expected = replace(expected, surface_rms_m=0.0, size=0.0)
    least_noise = _LEAST_NOISE * float(body.shape.extents.max())
    frames = LidarFrames(
        max(scenario.lidar.noise_std_m, least_noise),
        scenario.lidar_geometry,
        scenario.control_period_s,
        scenario.navigation.frame_delay_steps,
    )
    mass = scenario.spacecraft.mass_kg
    return LidarNavigation(shape, body.gravity_field, body.spin, mass, frames, expected, map_error)


def _navigation_map(
    settings: LidarNavigationConfig, body: Body
) -> tuple[Polyhedron, MapError | None]:
    """Gives the map by which the navigation flies, and its error if that is known with it."""
    if settings.map is None:
        return body.shape, None
    shape, map_error = load_map(Path(settings.map), settings.map_unit)
    off = np.abs(shape.vertices.mean(axis=0) - body.shape.vertices.mean(axis=0)).max()
    size = float(body.shape.extents.max())
    ratio = float(shape.extents.max()) / size
    if abs(ratio - 1.0) > _OTHER_SIZE or off > _OTHER_SIZE * size:
        raise InputError(
            f"navigation.map: {settings.map} is {ratio:.3g} times as long as the body, and its "
            f"vertices are {off:.3g} m from the body's in the mean: it must be a map of this body, "
            f"in K; check navigation.map_unit (now {settings.map_unit})"
        )
    return shape, map_error
