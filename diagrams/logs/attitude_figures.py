"""Figures of merit of the attitude of a rigid spacecraft in one flight."""

from __future__ import annotations

import typing

import numpy as np
import xarray as xr

from proxops.diagrams.scenario import RigidBodyConfig, Scenario, load_spacecraft
from proxops.systems.attitude import TrueRigidBodyConfig, lost_directions, pointing_error
from proxops.systems.common import Values

# The figures leave out the first time (s), in which the centre of mass is not known yet.
_SETTLED = 60.0


def pointing_errors(data: xr.Dataset) -> Values:
    """Gives the angle (N,) in rad of each row, from the attitude that is wanted to the true one."""
    both = data["inertial_attitude"].values, data["reference_attitude"].values
    return np.array([pointing_error(*pair) for pair in zip(*both, strict=True)])


def _found_after(data: xr.Dataset, truth: TrueRigidBodyConfig) -> float | None:
    """Time in s from when a failed thruster is first on until it is found; None: it is not."""
    which, times = truth.failed_thruster, data["time"].values
    if which < 0:
        return None
    found = data["failed_thrusters"].values[:, which] > 0.0
    if not found.any():
        return None
    # A log sees only the last attitude period of each control period.
    asked = found | ((data["on_times"].values[:, which] > 0.0) & (times > truth.failure_time_s))
    return float(times[found.argmax()] - times[asked.argmax()])


def attitude_figures(data: xr.Dataset, scenario: Scenario) -> dict[str, typing.Any]:
    """Computes the figures of a rigid spacecraft's attitude; {} for a point.

    Returns:
      Of the steps after the first 60 s, `pointing_error_deg_median` and `_p99`; `wheel_load`, the
      greatest momentum of a wheel over its limit; `thrusters_failed`, the numbers of those that
      were found to have failed; `failure_found_after_s`, the time from when one that truly gives
      nothing is first on until it is found, to a control period; and
      `lost_directions`, such as ["+x"]: where no force can be given any more without a torque.
    """
    settings = scenario.spacecraft
    if not isinstance(settings, RigidBodyConfig) or "inertial_attitude" not in data:
        return {}
    model = load_spacecraft(settings.model)
    errors = np.degrees(pointing_errors(data))[data["time"].values >= _SETTLED]
    failed = np.flatnonzero(np.nan_to_num(data["failed_thrusters"].values).any(axis=0))
    figures: dict[str, typing.Any] = {"thrusters_failed": failed.tolist()}
    after = _found_after(data, scenario.truth.rigid_body)
    if after is not None:
        figures["failure_found_after_s"] = after
    wrenches = np.delete(model.thrusters.wrenches(), failed, axis=1)
    lost = lost_directions(wrenches) if len(failed) else np.zeros((0, 3))
    figures["lost_directions"] = [
        f"{'+' if axis.sum() > 0.0 else '-'}{'xyz'[int(np.argmax(np.abs(axis)))]}" for axis in lost
    ]
    if errors.size:
        figures["pointing_error_deg_median"] = float(np.median(errors))
        figures["pointing_error_deg_p99"] = float(np.percentile(errors, 99))
    if model.wheels is not None:
        momentum = np.abs(data["wheel_momentum"].values).max()
        figures["wheel_load"] = float(momentum) / model.wheels.momentum
    return figures
