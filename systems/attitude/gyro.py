"""`Gyro`: the angular velocity, as it is measured."""

from __future__ import annotations

from proxops.systems.common import SeededSystem, config, number
from proxops.systems.vehicle import gauss_markov_at, white_noise_at

DRIFT_TIME = 3600.0
"""Time in s over which the correlation of a gyro's bias falls to 1/e."""


@config
class GyroConfig:
    """The data sheet of a gyro."""

    # Standard deviation of each measurement, about each axis.
    noise_rad_s: float = number(2e-6, at_least=0.0, at_most=1.0, unit="rad/s")
    # Standard deviation of the bias about each axis. It varies over an hour.
    bias_rad_s: float = number(1e-5, at_least=0.0, at_most=1.0, unit="rad/s")


class Gyro(SeededSystem):
    """The angular velocity that a gyro measures, at attitude steps.

    ```
    angular_velocity (3), rad/s, S ──► Gyro ──► measured (3), rad/s, S
    ```

    It measures w_NS and a bias, a Gauss-Markov process, and independent noise.
    """

    def __init__(self, sheet: GyroConfig, period: float, seed: int):
        """Takes the data sheet, the attitude period in s and the seed of a new Context."""
        super().__init__(period, seed)
        self.sheet = sheet
        self._port = self.DeclareVectorInputPort("angular_velocity", 3)
        self.DeclareVectorOutputPort(
            "measured", 3, self._calc, {self._port.ticket(), *self.seed_tickets()}
        )

    def _calc(self, context, output):
        seed, sheet = self.seed_of(context), self.sheet
        bias = gauss_markov_at(
            context.get_time(),
            std=sheet.bias_rad_s,
            correlation_time=DRIFT_TIME,
            period=self.period,
            seed=seed,
        )
        noise = white_noise_at(
            context.get_time(), std=sheet.noise_rad_s, period=self.period, seed=seed
        )
        rate = self._port.Eval(context).tolist()
        output.SetFromVector([x + y + z for x, y, z in zip(rate, bias, noise, strict=True)])
