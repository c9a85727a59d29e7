"""What touching takes of a scenario: the world of its places, and a spacecraft with an arm."""

from __future__ import annotations

import dataclasses as dc
import typing
from collections.abc import Sequence

import numpy as np
from pydrake.geometry import Cylinder, Sphere
from pydrake.math import RigidTransform

from proxops.diagrams.scenario.body import Body, apparent_gravity
from proxops.diagrams.scenario.scenario_config import Scenario
from proxops.diagrams.scenario.spacecraft_model import (
    RigidBodyConfig,
    SpacecraftModel,
    load_spacecraft,
)
from proxops.diagrams.scenario.spacecraft_solids import CORNERS, Solid, solids_of
from proxops.diagrams.scenario.tasks import TouchAndGoConfig
from proxops.systems.attitude import AttitudeGuidanceConfig
from proxops.systems.common import InputError, Vector3, Vectors3, generator, rotation_matrix
from proxops.systems.shapes import clearances
from proxops.systems.touch import (
    LIMITS,
    Arm,
    Site,
    SiteLimits,
    Sites,
    SiteWorld,
    TouchCraft,
    best_sites,
    inertia_without_head,
    map_sites,
    measured_sites,
    nearest_site,
    place_below,
    place_near,
    use_of_limits,
    why_not,
)
from proxops.systems.vehicle import sun_direction

# Times in a turn of the body at which it is looked where the Sun is.
_TIMES = 72
# How far off the map a position may be, in radii of the disc.
_OFF = 1.0
# The arm's direction in S. It points at a place so deep, in m, that where the spacecraft is does
# not turn it.
_DOWN, _DEEP = (0.0, 0.0, -1.0), 1e6
# Stream of the draw of where a lone boulder lies.
_BESIDE = 4
# Radius in m of the rod as which the arm is drawn, along _DOWN.
_ROD = 0.05


def touch_map(scenario: Scenario, body: Body, limits: SiteLimits) -> tuple[Sites, np.ndarray]:
    """Measures all places of a body: they and their use of the limits (N, 6).

    Raises:
      InputError: none can be touched; the message says what most of them lack.
    """
    thrust, world = scenario.spacecraft.thrust_limit_n, site_world(scenario, body)
    sites, _ = map_sites(body.shape, limits, world)
    use = use_of_limits(sites, limits, thrust)
    if (use.max(axis=1) > 1.0).all():
        lacking = LIMITS[int((use > 1.0).sum(axis=0).argmax())]
        near = int(use.max(axis=1).argmin())
        why = "; ".join(why_not(sites, use, near, limits, thrust))
        raise InputError(
            f"no place of {body.config.name} can be touched, most for their {lacking}. The best is "
            f"{_place_text(sites, near)}, but {why}"
        )
    return sites, use


def place_of(
    scenario: Scenario, body: Body, limits: SiteLimits, at: Sequence[float], name: str
) -> tuple[Sites, np.ndarray]:
    """Measures one place: it and its use of the limits (1, 6).

    Args:
      scenario, body, limits: see `touch_map`.
      at: latitude and longitude in degrees, or a position in m in K; the place is the map's point
        there that is nearest.
      name: of `at`, with which messages begin.

    Raises:
      InputError: it is off the map, or cannot be touched; the message gives the nearest that can.
    """
    if len(at) not in (2, 3) or not np.isfinite(at).all():
        raise InputError(f"{name}: give LAT,LON in degrees or X,Y,Z in m, such as 55,40")
    if len(at) == 2:
        point, facet = place_below(body.shape, *at)
    else:
        position = np.array(at, dtype=float)
        try:
            point, facet = place_near(body.shape, position, _OFF * limits.radius_m)
        except InputError as error:
            near = _nearest_text(*touch_map(scenario, body, limits), position)
            raise InputError(f"{name}: {error}; {near}") from error
    world, thrust = site_world(scenario, body), scenario.spacecraft.thrust_limit_n
    place = measured_sites(body.shape, point[None], body.shape.normals[facet][None], limits, world)
    use = use_of_limits(place, limits, thrust)
    lacking = why_not(place, use, 0, limits, thrust)
    if lacking:
        near = _nearest_text(*touch_map(scenario, body, limits), point)
        raise InputError(f"{name} cannot be touched: {'; '.join(lacking)}; {near}")
    return place, use


def _nearest_text(sites: Sites, use: np.ndarray, position: Vector3) -> str:
    near = nearest_site(sites, use, position)
    assert near is not None
    return f"the nearest place that can be is {_place_text(sites, near)}"


def _place_text(sites: Sites, k: int) -> str:
    return f"{sites.latitudes[k]:.2f},{sites.longitudes[k]:.2f}"


def with_site(scenario: Scenario, body: Body) -> Scenario:
    """The scenario of a touch-and-go with its site as a position, and pointed at it.

    Any other scenario is given back. A site that is a position already stays as it is, so that a
    flight can be repeated bit for bit.

    Raises:
      InputError: the spacecraft is a point, or too light for its arm; or no place, or not this one,
        can be touched.
    """
    task, craft = scenario.task, scenario.spacecraft
    if not isinstance(task, TouchAndGoConfig):
        return scenario
    if not isinstance(craft, RigidBodyConfig):
        raise InputError("a touch-and-go needs a spacecraft of some size: spacecraft: !RigidBody")
    check_arm(craft, task)
    if task.site is None:
        sites, use = touch_map(scenario, body, task.limits)
        if task.transit:
            high = task.arm_m + task.descent.home_m
            homes = sites.positions + high * sites.normals
            margin = scenario.mpc.keep_out_margin_m
            reached = clearances(body.keep_out_semi_axes, homes) >= margin
            if (reached & (use <= 1.0).all(axis=1)).any():
                sites, use = sites.taken(reached), use[reached]
        best = int(best_sites(sites, use, 1, 1.0)[0])
        task = dc.replace(task, site=sites.positions[best].tolist())
    elif len(task.site) != 3:
        place, _ = place_of(scenario, body, task.limits, task.site, "task.site")
        task = dc.replace(task, site=place.positions[0].tolist())
    made = dc.replace(scenario, task=task)
    down = (np.array(task.site) - _DEEP * touch_site(made, body).normal).tolist()
    pointing = AttitudeGuidanceConfig(mode="body", place_m=down, boresight=list(_DOWN))
    made.spacecraft = dc.replace(craft, pointing=pointing)
    boulders, rules = made.truth.boulders, made.transit
    if boulders.lone_m and not any(boulders.lone_at_m):
        beside = generator(rules.seed, rules.index, _BESIDE).uniform(-0.5, 0.5, 3)
        at = (np.array(task.site) + boulders.lone_m * beside).tolist()
        made.truth = dc.replace(made.truth, boulders=dc.replace(boulders, lone_at_m=at))
    return made


def touch_site(scenario: Scenario, body: Body) -> Site:
    """Where the centre of mass is at contact, and the normal there, of a scenario `with_site`.

    Raises:
      InputError: the site cannot be touched.
    """
    task = scenario.task
    assert isinstance(task, TouchAndGoConfig)
    assert task.site is not None
    place, _ = place_of(scenario, body, task.limits, task.site, "task.site")
    normal = place.normals[0]
    return Site(np.array(task.site) + task.arm_m * normal, normal)


def touch_ends(scenario: Scenario, body: Body) -> tuple[Vector3, Vector3]:
    """Where a touch-and-go begins, (3,) in m in K, and home, where it ends."""
    task, site = scenario.task, touch_site(scenario, body)
    assert isinstance(task, TouchAndGoConfig)
    home = site.position + task.descent.home_m * site.normal
    if scenario.transit.start_m is not None:
        return np.array(scenario.transit.start_m), home
    random = generator(scenario.transit.seed, scenario.transit.index, 3)
    side = np.cross(site.normal, random.standard_normal(3))
    return home + task.aside_m * side / np.linalg.norm(side), home


def touch_arm(task: TouchAndGoConfig) -> Arm:
    """The arm of a touch-and-go."""
    down = np.array(_DOWN)
    return Arm((task.arm_m - Arm._field_defaults["head_radius"]) * down, down)


def check_arm(craft: RigidBodyConfig, task: TouchAndGoConfig) -> None:
    """Raises `InputError` if a spacecraft, as believed, is too light for the head of its arm."""
    model = load_spacecraft(craft.model)
    inertia = craft.mass * model.bus_inertia  # As of the contact plant.
    inertia_without_head(touch_craft(model, touch_arm(task))._replace(inertia=inertia))


def arm_solids(task: TouchAndGoConfig) -> list[Solid]:
    """What an arm looks like: a rod from the centre of mass, and the head."""
    arm = touch_arm(task)
    middle: typing.Any = 0.5 * np.array(arm.place)
    end: typing.Any = np.array(arm.place)
    rod, high = Cylinder(_ROD, float(np.linalg.norm(end))), arm.head_radius
    return [
        Solid(shape, RigidTransform(place), place + size * CORNERS, None)
        for shape, place, size in ((rod, middle, np.abs(middle) + _ROD), (Sphere(high), end, high))
    ]


def site_world(scenario: Scenario, body: Body) -> SiteWorld:
    """Apparent gravity at the start, the spacecraft's mass, and the Sun over one turn of the body.

    Args:
      scenario: of its Sun there is none unless it has `sunlight`. body: as believed.
    """

    def acceleration(positions: Vectors3) -> Vectors3:
        gravity = body.exact_field.evaluate(positions).acceleration
        return apparent_gravity(gravity, positions, body.spin)

    suns = np.zeros((0, 3))
    if scenario.sunlight is not None:
        times = np.arange(_TIMES) / _TIMES * 2.0 * np.pi / body.spin_rate
        suns = np.array(
            [
                rotation_matrix(body.spin.attitude(time)).T @ sun_direction(time, scenario.sunlight)
                for time in times.tolist()
            ]
        )
    return SiteWorld(acceleration, scenario.spacecraft.mass_kg, suns)


def touch_craft(model: SpacecraftModel, arm: Arm) -> TouchCraft:
    """A rigid spacecraft with an arm, whose solids may touch the ground.

    Args:
      model: mass and inertia, arm included, and solids. Each stands for the box about it along S's
        axes. arm: where it is, and how it gives way.
    """
    parts = {}
    for k, solid in enumerate(solids_of(model)):
        low, high = solid.corners.min(axis=0), solid.corners.max(axis=0)
        parts[f"solid {k}"] = (0.5 * (low + high), high - low)
    return TouchCraft(model.mass, model.inertia, arm, parts)
