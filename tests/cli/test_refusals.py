"""Systems and their settings refuse arguments that make no sense, and name them."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from short_flights import kleopatra

from proxops.diagrams.flight import make_mpc
from proxops.diagrams.scenario import Scenario
from proxops.systems import (
    ActualThrust,
    AgreementGate,
    AttitudeError,
    CheckSchedule,
    CommandAxes,
    DelayedHold,
    ExpectedErrors,
    ForceNoise,
    FrameDelay,
    InputError,
    Lidar,
    LidarErrors,
    LidarFrames,
    LidarGeometry,
    LidarNavigation,
    ModelPredictiveController,
    ProportionalDerivative,
    RandomWalkDisturbance,
    Spacecraft,
    SpinKnowledge,
    StateNoise,
    ThrusterErrors,
    UnexplainedAcceleration,
    VelocityKicks,
)
from proxops.systems.vehicle import TrueAttitudeConfig

NAN, INF = math.nan, math.inf


def attitude_error(constant: tuple[float, ...] = (0.0, 0.0, 0.0), **given: Any) -> AttitudeError:
    errors = TrueAttitudeConfig(constant_deg=list(constant))
    return AttitudeError(SpinKnowledge(3e-4, 3e-4), errors, **given)


def force_noise(**given: Any) -> ForceNoise:
    return ForceNoise(**{"thrust_limit": 7.0, **given})


def random_walk(**given: Any) -> RandomWalkDisturbance:
    return RandomWalkDisturbance(**{"thrust_limit": 7.0, **given})


def lidar(**given: Any) -> Lidar:
    return Lidar(kleopatra().shape, **given)


def mpc(**given: Any) -> ModelPredictiveController:
    return ModelPredictiveController(make_mpc(Scenario(), kleopatra()).program, **given)


def mpc_of(program: Any) -> ModelPredictiveController:
    return ModelPredictiveController(program)


def navigation(**given: Any) -> LidarNavigation:
    body = kleopatra()
    own = {key: given.pop(key) for key in LidarFrames._fields if key in given}
    frames = LidarFrames(**{"noise_std": 50.0, **own})
    given = {"spin": body.spin_rate, "mass": 100.0, "frames": frames, **given}
    return LidarNavigation(body.shape, body.gravity_field, **given)


def expecting(**errors: float) -> LidarNavigation:
    return navigation(expected=ExpectedErrors(**errors))


def spacecraft(**given: Any) -> Spacecraft:
    return Spacecraft(**{"mass": 100.0, "spin": 3e-4, **given})


# What makes it, the argument that is named, and values of it that are refused.
REFUSED: list[tuple[Callable[..., Any], str, tuple[Any, ...]]] = [
    (AgreementGate, "magnitude", (-1.0, NAN)),
    (AgreementGate, "dead_band", (INF,)),
    (CheckSchedule, "check_period", (0,)),
    (CheckSchedule, "longest", (0,)),
    (expecting, "gravity", (-0.1,)),
    (expecting, "surface_correlation_m", (0.0,)),
    (expecting, "attitude_deg", (12.0, NAN)),
    (LidarErrors, "noise_std", (-1.0, NAN, 1e22)),
    (LidarErrors, "bias", (NAN, -1e22)),
    (LidarErrors, "scale_error", (-1.0, 1e22)),
    (LidarErrors, "max_incidence", (0.0, 1.6, NAN)),
    (LidarErrors, "dropout", (-0.1, 1.1)),
    (LidarErrors, "false_returns", (-0.1, NAN)),
    (LidarErrors, "frame_loss", (1.1, NAN)),
    (LidarErrors, "beam_width", (-1e-3, 0.2, NAN)),
    (LidarGeometry, "max_range", (0.0, NAN)),
    (LidarGeometry, "planes", (0, 10**22)),
    (StateNoise, "position_std", (-1.0,)),
    (StateNoise, "seed", (-1,)),
    (ThrusterErrors, "scale", ((1.0, 1.0), (1.0, -0.1, 1.0))),
    (ThrusterErrors, "direction", ((0.0, NAN, 0.0),)),
    (ThrusterErrors, "quantum", (INF,)),
    (ThrusterErrors, "failed_axis", (3,)),
    (ThrusterErrors, "failure_time", (-1.0,)),
    (UnexplainedAcceleration, "constant", ((1.0, 2.0), (1.0, NAN, 2.0))),
    (UnexplainedAcceleration, "correlation_time", (INF,)),
    (VelocityKicks, "velocity_std", (-1.0, INF)),
    (VelocityKicks, "mean_interval", (5.0, NAN)),
    (attitude_error, "constant", ((0.0, INF, 0.0),)),
    (attitude_error, "seed", (0.5,)),
    (force_noise, "thrust_limit", (0.0, NAN)),
    (force_noise, "correlation_time", (-1.0,)),
    (lidar, "period", (0.0, INF)),
    (lidar, "seed", (-1, 1e300, 0.5)),
    (mpc, "period", (0.0, NAN)),
    (mpc, "cold_iterations", (0, 10**22)),
    (mpc_of, "program", (None, kleopatra())),
    (navigation, "noise_std", (0.0,)),
    (navigation, "mass", (-1.0,)),
    (navigation, "delay", (-1, 0.5)),
    (navigation, "spin", (NAN,)),
    (random_walk, "max_relative_magnitude", (-0.1, NAN)),
    (random_walk, "reset_period", (5.0, INF)),
    (random_walk, "increment_std", (INF,)),
    (spacecraft, "mass", (0.0, NAN, "heavy")),
    (spacecraft, "spin", (INF, (0.0, NAN, 3e-4), object())),
    (spacecraft, "axis_point", ((0.0, INF, 0.0),)),
    (spacecraft, "initial_state", ([1.0, 2.0, 3.0], np.full(6, NAN))),
]


@pytest.mark.parametrize(
    ("make", "name", "value"),
    [(make, name, value) for make, name, values in REFUSED for value in values],
)
def test_senseless_arguments_are_refused(make: Callable, name: str, value: Any) -> None:
    with pytest.raises(InputError, match=name):
        make(**{name: value})


def test_senseless_positional_arguments_are_refused() -> None:
    for make in (
        lambda: ActualThrust(ThrusterErrors(), 0.0, None),
        lambda: AgreementGate("loose"),  # pyright: ignore[reportArgumentType]
        lambda: CheckSchedule("never"),  # pyright: ignore[reportArgumentType]
        lambda: CommandAxes(0.0),
        lambda: DelayedHold(10.0, 10.1, 3),
        lambda: FrameDelay(4, 0, 10.0),
        lambda: Lidar(
            kleopatra().shape, LidarErrors(false_returns=0.1), LidarGeometry(max_range=INF)
        ),
        lambda: ProportionalDerivative(100.0, 0.0, 40.0, 10.0),
    ):
        with pytest.raises(InputError):
            make()
