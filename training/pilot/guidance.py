"""Guidance from state and goal to force: a law of least effort that a network corrects."""

from __future__ import annotations

import torch
from torch import Tensor, nn

# Scales of the network's inputs: position errors over `length`, for the middle and the near range,
# and velocities over `speed`.
_NEAR_SCALES = (0.05, 0.003)
_SLOW_SCALE = 0.05
# Added to the distance over the length, so that the distance is never 0.
_LEAST_DISTANCE = 1e-5
# The corrections of time and gains lie between 1/e and e.
_GREATEST_LOG = 1.0


class Guidance(nn.Module):
    """The law of least quadratic effort to rest at the goal in a time T, with learned corrections.

    The law is::

        F = m (6 e / T^2 - 4 v / T - natural acceleration) + correction

    with e the vector to the goal and v the velocity. The natural acceleration is an input, for
    instance from `Motion`. T is the time of rest-to-rest motion at an acceleration a that is
    learned (see `Horizon.time_to_go`). The network gets the state, the goal and the point where the
    straight line comes closest to a learned ellipsoid. It corrects T, both gains and the force for
    all that the law leaves out: gravity along the way, the way around the body, fuel and limits.
    """

    bends: Tensor

    def __init__(
        self,
        length: float,
        speed: float,
        keep_out: Tensor,
        force_per_acceleration: float,
        thrust_limit: float,
        least_time: float,
        nominal_acceleration: float,
        width: int = 256,
    ):
        """Takes units, and initial values of the ellipsoid and of the law.

        Args:
          length, speed: units in m and m/s, in which numbers are about one.
          keep_out: (3,) initial semi-axes of the ellipsoid in m.
          force_per_acceleration: the spacecraft's mass in kg.
          thrust_limit: N per axis, the unit of the correction.
          least_time: initial value of the least T in s.
          nominal_acceleration: initial value of a in m/s^2.
          width: width of the network's layers.
        """
        super().__init__()
        self.length, self.speed = length, speed
        bends = torch.tensor([*_NEAR_SCALES, _SLOW_SCALE]).repeat_interleave(3)
        self.register_buffer("bends", bends)
        self.mass, self.thrust_limit = force_per_acceleration, thrust_limit
        self.log_axes = nn.Parameter(torch.log(keep_out.float() / length))
        self.log_least_time = nn.Parameter(torch.tensor(least_time).log())
        self.log_acceleration = nn.Parameter(torch.tensor(nominal_acceleration).log())
        self.network = nn.Sequential(
            nn.Linear(43, width), nn.SiLU(),
            nn.Linear(width, width), nn.SiLU(),
            nn.Linear(width, width), nn.SiLU(),
            nn.Linear(width, 6),
        )  # fmt: skip
        last = self.network[-1]
        assert isinstance(last, nn.Linear)
        with torch.no_grad():
            last.weight.mul_(0.1)
            last.bias.zero_()

    def forward(self, position: Tensor, velocity: Tensor, goal: Tensor, natural: Tensor) -> Tensor:
        """Forces (B, 3) in N, without limits.

        Args:
          position, velocity, goal: (B, 3) in SI in K.
          natural: (B, 3) acceleration without thrust in m/s^2.
        """
        inputs, distance = self._inputs(position, velocity, goal)
        thrust, logs = self.network(inputs).split(3, dim=1)
        away, distance = goal - position, self.length * (distance + _LEAST_DISTANCE)
        law = least_effort(
            away, velocity, distance, logs, self.log_acceleration, self.log_least_time
        )
        return self.mass * (law - natural) + self.thrust_limit * thrust

    def _inputs(self, position: Tensor, velocity: Tensor, goal: Tensor) -> tuple[Tensor, Tensor]:
        """The network's inputs (B, 43), and the distance (B, 1) over the length."""
        p, g = position / self.length, goal / self.length
        v, e = velocity / self.speed, g - p
        distance, speed = e.norm(dim=1, keepdim=True), v.norm(dim=1, keepdim=True)
        bent = torch.asinh(torch.cat([e, e, v], dim=1) / self.bends)
        unit = [e / (distance + 1e-3), v / (speed + 5e-3)]
        _, above, round_it = way_round(p, v, e, torch.exp(self.log_axes))
        logs = torch.log(torch.cat([10.0 * distance + 0.01, speed + 2.5e-3, above], 1))
        return torch.cat([p, g, v, 2.0 * e, bent, *unit, logs, *round_it], dim=1), distance


def least_effort(
    away: Tensor,
    velocity: Tensor,
    distance: Tensor,
    logs: Tensor,
    log_acceleration: Tensor,
    log_least_time: Tensor,
) -> Tensor:
    """The acceleration (B, 3) of the law of least quadratic effort, with corrections.

    Args:
      away: (B, 3) vector to the goal. velocity: (B, 3).
      distance: (B, 1) length of `away`, above 0.
      logs: (B, 3) logarithms of what T and both gains are corrected by; they are limited.
      log_acceleration, log_least_time: logarithms of a and of the least T, of one number or (B, 1).
    """
    logs = logs.clamp(-_GREATEST_LOG, _GREATEST_LOG)
    scale_time, scale_error, scale_speed = torch.exp(logs).split(1, dim=1)
    closing = torch.relu((away * velocity).sum(1, keepdim=True) / distance)
    a = torch.exp(log_acceleration)
    q = closing**2 / (a * distance)
    share = (q + torch.sqrt(q * (q + 9.0) + 1e-9)) / 9.0
    squared = 4.0 * scale_time**2 * distance / (a * (1.0 + 2.0 * share))
    squared = squared + torch.exp(2.0 * log_least_time)
    return 6.0 * scale_error * away / squared - 4.0 * scale_speed * velocity / squared.sqrt()


def way_round(p: Tensor, v: Tensor, e: Tensor, axes: Tensor) -> tuple[Tensor, Tensor, list[Tensor]]:
    """What a network is told of the ellipsoid and of where the straight line comes closest to it.

    Args:
      p, v, e: position, velocity and vector to the goal (B, 3), in any units.
      axes: semi-axes (3,) or (B, 3) in the unit of `p`.

    Returns:
      The position (B, 3) in coordinates in which the ellipsoid is a ball; its level above the ball
      (B, 1), which is never 0; and columns for the network, 13 in all.
    """
    here, way = p / axes, e / axes
    share = -(here * way).sum(1, keepdim=True) / ((way * way).sum(1, keepdim=True) + 1e-4)
    share = share.clamp(0.0, 1.0)
    closest = here + share * way
    depth, level = closest.norm(dim=1, keepdim=True), here.norm(dim=1, keepdim=True)
    up, out = here / (level + 1e-3), closest / (depth + 0.05)
    rising = (v / axes * up).sum(1, keepdim=True)
    above = (level - 1.0).clamp(min=0.005)
    round_it = [up, out, 3.0 * torch.relu(1.3 - depth) * out, share, depth, rising]
    return here, above, [*round_it, 5.0 * torch.relu(1.2 - depth)]
