"""Remarks on settings that are valid, but spoil flights and may be a mistake."""

from __future__ import annotations

import dataclasses as dc
import math
from collections.abc import Iterator

import numpy as np

from proxops.diagrams.scenario.body import Body
from proxops.diagrams.scenario.dispersions import Dispersions
from proxops.diagrams.scenario.keys import default_at, value_at
from proxops.diagrams.scenario.quantities import QUANTITIES
from proxops.diagrams.scenario.scenario_config import Scenario, TrueStateConfig, TruthConfig
from proxops.diagrams.scenario.spacecraft_model import RigidBodyConfig, load_spacecraft
from proxops.diagrams.scenario.tasks import Transit
from proxops.diagrams.scenario.tuning import expected_errors
from proxops.systems.navigation import LidarNavigationConfig
from proxops.systems.rotation import TorqueFreeSpin
from proxops.systems.shapes import clearances

# What a mended map tells of itself.
_OF_MAP = ("surface_rms_m", "size")
# Transits in a cube of this many lengths of the body are far away from it.
_FAR = 10.0
# A body of less than so many metres may be one whose unit is wrong.
_LEAST = 10.0
# A pulse of less than this share of the arrival's speed limit lets a spacecraft come to rest.
_PULSE = 0.1
# The MPC is not stable with a shorter horizon, in control periods.
_LEAST_HORIZON = 2.0


def scenario_remarks(scenario: Scenario, body: Body) -> list[str]:
    """Gives a sentence on each setting that spoils flights and that may be a mistake.

    Args:
      scenario: as the user gave it, before a draw. body: as believed.
    """
    parts = _untold, _tumbling, _moons, _proportions, _pulses, _reach, _mpc
    if not isinstance(scenario.task, Transit):  # It draws no transit and flies no MPC.
        parts = _untold, _tumbling
    return [remark for part in parts for remark in part(scenario, body)]


def _untold(scenario: Scenario, body: Body) -> Iterator[str]:
    """On errors of the world that the navigation does not expect at all."""
    settings = scenario.navigation
    # Dispersions tell the navigation what they disperse.
    if not isinstance(settings, LidarNavigationConfig) or scenario.dispersions is not None:
        return
    known = dc.replace(scenario, truth=TruthConfig())
    expected = settings.expected or expected_errors(Dispersions(known, body))
    told = {*(_OF_MAP if settings.map is not None else ())}
    if scenario.is_rigid:
        told.add("least_impulse_n_s")  # Its thrusters owe what is too little.
    for each in QUANTITIES:
        name = each.tunes
        if name is None or name in told:
            continue
        differs = value_at(scenario, each.key) != default_at(each.key)
        if differs and getattr(expected, name) == 0.0:
            yield (
                f"{each.key} is set, but the navigation expects no such error, so it may get lost: "
                f"give navigation.expected.{name} (one standard deviation), or disperse the value, "
                "which tells the navigation (docs/method/truth.md)"
            )


def _tumbling(scenario: Scenario, body: Body) -> Iterator[str]:
    """On a true body that tumbles while a steady spin is believed."""
    believed = isinstance(body.spin, TorqueFreeSpin)
    if scenario.truth.tumbles and not believed and scenario.navigation != TrueStateConfig():
        yield (
            "truth.tumbles is set, but a steady spin is believed: the navigation may get lost and "
            "the Δv may double; a body's file with `rotation: !TorqueFreeSpin {}` tells what is on "
            "board (docs/method/rotation.md)"
        )


def _moons(scenario: Scenario, body: Body) -> Iterator[str]:
    """On moons that a transit may meet."""
    far = math.sqrt(3.0) / 2.0 * scenario.transit.cube_m
    for moon, depth in zip(body.config.moons, body.moon_depths, strict=True):
        nearest = moon.semi_major_axis_m * (1.0 - moon.eccentricity) - moon.radius_m
        if moon.radius_m > 0.0 and depth == 0.0 and nearest < far:
            yield (
                f"a moon of {body.config.name} comes within {nearest:.4g} m of it, outside the "
                "keep-out ellipsoid: nothing on board avoids it, so a transit may end in it; an "
                "ellipsoid that holds its orbit keeps away from it"
            )


def _proportions(scenario: Scenario, body: Body) -> Iterator[str]:
    """On transits that are not made for this body."""
    length = float(body.shape.extents.max())
    if length < _LEAST:
        yield (
            f"{body.config.name} is {length:.3g} m long: if its mesh is in km, say so by mesh_unit "
            "of the body's file"
        )
    ratio = scenario.transit.cube_m / length
    if scenario.transit.start_m is None and ratio > _FAR:
        yield (
            f"transit.cube_m is {ratio:.0f} times the length of {body.config.name}: the scenario "
            "is made for another body; proxops shape FILE --scenario writes one in its proportions"
        )


def _pulses(scenario: Scenario, body: Body) -> Iterator[str]:
    """On thrusters that are too strong for the arrival's limits."""
    craft = scenario.spacecraft
    if not isinstance(craft, RigidBodyConfig):
        return
    layout, limit = load_spacecraft(craft.model).thrusters, scenario.arrival.speed_m_s
    pulse = float(layout.forces.max()) * layout.least_on_time / craft.mass_kg
    if pulse > _PULSE * limit:
        yield (
            f"the least pulse of a thruster of {craft.model} changes the speed by {pulse:.2g} m/s, "
            f"and arrival.speed_m_s is {limit:.2g}: the spacecraft may never come to rest; raise "
            "arrival.speed_m_s, or take a model with weaker thrusters"
        )


def _reach(scenario: Scenario, body: Body) -> Iterator[str]:
    """On a lidar that sees nothing where a transit begins."""
    if not isinstance(scenario.navigation, LidarNavigationConfig):
        return
    reach, start = scenario.lidar.max_range_m, scenario.transit.start_m
    # The middles of the cube's faces, unless the scenario gives its start.
    starts = 0.5 * scenario.transit.cube_m * np.eye(3) if start is None else np.array([start])
    far = np.linalg.norm(starts[:, None] - body.shape.vertices, axis=2).min(axis=1).max()
    if reach < far:
        where = "a transit may begin" if start is None else "the transit begins"
        yield (
            f"lidar.max_range_m is {reach:g} m, and {where} {far:.3g} m from the surface: nothing "
            "returns there, so the navigation cannot know where it is; give a longer range, or a "
            "start that is nearer"
        )


def _mpc(scenario: Scenario, body: Body) -> Iterator[str]:
    """On settings that the MPC can't fly well with."""
    least = _LEAST_HORIZON * scenario.control_period_s
    if scenario.mpc.min_horizon_s < least:
        yield (
            f"mpc.min_horizon_s, {scenario.mpc.min_horizon_s:g} s, is below twice "
            f"control_period_s: the MPC is not stable then; give at least {least:g}"
        )
    goal, margin = scenario.transit.goal_m, scenario.mpc.keep_out_margin_m
    if goal is not None:
        clearance = float(clearances(body.keep_out_semi_axes, np.array([goal]))[0])
        if 0.0 <= clearance < margin:
            yield (
                f"transit.goal_m is {clearance:.4g} m outside the keep-out ellipsoid, less than "
                f"mpc.keep_out_margin_m, {margin:g} m: the MPC stops short of it"
            )
