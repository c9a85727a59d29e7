"""What a survey may be wrong about before it begins, by its scenario's dispersions."""

from __future__ import annotations

import math
import typing

from proxops.diagrams.scenario.body import Body
from proxops.diagrams.scenario.dispersions import Dispersions
from proxops.diagrams.scenario.scenario_config import Scenario
from proxops.systems.gravity import GRAVITATIONAL_CONSTANT

if typing.TYPE_CHECKING:
    from proxops.systems.mapping import Expected

# Of what is not dispersed, so much is still expected: shares, rad, and shares of the size.
_LEAST = {
    "truth.gravity": 1e-2,
    "truth.pole_deg": 0.1,
    "truth.spin": 1e-6,
    "truth.attitude.constant_deg": 1e-3,
    "truth.attitude.varying_std_deg": 1e-4,
}


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
    )
