"""The losses of the pilot's parts, each of a network and a batch."""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn

from proxops.training.data import Scaling
from proxops.training.loop import Batch
from proxops.training.networks import MEMORY, GeometryLayer, Guidance, Motion, Pilot, StateFilter
from proxops.training.recipes.recipe import force_loss

# Number of a frame's returns in one step of learning the surface; each step draws others.
_HITS_A_STEP = 96
# Lengths and speeds here are those at Kleopatra, in m and m/s; see `Scaling`.
# Limits of the log-uniform distance from the true position at which the layer starts.
_START_ERRORS = (100.0, 5e3)
# Errors below which the loss is quadratic, after two steps and after one.
_ROUNDED = (10.0, 100.0)
# Unit of the layer's errors in m.
_LAYER_UNIT = 1e3
_FIRST_STEP_WEIGHT, _SURFACE_WEIGHT, _NORMAL_WEIGHT = 0.3, 0.1, 0.1
# Units of the filter's errors in m and m/s.
_FILTER_POSITION, _FILTER_SPEED = 20.0, 0.1
# Weight of the error of the estimate beside that of the force, which keeps the parts what they are.
_ESTIMATE_WEIGHT = 0.1
# Steps after which errors count: windows begin in flight, at a velocity that is found first.
_FILTER_SETTLES = 12


def coarse_loss(network: nn.Module, batch: tuple[Tensor, Tensor]) -> Tensor:
    """Distance of the coarse position from the true one, by its network; see `coarse_examples`."""
    normal, wanted = batch
    return (network(normal) - wanted).norm(dim=1).mean()


def geometry_loss(layer: GeometryLayer, batch: tuple[Tensor, ...], scaling: Scaling) -> Tensor:
    """Where two steps of the layer lead from a start that is off; the surface is learned by it.

    Args:
      batch: the columns of `Hits`.
    """
    points, _, valid, _, position = batch
    unit = _LAYER_UNIT * scaling.length
    chosen = torch.randperm(points.shape[1], device=points.device)[:_HITS_A_STEP]
    points, valid = points[:, chosen], valid[:, chosen]
    low, high = (math.log(error * scaling.length) for error in _START_ERRORS)
    far = torch.exp(low + (high - low) * torch.rand(len(points), 1, device=points.device))
    place = position + far * torch.randn_like(position)
    place, _ = layer(place, points, valid)
    total = _FIRST_STEP_WEIGHT * _rounded((place - position) / unit, _ROUNDED[1])
    place, _ = layer(place, points, valid)
    total = total + _rounded((place - position) / unit, _ROUNDED[0])
    surface = layer.field(position[:, None] + points)
    share = valid / valid.sum(1, keepdim=True).clamp(min=1.0)
    off = surface[..., 0].abs() / unit
    length = ((surface[..., 1:] ** 2).sum(2) + 1e-9).sqrt()
    off = _SURFACE_WEIGHT * off + _NORMAL_WEIGHT * (length - 1.0) ** 2
    return total + (share * off).sum(1).mean()


def _rounded(error: Tensor, small: float) -> Tensor:
    """Mean length of errors (B, 3) in the layer's unit; quadratic below `small` in m."""
    return (error.square().sum(1) + (small / _LAYER_UNIT) ** 2).sqrt().mean()


def motion_loss(motion: Motion, batch: tuple[Tensor, ...]) -> Tensor:
    """Error of the mean acceleration of each step; `batch` has the columns of `Transitions`."""
    position, velocity, force, wanted = batch
    found = motion.natural(position, velocity) + motion.thrust(force)
    return (found - wanted).abs().mean() / motion.acceleration


def filter_loss(filter_: StateFilter, batch: tuple[Tensor, ...], scaling: Scaling) -> Tensor:
    """Errors of the estimate along windows of flights; see `fixes_of`."""
    fix, off, force, state = batch
    memory = fix.new_zeros(len(fix), MEMORY)
    errors = []
    for step in range(fix.shape[1]):
        memory = filter_.predict(memory, force[:, step])
        innovation = fix[:, step] - memory[:, :3]
        memory = filter_.correct(memory, innovation, off[:, step])
        if step >= _FILTER_SETTLES:
            errors.append(estimate_error(memory[:, :6], state[:, step], scaling).mean())
    return torch.stack(errors).mean()


def guidance_loss(guidance: Guidance, batch: tuple[Tensor, ...]) -> Tensor:
    """Difference from the expert's commands; see `natural_commands`."""
    *given, wanted = batch
    return force_loss(guidance(*given), wanted, guidance.thrust_limit)


def end_to_end_loss(pilot: Pilot, batch: Batch, scaling: Scaling) -> Tensor:
    """Difference from the expert's forces along windows of flights, and errors of the estimate.

    The windows begin in flight, where the filter has to find position and velocity first. Its first
    steps do not count.
    """
    forces, estimates, _ = pilot.sequence(
        batch["frames"], batch["target"], batch["commanded_force"]
    )
    settled = slice(_FILTER_SETTLES, None)
    asked = batch["labelled"][:, settled]
    wanted = batch["mpc_force"][:, settled][asked]
    off = force_loss(forces[:, settled][asked], wanted, pilot.guidance.thrust_limit)
    lost = estimate_error(estimates[:, settled], batch["state"][:, settled], scaling)
    return off + _ESTIMATE_WEIGHT * lost.mean()


def estimate_error(estimate: Tensor, state: Tensor, scaling: Scaling) -> Tensor:
    """Errors (..., 2) of positions and velocities (..., 6), each in its unit."""
    error = (estimate - state).unflatten(-1, (2, 3)).norm(dim=-1)
    return error / error.new_tensor(
        [_FILTER_POSITION * scaling.length, _FILTER_SPEED * scaling.speed]
    )
