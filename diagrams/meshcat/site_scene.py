"""Draws the place of a touch-and-go: the corridor that leads to it, and how much of the body."""

from __future__ import annotations

import math
import typing

import numpy as np
from pydrake.geometry import Rgba

from proxops.diagrams.meshcat.meshcat_scene import Scene
from proxops.diagrams.scenario import Scenario, TouchAndGoConfig, touch_site
from proxops.systems.touch import tangents

_CORRIDOR = Rgba(1.00, 0.85, 0.35)
_SIDES = 24


def part_shown(scenario: Scenario) -> float | None:
    """How large the part of the body is in m that a touch without a transit shows; None: all."""
    task = scenario.task
    if not isinstance(task, TouchAndGoConfig) or task.transit:
        return None
    return task.descent.home_m


def add_site(scene: Scene, scenario: Scenario) -> None:
    """Adds the corridor of a touch-and-go: its edge at the ground and at each gate, and sides."""
    task = scenario.task
    if not isinstance(task, TouchAndGoConfig):
        return
    site, descent = touch_site(scenario, scene.body), task.descent
    first, second = (axis[0] for axis in tangents(site.normal[None]))
    turn = 2.0 * math.pi * np.arange(_SIDES) / _SIDES
    across = np.cos(turn)[:, None] * first + np.sin(turn)[:, None] * second
    slope = math.tan(math.radians(descent.cone_deg))
    heights = (0.0, descent.matchpoint_m, descent.checkpoint_m, descent.home_m)
    rings = [
        site.position + high * site.normal + (descent.room_m + slope * high) * across
        for high in heights
    ]
    starts = np.concatenate([*rings, rings[0][::6]])
    ends = np.concatenate([*(np.roll(ring, -1, axis=0) for ring in rings), rings[-1][::6]])
    both: list[typing.Any] = [(points / scene.unit).T for points in (starts, ends)]
    scene.meshcat.SetLineSegments("/site/corridor", *both, 1.0, _CORRIDOR)
