"""From state and goal to force: least-effort guidance that a network corrects."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from proxops.training.state_filter import Motion

# Scales on which errors are shown to the network: far, middle and near, over `length`, and
# velocities over `speed`.
_NEAR_SCALES = (0.05, 0.003)
_SLOW_SCALE = 0.05
# The corrections of time and gains are at most a factor e either way.
_GREATEST_LOG = 1.0


class Guidance(nn.Module):
    """The law of least quadratic effort from here to rest at the goal in a time T, corrected.

    Without gravity it is::

        F = m (6 e / T^2 - 4 v / T - natural acceleration) + correction

    e the way to go and v the velocity. T starts as that of rest-to-rest motion at the acceleration
    a (see `Horizon.time_to_go`). The network sees state, goal and where the straight line passes a
    learned ellipsoid, and corrects T, both gains, and the force, for all that the law leaves out:
    gravity along the way, the way round the body, fuel, limits.
    """

    def __init__(
        self,
        motion: Motion,
        keep_out: Tensor,
        force_per_acceleration: float,
        thrust_limit: float,
        least_time: float,
        nominal_acceleration: float,
        width: int = 256,
    ):
        """Takes the learned motion and what the ellipsoid, law and correction start from.

        Args:
          keep_out: (3,) semi-axes in m.
          force_per_acceleration: kg, the spacecraft's mass.
          thrust_limit: N per axis, the unit of the correction.
          least_time: s, no T is shorter at the start.
          nominal_acceleration: m/s^2, a.
        """
        super().__init__()
        self.motion = motion
        self.mass, self.thrust_limit = force_per_acceleration, thrust_limit
        self.log_axes = nn.Parameter(torch.log(keep_out.float() / motion.length))
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

    def forward(self, position: Tensor, velocity: Tensor, goal: Tensor) -> Tensor:
        """Forces (B, 3) in N, not limited, for positions, velocities, goals (B, 3) in SI in K."""
        out = self.network(self._inputs(position, velocity, goal))
        logs = out[:, 3:].clamp(-_GREATEST_LOG, _GREATEST_LOG)
        scale_time, scale_error, scale_speed = torch.exp(logs).split(1, dim=1)
        away = goal - position
        distance = away.norm(dim=1, keepdim=True) + 1.0
        closing = torch.relu((away * velocity).sum(1, keepdim=True) / distance)
        a = torch.exp(self.log_acceleration)
        q = closing**2 / (a * distance)
        share = (q + torch.sqrt(q * q + 9.0 * q + 1e-9)) / 9.0
        time = scale_time * torch.sqrt(4.0 * distance / (a * (1.0 + 2.0 * share)))
        time = torch.sqrt(time**2 + torch.exp(2.0 * self.log_least_time))
        law = 6.0 * scale_error * away / time**2 - 4.0 * scale_speed * velocity / time
        law = law - self.motion.natural(position, velocity)
        return self.mass * law + self.thrust_limit * out[:, :3]

    def _inputs(self, position: Tensor, velocity: Tensor, goal: Tensor) -> Tensor:
        p, g = position / self.motion.length, goal / self.motion.length
        v, e = velocity / self.motion.speed, g - p
        distance, speed = e.norm(dim=1, keepdim=True), v.norm(dim=1, keepdim=True)
        near = [torch.asinh(e / scale) for scale in _NEAR_SCALES]
        direct = [p, g, v, 2.0 * e, *near, torch.asinh(v / _SLOW_SCALE)]
        unit = [e / (distance + 1e-3), v / (speed + 5e-3)]
        logs = [torch.log(10.0 * distance + 0.01), torch.log(speed + 2.5e-3)]
        # In coordinates that make the ellipsoid a ball: where the straight line comes closest.
        axes = torch.exp(self.log_axes)
        here, way = p / axes, e / axes
        share = -(here * way).sum(1, keepdim=True) / ((way * way).sum(1, keepdim=True) + 1e-4)
        share = share.clamp(0.0, 1.0)
        closest = here + share * way
        depth, level = closest.norm(dim=1, keepdim=True), here.norm(dim=1, keepdim=True)
        up, out = here / (level + 1e-3), closest / (depth + 0.05)
        rising = (v / axes * up).sum(1, keepdim=True)
        round_it = [up, out, 3.0 * torch.relu(1.3 - depth) * out, share, depth, rising]
        round_it += [torch.log((level - 1.0).clamp(min=0.005)), 5.0 * torch.relu(1.2 - depth)]
        return torch.cat([*direct, *unit, *logs, *round_it], dim=1)
