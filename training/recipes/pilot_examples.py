"""Examples for the parts of the pilot from packed flights: frames, motion, commands."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from proxops.systems.common import InputError, derived_seed, generator
from proxops.training.data import PARTS, Labels, PackedFlights, part_rows, scaling_of
from proxops.training.loop import WindowDataset
from proxops.training.networks import (
    CoarsePosition,
    HitSelection,
    Motion,
    Pilot,
    measurement_noise,
)

# Of positions of a flight that are closer together than this (m, at Kleopatra) one is used.
_SPREAD = 300.0
# Stream of derived seeds.
_FRAMES_STREAM = 6
# Number of frames that are spoiled together: the errors of a frame depend on it. Number of frames
# whose returns are fitted together, and of rows whose natural acceleration is computed together.
_BLOCK, _FITTED, _ROWS = 256, 512, 65536
# Distance in m, at Kleopatra, from the true position at which the filter's fixes start.
_FIX_START = 30.0
# Errors that are added to frames, each line to one quarter: share of lost returns, share of false
# returns among all rays, and standard deviation in m, at Kleopatra, of additional noise.
_SPOILED = ((0.0, 0.0, 0.0), (0.2, 0.0, 0.0), (0.0, 0.01, 0.0), (0.05, 0.0, 150.0))


class Hits(NamedTuple):
    """Returns of frames from `HitSelection`, and the positions at which the frames were taken."""

    points: Tensor
    """(N, K, 3) in m, relative to the spacecraft, in K's axes."""
    solid: Tensor
    """(N, K) solid angles, relative to each other."""
    valid: Tensor
    """(N, K): 1 for a return, 0 for none."""
    returned: Tensor
    """(N, 1) number of rays that returned."""
    position: Tensor
    """(N, 3) in m in K."""


class Transitions(NamedTuple):
    """Control steps of flights, all (N, 3) in SI in K."""

    position: Tensor
    velocity: Tensor
    force: Tensor
    """(N, 3) in N, applied over the step."""
    acceleration: Tensor
    """(N, 3) in m/s^2, the mean over the step."""


class Commands(NamedTuple):
    """States, goals and the expert's forces there, all (N, 3) in SI in K."""

    position: Tensor
    velocity: Tensor
    goal: Tensor
    force: Tensor


def spread_rows(flights: PackedFlights, part: str) -> np.ndarray:
    """Rows of a part at positions that are some way apart; otherwise most frames show the goal."""
    kept, spread = [], _SPREAD * scaling_of(flights.setting).length
    for flight in flights.part(part):
        rows = np.arange(flight.start, flight.start + flight.steps)
        moved = np.linalg.norm(np.diff(flights.state[rows, :3], axis=0), axis=1)
        gone = np.floor(np.concatenate([[0.0], np.cumsum(moved)]) / spread)
        kept.append(rows[np.diff(gone, prepend=-1.0) > 0])
    return np.concatenate([np.zeros(0, dtype=np.int64), *kept])


def hits_of(
    flights: PackedFlights, selection: HitSelection, part: str, count: int, seed: int
) -> Hits:
    """Returns of `count` random frames of a part, or of all frames if there are fewer.

    Three quarters get additional errors: lost returns, false returns, more noise.
    """
    random = generator(derived_seed(seed, _FRAMES_STREAM), PARTS.index(part))
    length = scaling_of(flights.setting).length
    rows = spread_rows(flights, part)
    rows = random.permutation(rows)[:count]
    parts = []
    for start in range(0, len(rows), _BLOCK):
        block = rows[start : start + _BLOCK]
        frames = flights.frames(block).reshape(len(block), -1)
        spoiled = _spoil(frames, flights.setting.max_range_m, length, random)
        parts.append(selection(torch.from_numpy(spoiled)))
    points, solid, valid, found = (torch.cat(column) for column in zip(*parts, strict=True))
    return Hits(points, solid, valid, found, _tensor(flights.state[rows, :3]))


def _spoil(
    frames: np.ndarray, max_range: float, length: float, random: np.random.Generator
) -> np.ndarray:
    """Adds errors to frames (N, R), in turn those of each line of `_SPOILED`."""
    turns = np.arange(len(frames)) % len(_SPOILED)
    lost, false, noise = (np.array(_SPOILED) * [1.0, 1.0, length])[turns].T
    chance = random.random(frames.shape, dtype=np.float32)
    spoiled = frames + noise[:, None] * random.standard_normal(frames.shape, dtype=np.float32)
    spoiled = np.where(chance < lost[:, None], np.inf, spoiled)
    anywhere = max_range * random.random(frames.shape, dtype=np.float32)
    wrong = (chance < false[:, None]) & np.isinf(frames)
    return np.where(wrong, anywhere, spoiled).astype(np.float32)


def box_of(hits: Hits) -> tuple[np.ndarray, np.ndarray]:
    """Corners (3,) in m in K of the box around all but a few of the returns."""
    valid = hits.valid.numpy() > 0.0
    places = (hits.points + hits.position[:, None]).numpy()[valid]
    low, high = np.percentile(places, [0.1, 99.9], axis=0)
    return low, high


def transitions_of(flights: PackedFlights, part: str) -> Transitions:
    """The steps of a part's flights, without those in which a velocity kick came."""
    rows = part_rows(flights, part)
    last = [flight.start + flight.steps - 1 for flight in flights.part(part)]
    rows = rows[~np.isin(rows, last)]
    rows = rows[~flights.kick[rows].any(axis=1)]
    before, after = flights.state[rows], flights.state[rows + 1]
    # In double precision, because single precision rounds velocities too coarsely for differences.
    mean = (after[:, 3:] - before[:, 3:]) / flights.setting.control_period_s
    given = before[:, :3], before[:, 3:], flights.commanded_force[rows + 1], mean
    return Transitions(*(_tensor(column) for column in given))


def flight_labels(flights: PackedFlights, part: str) -> Labels:
    """States, goals and the expert's forces along a part's flights."""
    rows = part_rows(flights, part)
    rows = rows[np.isfinite(flights.mpc_force[rows]).all(axis=1)]
    goal, force = flights.target[rows, :3], flights.mpc_force[rows]
    return {"state": flights.state[rows], "goal": goal, "force": force}


def commands_of(labels: Labels) -> Commands:
    """The commands of the expert, as tensors."""
    state = labels["state"]
    given = state[:, :3], state[:, 3:], labels["goal"], labels["force"]
    return Commands(*(_tensor(column) for column in given))


@torch.no_grad()
def coarse_examples(
    coarse: CoarsePosition, training: Hits, validation: Hits
) -> list[tuple[Tensor, Tensor]]:
    """Inputs (N, F) and labels (N, 3) of the coarse position's network, of both parts.

    The features are computed once, and their scale is set from those to train on.
    """
    features = []
    for hits in (training, validation):
        blocks = zip(*(column.split(_FITTED) for column in hits[:4]), strict=True)
        parts = [coarse.features(*block) for block in blocks]
        features.append([torch.cat(column) for column in zip(*parts, strict=True)])
    coarse.fit_scale(features[0][0])
    return [
        (coarse.normalised(found), coarse.wanted(hits.position, centre))
        for (found, centre), hits in zip(features, (training, validation), strict=True)
    ]


@torch.no_grad()
def natural_commands(motion: Motion, commands: Commands) -> tuple[Tensor, ...]:
    """Positions, velocities, goals, natural accelerations and forces (N, 3)."""
    position, velocity, goal, force = commands
    parts = zip(position.split(_ROWS), velocity.split(_ROWS), strict=True)
    natural = torch.cat([motion.natural(*part) for part in parts])
    return position, velocity, goal, natural, force


@torch.no_grad()
def fixes_of(
    pilot: Pilot, flights: PackedFlights, part: str, count: int, length: int, seed: int
) -> tuple[Tensor, ...]:
    """What the filter learns from: windows of flights without kicks, with the pilot's fixes.

    The fixes start as far off as the filter's own predictions are.

    Args:
      count: greatest number of windows. length: T, the number of steps in a window.

    Returns:
      Fixes (W, T, 3), their measurement noise (W, T, 1), forces (W, T, 3) and states (W, T, 6).
    """
    dataset, off = WindowDataset(flights, part, length), scaling_of(flights.setting).length
    order = torch.randperm(len(dataset), generator=torch.Generator().manual_seed(seed))
    rows = dataset.starts[order[:count].numpy()][:, None] + np.arange(length)
    rows = rows[~flights.kick[rows].any(axis=(1, 2))]
    if not len(rows):
        raise InputError(
            f"{flights.folder}: all windows of the {part} part have a kick of the velocity: "
            "collect flights without kicks, too"
        )
    fixes, noises = [], []
    for start in range(0, rows.size, _FITTED):
        block = rows.ravel()[start : start + _FITTED]
        points, _, valid, _ = pilot.hits(
            torch.from_numpy(flights.frames(block).reshape(len(block), -1))
        )
        place = _tensor(flights.state[block, :3])
        drawn = torch.randn(place.shape, generator=torch.Generator().manual_seed(start))
        place = place + _FIX_START * off * drawn
        residual = place[:, :1]
        for _ in range(2):
            place, residual = pilot.geometry(place, points, valid)
        fixes.append(place)
        noises.append(measurement_noise(residual, pilot.usual_residual))
    fix, noise = (torch.cat(each).unflatten(0, rows.shape) for each in (fixes, noises))
    return fix, noise, _tensor(flights.commanded_force[rows]), _tensor(flights.state[rows])


def _tensor(values: np.ndarray) -> Tensor:
    return torch.from_numpy(np.ascontiguousarray(values, dtype=np.float32))
