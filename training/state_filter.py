"""Position, velocity and what pushes, from fixes and the force applied: a learned Kalman filter."""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn

# Of the filter's memory: position, velocity, unexplained acceleration, the covariance (3 by 3) that
# all axes share, and whether there has been a frame yet.
MEMORY = 19
# Residual of a fix, over the usual one, from which on it is trusted less; a lost fix has fifty.
_TRUSTED_RESIDUAL = 2.0
# A squared innovation of more than this many times its variance is no accident.
_SURPRISING = 9.0


class Motion(nn.Module):
    """Acceleration in K as a function of position, velocity and the force applied, learned."""

    def __init__(self, length: float, speed: float, acceleration: float, width: int = 128):
        """Takes the units (m, m/s, m/s^2) in which numbers come to about one."""
        super().__init__()
        self.length, self.speed, self.acceleration = length, speed, acceleration
        self.network = nn.Sequential(
            nn.Linear(6, width), nn.SiLU(),
            nn.Linear(width, width), nn.SiLU(),
            nn.Linear(width, 3),
        )  # fmt: skip
        self.coriolis = nn.Parameter(torch.zeros(3, 3))
        self.centrifugal = nn.Parameter(torch.zeros(3, 3))
        self.per_newton = nn.Parameter(torch.zeros(1))

    def natural(self, position: Tensor, velocity: Tensor) -> Tensor:
        """Acceleration (B, 3) in m/s^2 at positions and velocities (B, 3) without thrust."""
        p = position / self.length
        squared = (p * p).sum(1, keepdim=True) + 0.01
        fall = self.network(torch.cat([p, p / squared], 1)) / squared
        turning = p @ self.centrifugal.T + velocity / self.speed @ self.coriolis.T
        return self.acceleration * (fall + turning)

    def thrust(self, force: Tensor) -> Tensor:
        """Acceleration (B, 3) in m/s^2 that forces (B, 3) in N give."""
        return self.acceleration * self.per_newton * force

    def forward(self, position: Tensor, velocity: Tensor, force: Tensor, period: float) -> Tensor:
        """Mean acceleration (B, 3) over the period that starts so."""
        first = self.natural(position, velocity) + self.thrust(force)
        half = 0.5 * period
        middle = position + half * velocity + 0.5 * half**2 * first
        return self.natural(middle, velocity + half * first) + self.thrust(force)


class StateFilter(nn.Module):
    """One Kalman step of three states an axis, with learned noise and one covariance for all axes.

    The third state is the acceleration that the learned motion does not explain, a random walk.
    """

    step: Tensor
    free: Tensor
    pushed: Tensor
    first: Tensor

    def __init__(self, motion: Motion, period: float):
        super().__init__()
        self.motion, self.period = motion, period
        # Standard deviations in m, m/s, m/s^2: of a good fix, of what a step adds to position,
        # velocity and push, and of all three before the first frame.
        start = [30.0, 1.0, 0.01, 1e-5, 1e3, 3.0, 1e-3]
        self.logs = nn.Parameter(torch.tensor([math.log(x) for x in start]))
        h, k = period, 0.5 * period**2
        for name, rows in (
            ("step", [[1.0, h, k], [0.0, 1.0, h], [0.0, 0.0, 1.0]]),
            ("free", [[1.0, h, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
            ("pushed", [[k], [h], [0.0]]),
            ("first", [[1.0], [0.0], [0.0]]),
        ):
            self.register_buffer(name, torch.tensor(rows))

    def predict(self, memory: Tensor, force: Tensor) -> Tensor:
        """The memory (B, 19) a period later, under forces (B, 3) in N."""
        states, covariance, started = _unpacked(memory)
        p, v, push = states.unbind(1)
        mean = self.motion(p, v, force, self.period) + push
        noise = torch.diag(torch.exp(2.0 * self.logs[1:4]))
        # The push has acted already through `mean`.
        moved = self.free @ states + self.pushed * mean[:, None]
        return _packed(moved, self.step @ covariance @ self.step.T + noise, started)

    def correct(self, memory: Tensor, fix: Tensor, doubt: Tensor) -> Tensor:
        """The memory (B, 19) after fixes (B, 3) in m whose deviation is `doubt` (B, 1) times usual.

        A fix farther from the prediction than both allow widens the covariance first, so that a
        filter that is lost finds back.
        """
        states, covariance, started = _unpacked(memory)
        begun = started[..., None]
        fresh = torch.diag(torch.exp(2.0 * self.logs[4:]))
        covariance = begun * covariance + (1.0 - begun) * fresh
        states = begun * states + (1.0 - begun) * self.first * fix[:, None]
        noise = torch.exp(2.0 * self.logs[0]) * doubt[..., None] ** 2
        innovation = fix[:, None] - states[:, :1]
        usual = covariance[:, :1, :1] + noise
        surprise = (innovation**2).mean(2, keepdim=True) / (_SURPRISING * usual)
        covariance = covariance * surprise.clamp(min=1.0)
        gain = covariance[:, :, :1] / (covariance[:, :1, :1] + noise)
        states = states + gain * innovation
        return _packed(states, covariance - gain @ covariance[:, :1], torch.ones_like(started))


def _unpacked(memory: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """States (B, 3, 3), rows position, velocity and push; covariance (B, 3, 3); started (B, 1)."""
    return memory[:, :9].view(-1, 3, 3), memory[:, 9:18].view(-1, 3, 3), memory[:, 18:]


def _packed(states: Tensor, covariance: Tensor, started: Tensor) -> Tensor:
    return torch.cat([states.flatten(1), covariance.flatten(1), started], dim=1)


def doubt(residual: Tensor, usual: Tensor) -> Tensor:
    """How many times the usual deviation a fix has whose returns lie `residual` (B, 1) m off."""
    return 1.0 + torch.relu(residual / usual - _TRUSTED_RESIDUAL) ** 2
