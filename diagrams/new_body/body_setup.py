"""Makes the two files of a new body: the body's YAML file and a scenario scaled to the body."""

from __future__ import annotations

import dataclasses as dc
import json

import numpy as np

from proxops.diagrams.new_body.shape_examination import hover_map
from proxops.diagrams.scenario import (
    Body,
    BodyConfig,
    Scenario,
    check_scenario,
    load_body,
    set_value,
    value_at,
)
from proxops.systems.rotation import TorqueFreeSpinConfig

# The keys whose values are in proportion to the body.
_LENGTHS = (
    "lidar.noise_std_m",
    "lidar.max_range_m",
    "mpc.keep_out_margin_m",
    "mpc.weighted.position_error_m",
    "truth.surface_correlation_m",
    "truth.boulders.narrowest_m",
    "transit.cube_m",
    "transit.min_distance_m",
    "transit.max_distance_m",
    "transit.end_clearance_m",
    "arrival.radius_m",
)
_TIMES = (
    "mpc.min_horizon_s",
    "mpc.weighted.horizon_s",
    "arrival.dwell_s",
    "arrival.deadline_s",
    "control_period_s",
)
_SPEEDS = ("spacecraft.speed_limit_m_s", "mpc.weighted.speed_error_m_s", "arrival.speed_m_s")
_ACCELERATIONS = ("mpc.nominal_acceleration_m_s2",)
_FORCES = ("hybrid.epsilon_magnitude_n", "hybrid.dead_band_n")


def body_yaml(config: BodyConfig, remark: str) -> str:
    """Gives the text of a body's YAML file; it begins with a remark of one line as a comment."""
    axes = ", ".join(map(_number, config.keep_out_semi_axes_m))
    tumbles = isinstance(config.rotation, TorqueFreeSpinConfig)
    rows = [
        f"# {remark}",
        f"name: {json.dumps(config.name, ensure_ascii=False)}",
        f"mesh: {json.dumps(config.mesh, ensure_ascii=False)}  # relative to this file",
        f"mesh_unit: {config.mesh_unit}",
        f"mass_kg: {_number(config.mass_kg)}",
        f"rotation_period_h: {_number(config.rotation_period_h)}  # about +z",
        *(["rotation: !TorqueFreeSpin {}  # about +z at the start"] if tumbles else []),
        f"keep_out_semi_axes_m: [{axes}]  # along x, y, z, about the centre of mass",
        *(["moons:"] if config.moons else []),
        *(f"  - {json.dumps(dc.asdict(moon))}" for moon in config.moons),
    ]
    return "\n".join(rows) + "\n"


def scaled_scenario(body: Body, body_path: str, craft_mass_kg: float = 100.0) -> Scenario:
    """Scales the default scenario, which is Kleopatra's, to another body.

    Lengths are multiplied by the ratio of the keep-out ellipsoids' sizes: the cube root of the
    ratio of their volumes, or the ratio of their longest semi-axes, whichever is greater. Times are
    multiplied by the ratio of sqrt(w^2 + n^2), Kleopatra's over the body's, where w is the spin
    rate and n the rate of a low orbit. Gravity, centrifugal and Coriolis accelerations together
    then have about the same proportion to the thrust as at Kleopatra. If this thrust is too small
    for hovering over the keep-out ellipsoid, it is made larger. The force limits of the hybrid
    scale with the thrust.

    Args:
      body: the body.
      body_path: path of the body's YAML file, as the scenario is to name it.
      craft_mass_kg: mass of the spacecraft.

    Raises:
      InputError: a scaled value is beyond its limits.
    """
    reference, given = load_body("kleopatra"), Scenario()
    volumes = [b.keep_out_semi_axes.prod() for b in (body, reference)]
    lengths = [b.keep_out_semi_axes.max() for b in (body, reference)]
    length = max(np.cbrt(volumes[0] / volumes[1]), lengths[0] / lengths[1])
    time = _rate(reference) / _rate(body)
    clearance = _scaled(given.transit.end_clearance_m, length)
    hover = hover_map(body, craft_mass_kg, grow=clearance).forces.max()
    similar = given.spacecraft.thrust_limit_n / given.spacecraft.mass_kg * (length / time**2)
    thrust = max(craft_mass_kg * similar, hover / given.transit.max_hover_share)
    return scenario_in_proportion(body_path, craft_mass_kg, thrust, length, time)


def scenario_in_proportion(
    body_path: str, craft_mass_kg: float, thrust_n: float, length: float, time: float
) -> Scenario:
    """Multiplies the lengths, times and forces of the default scenario; rounds to two digits.

    Args:
      body_path: path of the body's YAML file, as the scenario is to name it.
      craft_mass_kg: mass of the spacecraft.
      thrust_n: its thrust limit; the force limits of the hybrid are in proportion to it.
      length: factor of all lengths.
      time: factor of all times; those of speeds and accelerations follow.

    Raises:
      InputError: a value is beyond its limits.
    """
    scenario = Scenario(body=body_path)
    force = thrust_n / value_at(scenario, "spacecraft.thrust_limit_n")
    for keys, factor in (
        (_LENGTHS, length),
        (_TIMES, time),
        (_SPEEDS, length / time),
        (_ACCELERATIONS, length / time**2),
        (_FORCES, force),
    ):
        for key in keys:
            set_value(scenario, key, _scaled(value_at(scenario, key), factor))
    set_value(scenario, "spacecraft.mass_kg", craft_mass_kg)
    set_value(scenario, "spacecraft.thrust_limit_n", _scaled(thrust_n, 1.0))
    check_scenario(scenario)
    return scenario


def _scaled(value: float, factor: float) -> float:
    return float(f"{value * factor:.2g}")


def _rate(body: Body) -> float:
    """Gives sqrt(w^2 + n^2) in rad/s: w is the spin rate, n the rate of a low circular orbit.

    The orbit's radius is the keep-out ellipsoid's semi-axis along x.
    """
    field = body.gravity_field
    orbit = field.evaluate(np.diag(body.keep_out_semi_axes)[:1]).potential[0]
    return float(np.hypot(body.spin_rate, np.sqrt(orbit) / body.keep_out_semi_axes[0]))


def _number(value: float) -> str:
    """Writes a number so that YAML 1.1 reads a number: with a decimal point."""
    text = repr(float(value))
    return text if "." in text else text.replace("e", ".0e")
