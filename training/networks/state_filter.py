"""A Kalman filter with learned motion and noise: from fixes and forces to a state estimate."""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor, nn

from proxops.training.data import Scaling

# Sizes of the filter's memory: position, velocity and unexplained acceleration; the upper triangle
# of the covariance (3 by 3) that all axes share; the natural acceleration over the period that
# begins; and a flag that is 1 after the first frame.
_SIZES = [9, 6, 3, 1]
MEMORY = sum(_SIZES)
NATURAL = slice(15, 18)
# Entries of the upper triangle: in a full covariance rounding makes the two halves differ.
_ROWS, _COLUMNS = [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]
# A fix with a residual above this many times the usual one gets more noise; a lost one has 50.
TRUSTED = 2.0
# A squared innovation above this many times its variance is no chance.
_SURPRISING = 9.0


class Motion(nn.Module):
    """A learned model of the mean acceleration in K over the control period that begins."""

    def __init__(
        self,
        length: float,
        speed: float,
        acceleration: float,
        period: float,
        width: int = 128,
        force: float = 1.0,
    ):
        """Takes units (m, m/s, m/s^2, N) in which numbers are about one, the period and a width."""
        super().__init__()
        self.length, self.speed, self.acceleration = length, speed, acceleration
        self.force = force
        self.period = period
        self.network = nn.Sequential(
            nn.Linear(6, width), nn.SiLU(),
            nn.Linear(width, width), nn.SiLU(),
            nn.Linear(width, 3),
        )  # fmt: skip
        # Centrifugal and Coriolis acceleration; and that of the force, which Coriolis turns within
        # the period.
        self.turning = nn.Parameter(torch.zeros(6, 3))
        self.per_newton = nn.Parameter(torch.zeros(3, 3))

    def natural(self, position: Tensor, velocity: Tensor) -> Tensor:
        """Acceleration (B, 3) in m/s^2 without thrust, at positions and velocities (B, 3)."""
        p = (position + 0.5 * self.period * velocity) / self.length
        squared = (p * p).sum(1, keepdim=True) + 0.01
        fall = self.network(torch.cat([p, p / squared], 1)) / squared
        turning = torch.cat([p, velocity / self.speed], 1) @ self.turning
        return self.acceleration * (fall + turning)

    def thrust(self, force: Tensor) -> Tensor:
        """Acceleration (B, 3) in m/s^2 by forces (B, 3) in N."""
        return self.acceleration / self.force * (force @ self.per_newton)


class StateFilter(nn.Module):
    """A Kalman filter of three states an axis, with learned noise and one covariance for all axes.

    The third state is the acceleration that the learned motion does not explain: a random walk.
    """

    step: Tensor
    seen: Tensor
    rows: Tensor
    columns: Tensor

    def __init__(self, motion: Motion, scaling: Scaling | None = None):
        """Takes the motion, and the factors for the initial values of the noise."""
        super().__init__()
        self.motion = motion
        scaling = scaling or Scaling()
        # Standard deviations in m, m/s, m/s^2: of a good fix; of the noise that a step adds to
        # position, velocity and unexplained acceleration; and of these three before the first
        # frame.
        units = [scaling.length, scaling.speed, scaling.acceleration]
        start = np.array([30.0, 1.0, 0.01, 1e-5, 1e3, 3.0, 1e-3]) * (units[:1] + 2 * units)
        self.logs = nn.Parameter(torch.tensor([math.log(x) for x in start]))
        h, k = motion.period, 0.5 * motion.period**2
        step = torch.tensor([[1.0, h, k], [0.0, 1.0, h], [0.0, 0.0, 1.0]])
        # Rows of covariances and positions are multiplied by these from the right.
        for name, matrix in (("step", _moved_covariance(step)), ("seen", torch.eye(9)[:, :3])):
            self.register_buffer(name, matrix.T.contiguous())
        self.register_buffer("rows", torch.tensor(_ROWS))
        self.register_buffer("columns", torch.tensor(_COLUMNS))

    def predict(self, memory: Tensor, force: Tensor) -> Tensor:
        """Predicts the memory (B, MEMORY) one period later, under forces (B, 3) in N."""
        states, covariance, natural, started = memory.split(_SIZES, dim=1)
        position, velocity, push = states.split(3, dim=1)
        mean = natural + self.motion.thrust(force) + push
        noise = self._diagonal(self.logs[1:4])
        # Not a matrix product: its rounding differs between libraries. For a position in single
        # precision that is a centimetre, which changes the first velocities.
        h = self.motion.period
        position = position + (h * velocity + 0.5 * h**2 * mean)
        moved = [position, velocity + h * mean, push]
        return torch.cat([*moved, covariance @ self.step + noise, natural, started], dim=1)

    def correct(self, memory: Tensor, innovation: Tensor, measurement_noise: Tensor) -> Tensor:
        """Corrects the memory by fixes that lie `innovation` (B, 3) in m from its position.

        The standard deviation of each fix is `measurement_noise` (B, 1) times that of a good one.
        The filter takes differences because single precision rounds positions to a centimetre. A
        fix that lies farther from the prediction than both deviations allow widens the covariance
        first, so that a filter that is lost finds its way back.
        """
        states, covariance, _, started = memory.split(_SIZES, dim=1)
        begun = started > 0.0
        covariance = torch.where(begun, covariance, self._diagonal(self.logs[4:]))
        # The first fix is the position, at rest.
        states = torch.where(begun, states, (states[:, :3] + innovation) @ self.seen)
        innovation = torch.where(begun, innovation, 0.0)
        noise = torch.exp(2.0 * self.logs[0]) * measurement_noise**2
        usual = covariance[:, :1] + noise
        surprise = (innovation**2).mean(1, keepdim=True) / (_SURPRISING * usual)
        covariance = covariance * surprise.clamp(min=1.0)
        first = covariance[:, :3]
        gain = first / (first[:, :1] + noise)
        states = states + (gain[..., None] * innovation[:, None]).flatten(1)
        removed = gain.index_select(1, self.rows) * first.index_select(1, self.columns)
        covariance = covariance - removed
        natural = self.motion.natural(states[:, :3], states[:, 3:6])
        return torch.cat([states, covariance, natural, torch.ones_like(started)], dim=1)

    def _diagonal(self, logs: Tensor) -> Tensor:
        """The covariance (6,) of independent errors, from logarithms (3,) of their deviations."""
        return torch.diag(torch.exp(2.0 * logs))[self.rows, self.columns]


def _moved_covariance(step: Tensor) -> Tensor:
    """The matrix (6, 6) that takes P's upper triangle to that of S P S^T."""
    moved = torch.zeros(6, 6)
    for k, (a, b) in enumerate(zip(_ROWS, _COLUMNS, strict=True)):
        for m, (c, d) in enumerate(zip(_ROWS, _COLUMNS, strict=True)):
            moved[k, m] = step[a, c] * step[b, d] + (step[a, d] * step[b, c] if c != d else 0.0)
    return moved


def measurement_noise(residual: Tensor, usual: Tensor) -> Tensor:
    """Standard deviation of fixes whose returns lie `residual` (B, 1) m off, over the usual one."""
    return 1.0 + torch.relu(residual / usual - TRUSTED) ** 2
