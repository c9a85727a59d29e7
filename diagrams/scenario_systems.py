"""The systems that a scenario configures: the controllers and the lidar."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from proxops.assets import ASSETS
from proxops.diagrams.body import Body
from proxops.diagrams.scenario import AssuranceConfig, LidarConfig, Scenario
from proxops.systems import (
    AssuranceLimits,
    BackupBraking,
    ErrorWeights,
    Horizon,
    InputError,
    LearnedLidar,
    Lidar,
    ModelPredictiveController,
    NeuralPolicy,
    PlanarLidar,
    PointMassField,
    PolicyBundle,
    ProportionalDerivative,
    TransitLimits,
    TransitProgram,
    WeightedProgram,
)

_SHIPPED_POLICY = ASSETS / "policy"


def make_controller(scenario: Scenario, body: Body) -> ModelPredictiveController:
    """The expert, as the scenario configures it."""
    craft, mpc = scenario.spacecraft, scenario.mpc
    field = PointMassField(body.gravity_field.mass) if mpc.point_mass else body.gravity_field
    limits = TransitLimits(
        mass=craft.mass_kg,
        thrust=craft.thrust_limit_n,
        speed=craft.speed_limit_m_s,
        keep_out_semi_axes=body.keep_out_semi_axes + mpc.keep_out_margin_m,
    )
    horizon = Horizon(
        knots=mpc.knots,
        knot_growth=mpc.knot_growth,
        nominal_acceleration=mpc.nominal_acceleration_m_s2,
        fuel_weight=mpc.fuel_weight,
        minimum=mpc.min_horizon_s,
    )
    if mpc.cost == "weighted":
        weights = ErrorWeights(mpc.weighted.position_error_m, mpc.weighted.speed_error_m_s)
        horizon = replace(horizon, minimum=mpc.weighted.horizon_s)
        program = WeightedProgram(field, body.spin_rate, limits, horizon, weights)
    else:
        program = TransitProgram(field, body.spin_rate, limits, horizon)
    return ModelPredictiveController(
        program,
        scenario.control_period_s,
        mpc.cold_iterations,
        mpc.estimator_gain,
        mpc.solve_delay_s,
    )


def load_policy(scenario: Scenario) -> PolicyBundle:
    """The bundle of the policy that the scenario names.

    Raises:
      InputError: there is none, or it is damaged.
    """
    if scenario.policy.bundle is not None:
        return PolicyBundle.load(scenario.policy.bundle)
    if not _SHIPPED_POLICY.is_dir():
        raise InputError(
            "no policy ships with this proxops: make one with proxops train, and name its bundle "
            "with --set policy.bundle=FOLDER"
        )
    return PolicyBundle.load(_SHIPPED_POLICY)


def make_policy(scenario: Scenario, body: Body) -> NeuralPolicy:
    """The learned policy that the scenario names.

    Raises:
      InputError: there is none, it is damaged, or for another body, lidar or control period.
    """
    return NeuralPolicy(
        load_policy(scenario),
        scenario.spacecraft.thrust_limit_n,
        scenario.control_period_s,
        scenario.lidar.planes,
        scenario.lidar.rays,
        shape_sha256=body.shape.sha256,
    )


def make_proportional_derivative(scenario: Scenario) -> ProportionalDerivative:
    """The PD controller, its gains from the scenario's mass, limits and control period."""
    craft = scenario.spacecraft
    return ProportionalDerivative(
        craft.mass_kg, craft.thrust_limit_n, craft.speed_limit_m_s, scenario.control_period_s
    )


def make_backup(scenario: Scenario, body: Body, assurance: AssuranceConfig) -> BackupBraking:
    """The backup braking that an assurance with these settings falls back on.

    Raises:
      InputError: the thrust cannot hold the spacecraft everywhere outside the ellipsoid.
    """
    craft = scenario.spacecraft
    limits = AssuranceLimits(
        mass=craft.mass_kg,
        thrust=craft.thrust_limit_n,
        speed=craft.speed_limit_m_s,
        keep_out_semi_axes=body.keep_out_semi_axes,
        margin=assurance.margin_m,
    )
    return BackupBraking(body.gravity_field, body.spin_rate, limits, scenario.control_period_s)


def make_lidar(scenario: Scenario, body: Body, seed: int) -> PlanarLidar:
    """The lidar that the scenario names, its noise seeded with `seed`.

    Raises:
      InputError: a learned lidar whose bundle is damaged, or for another body or geometry.
    """
    sensor = scenario.lidar
    common = {
        "noise_std": sensor.noise_std_m,
        "max_range": sensor.max_range_m,
        "planes": sensor.planes,
        "rays": sensor.rays,
        "period": scenario.control_period_s,
        "seed": seed,
        "bias": sensor.bias_m,
        "scale_error": sensor.scale_error,
        "dropout": sensor.dropout,
        "false_returns": sensor.false_returns,
    }
    if isinstance(sensor, LidarConfig):
        return Lidar(body.shape, max_incidence=np.radians(sensor.max_incidence_deg), **common)
    return LearnedLidar(
        sensor.bundle,
        hit_probability=sensor.hit_probability,
        shape_sha256=body.shape.sha256,
        **common,
    )
