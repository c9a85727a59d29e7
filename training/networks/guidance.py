"""Guidance from state and goal to force: the ZEM/ZEV law, which a network corrects.

The law of least quadratic effort to rest at the goal in a time T is::

    F = m (6 e / T^2 - 4 v / T - natural acceleration) + correction

with e the vector to the goal and v the velocity: eq. 20 to 22 of docs/method/equations.md. T is the
time of rest-to-rest motion at an acceleration a that is learned (see `Horizon.time_to_go`). The
network is told the state, the goal and the point where the straight line comes closest to an
ellipsoid. It corrects T, both gains and the force for all that the law leaves out: gravity along
the way, the way around the body, fuel and limits. `GuidanceNetwork` of `systems.policy` is the same
as `AnyBodyGuidance` without torch, for flight.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn

from proxops.systems.policy import INPUTS, GuidanceNetwork

# Scales of the network's inputs: position errors in the middle and in the near range, in the unit
# of length, and slow speeds of the pilot and of the guidance for any body, each in its own unit.
_NEAR_SCALES = (0.05, 0.003)
_PILOT_SLOW, _ANY_BODY_SLOW = 0.05, 0.025
# Columns of `_on_the_way`.
_WAY = 31
# Added to the distance in the unit of length, so that it is never 0.
_LEAST_DISTANCE = 1e-5
# The corrections of time and gains lie between 1/e and e.
_GREATEST_LOG = 1.0
# Of the guidance for any body: least time and acceleration that its law begins with, in the units
# of `Surroundings` at a pace of 1. At Kleopatra that is some 240 s and 0.03 m/s^2.
_LEAST_TIME, _ACCELERATION = 0.13, 1.0
# Lengths of the parts of a row of inputs: state, goal, natural accelerations, ellipsoid, the rest.
_PARTS = (3, 3, 3, 3, 3, 3, INPUTS - 18)


class Guidance(nn.Module):
    """The law with learned corrections, in SI at one body.

    The natural acceleration is an input, for instance from `Motion`; the ellipsoid is learned.
    """

    bends: Tensor

    def __init__(
        self,
        length: float,
        speed: float,
        keep_out: Tensor,
        mass: float,
        thrust_limit: float,
        least_time: float,
        nominal_acceleration: float,
        width: int = 256,
    ):
        """Takes units, and initial values of the ellipsoid and of the law.

        Args:
          length, speed: units in m and m/s, in which numbers are about one.
          keep_out: (3,) initial semi-axes of the ellipsoid in m.
          mass: of the spacecraft in kg.
          thrust_limit: N per axis, the unit of the correction.
          least_time: initial value of the least T in s.
          nominal_acceleration: initial value of a in m/s^2.
          width: width of the network's layers.
        """
        super().__init__()
        self.length, self.speed = length, speed
        self.register_buffer("bends", _scales(_PILOT_SLOW))
        self.mass, self.thrust_limit = mass, thrust_limit
        self.log_axes = nn.Parameter(torch.log(keep_out.float() / length))
        self.log_least_time = nn.Parameter(torch.tensor(least_time).log())
        self.log_acceleration = nn.Parameter(torch.tensor(nominal_acceleration).log())
        self.network = _corrections(12 + _WAY, width)

    def forward(self, position: Tensor, velocity: Tensor, goal: Tensor, natural: Tensor) -> Tensor:
        """Forces (B, 3) in N, without limits.

        Args:
          position, velocity, goal: (B, 3) in SI in K.
          natural: (B, 3) acceleration without thrust in m/s^2.
        """
        p, g = position / self.length, goal / self.length
        v, e = velocity / self.speed, g - p
        axes = torch.exp(self.log_axes)
        distance, _, way = _on_the_way(p, v, e, axes, self.bends, _PILOT_SLOW)
        told = torch.cat([p, g, v, 2.0 * e, *way], dim=1)
        thrust, logs = self.network(told).split(3, dim=1)
        away, distance = goal - position, self.length * (distance + _LEAST_DISTANCE)
        law = least_effort(
            away, velocity, distance, logs, self.log_acceleration, self.log_least_time
        )
        return self.mass * (law - natural) + self.thrust_limit * thrust


class AnyBodyGuidance(nn.Module):
    """The law with learned corrections, for any body, in the units of `Surroundings`.

    In these the thrust limit is 1, and so is m. The acceleration of the law is one that is learned
    times the pace.
    """

    bends: Tensor
    instead: Tensor

    def __init__(self, width: int, instead: Tensor | None = None):
        """Takes the width of the network's layers, and what it is told instead of its inputs.

        Args:
          width: of three layers.
          instead: (23,) for studies of what the inputs are good for; NaN: the input itself, as all
            are by default. The law always has its inputs.
        """
        super().__init__()
        self.register_buffer("bends", _scales(_ANY_BODY_SLOW))
        instead = torch.full((INPUTS,), torch.nan) if instead is None else instead
        self.register_buffer("instead", instead, persistent=False)
        self.log_least_time = nn.Parameter(torch.tensor(_LEAST_TIME).log())
        self.log_acceleration = nn.Parameter(torch.tensor(_ACCELERATION).log())
        self.network = _corrections(INPUTS + _WAY + 6, width)

    def forward(self, given: Tensor) -> Tensor:
        """Forces (B, 3) over the thrust limit, without limits, for rows (B, 23) of inputs."""
        position, velocity, goal, natural, *_ = given.split(_PARTS, dim=1)
        away = goal - position
        told = torch.where(self.instead.isnan(), given, self.instead)
        p, v, g, _, _, axes, _ = told.split(_PARTS, dim=1)
        e = g - p
        _, here, way = _on_the_way(p, v, e, axes, self.bends, _ANY_BODY_SLOW)
        row = torch.cat([told, *way, here, 2.0 * e], dim=1)
        thrust, logs = self.network(row).split(3, dim=1)
        distance, log_pace = away.norm(dim=1, keepdim=True), given[:, -1:].log()
        law = least_effort(
            away,
            velocity,
            distance + _LEAST_DISTANCE,
            logs,
            self.log_acceleration + log_pace,
            self.log_least_time - 0.5 * log_pace,
        )
        return law - natural + thrust

    @torch.no_grad()
    def compiled(self) -> GuidanceNetwork:
        """What flies: the same function of one row, without torch."""
        layers = [layer for layer in self.network if isinstance(layer, nn.Linear)]
        law = torch.stack([self.log_acceleration.exp(), (2.0 * self.log_least_time).exp()])
        parts = [part for layer in layers for part in (layer.weight, layer.bias)]
        arrays = [part.numpy(force=True) for part in (*parts, self.bends, self.instead, law)]
        return GuidanceNetwork(*(np.array(array, dtype=np.float32) for array in arrays))


def least_effort(
    away: Tensor,
    velocity: Tensor,
    distance: Tensor,
    logs: Tensor,
    log_acceleration: Tensor,
    log_least_time: Tensor,
) -> Tensor:
    """The acceleration (B, 3) of the law, with corrections of T and both gains.

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


def _on_the_way(
    p: Tensor, v: Tensor, e: Tensor, axes: Tensor, bends: Tensor, slow: float
) -> tuple[Tensor, Tensor, list[Tensor]]:
    """What a network is told of the way to the goal, and of how the ellipsoid lies beside it.

    Args:
      p, v, e: position, velocity and vector to the goal (B, 3) in their units.
      axes: semi-axes (3,) or (B, 3) of the ellipsoid in the unit of `p`.
      bends: (9,) see `_scales`. slow: a slow speed.

    Returns:
      The distance (B, 1) to the goal; the position (B, 3) in coordinates in which the ellipsoid is
      the unit ball; and columns for the network, 31 in all.
    """
    distance, speed = e.norm(dim=1, keepdim=True), v.norm(dim=1, keepdim=True)
    bent = torch.asinh(torch.cat([e, e, v], dim=1) / bends)
    unit = [e / (distance + 1e-3), v / (speed + slow / 10.0)]
    # Where the straight line comes closest to the ellipsoid.
    here, way = p / axes, e / axes
    share = -(here * way).sum(1, keepdim=True) / ((way * way).sum(1, keepdim=True) + 1e-4)
    share = share.clamp(0.0, 1.0)
    closest = here + share * way
    depth, level = closest.norm(dim=1, keepdim=True), here.norm(dim=1, keepdim=True)
    up, out = here / (level + 1e-3), closest / (depth + 0.05)
    rising = (v / axes * up).sum(1, keepdim=True)
    above = (level - 1.0).clamp(min=0.005)
    past = [up, out, 3.0 * torch.relu(1.3 - depth) * out, share, depth, rising]
    past += [5.0 * torch.relu(1.2 - depth)]
    logs = torch.log(torch.cat([10.0 * distance + 0.01, speed + slow / 20.0, above], 1))
    return distance, here, [bent, *unit, logs, *past]


def _scales(slow: float) -> Tensor:
    """Scales (9,) of position errors, twice, and of velocities."""
    return torch.tensor([*_NEAR_SCALES, slow]).repeat_interleave(3)


def _corrections(inputs: int, width: int) -> nn.Sequential:
    """The network from its inputs to six corrections, which are small at first."""
    layers = nn.Sequential(
        nn.Linear(inputs, width), nn.SiLU(),
        nn.Linear(width, width), nn.SiLU(),
        nn.Linear(width, width), nn.SiLU(),
        nn.Linear(width, 6),
    )  # fmt: skip
    last = layers[-1]
    assert isinstance(last, nn.Linear)
    with torch.no_grad():
        last.weight.mul_(0.1)
        last.bias.zero_()
    return layers
