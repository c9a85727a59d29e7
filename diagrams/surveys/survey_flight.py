"""Flies a survey: from afar into an orbit, and around until its time is over."""

from __future__ import annotations

import dataclasses as dc
import math
from typing import NamedTuple

import numpy as np
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, EventStatus, LeafSystem

from proxops.diagrams.flight import diagram_of, let_go, make_simulator
from proxops.diagrams.scenario import (
    Body,
    Scenario,
    SurveyConfig,
    Transit,
    World,
    draw_world,
    greatest_from_sky,
    make_true_body,
    survey_errors,
)  # fmt: skip
from proxops.systems.assurance import SphereAssurance, SphereLimits
from proxops.systems.common import (
    InputError,
    Matrix3,
    Progress,
    States,
    Values,
    Vector3,
    Vectors3,
    generator,
    rotation_matrix,
    silent,
)
from proxops.systems.gravity import GRAVITATIONAL_CONSTANT
from proxops.systems.mapping import FEWEST, HIGHEST, Around, Returns, SurveyController
from proxops.systems.rotation import TorqueFreeSpin
from proxops.systems.shapes import clearances

# The orbit's radius, over the longest semi-axis, with what that may be off; and over the radius of
# an orbit that turns with the body.
_LONGEST, _SYNCHRONOUS = 2.4, 1.7
# And over how far out moons come that are near.
_OUTSIDE = 1.8
# A body turns so slowly that it hardly matters where that orbit is so many times as far out.
_SLOW = 2.0
# The body turns by no more than so many degrees from frame to frame.
_TURNED = 3.0
# The ellipsoid is known to this share of each axis, at one standard deviation.
_ELLIPSOID = 0.1 / 3.0
# A survey starts at so many sizes, on its way to a lowest point of so many radii of its orbit. For
# an orbit of more than four semi-axes, half its radius is the size: so the lowest point is never
# beyond the start.
_FROM, _PASSES = (4.0, 6.0), (0.5, 2.0)
# Radial pull at the sphere that holds the body, over that of a point mass: at the bodies that ship
# it is at most 3.1, off Kleopatra's tips.
_PULL = 3.2
# How far the lidar reaches in a survey, in sizes.
_REACH = 8.0


class SurveyFlight(NamedTuple):
    """What a survey's flight gave. What the estimator sees is `returns`."""

    returns: Returns
    around: Around
    orbit_time: float
    """s from the start to the orbit."""
    delta_v: float
    """m/s that the spacecraft's commands gave."""
    clearance: float
    """The least distance in m to the body's keep-out ellipsoid: negative within."""
    entries: int
    """How often it entered the keep-out sphere of `Around`."""
    interventions: int
    """Of runtime assurance, in control steps."""
    hours: float
    """Time in orbit in h."""
    collided: bool
    rays: np.ndarray
    """(R,): of each return the number of its ray."""
    times: Values
    """(N,) in s, of all control steps. What follows is true: only the truth may hold it."""
    states: States
    """(N, 6) in m and m/s in K."""
    attitudes: np.ndarray
    """(N, 4): R_KS as a unit quaternion."""
    forces: Vectors3
    """(N, 3) in N along the axes of S: the commands, or what a rigid spacecraft gave."""
    world: World


def known_ellipsoid(scenario: Scenario, body: Body) -> Vector3:
    """Semi-axes (3,) in m of the ellipsoid that a survey knows."""
    task = scenario.task
    assert isinstance(task, SurveyConfig)
    if task.semi_axes_m is not None:
        return np.array(task.semi_axes_m)
    random = generator(scenario.transit.seed, scenario.transit.index, 1)
    errors = np.clip(random.standard_normal(3), -3.0, 3.0)
    return 0.5 * body.shape.extents * (1.0 + _ELLIPSOID * errors)


def around_of(scenario: Scenario, body: Body) -> Around:
    """What is known of a body to survey, and the orbit that is flown around it.

    Raises:
      InputError: the scenario is no survey, or its orbit would be too low.
    """
    if not isinstance(scenario.task, SurveyConfig):
        raise InputError("the scenario's task is no survey: set task: !Survey {}")
    tumbling = body.spin if isinstance(body.spin, TorqueFreeSpin) else None
    if tumbling is None and not body.spin.about_z:
        raise InputError(
            f"{body.config.name} turns about another axis than z of its frame: turn its mesh, so "
            "that it can be surveyed"
        )
    rate = body.spin_about_z if tumbling is None else body.spin_rate
    axes = known_ellipsoid(scenario, body)
    gm = body.gravity_field.mass * GRAVITATIONAL_CONSTANT
    errors = survey_errors(scenario, body)
    longest = float(axes.max()) * (1.0 + 3.0 * _ELLIPSOID)
    synchronous = np.cbrt(gm * (1.0 + 3.0 * errors.gravity) / rate**2)
    radius, keep_out = _LONGEST * longest, longest
    if synchronous < _SLOW * radius:
        radius = max(radius, _SYNCHRONOUS * synchronous)
    for moon in body.config.moons:
        low, high = (1.0 + sign * moon.eccentricity for sign in (-1.0, 1.0))
        reach = high * moon.semi_major_axis_m + moon.radius_m
        # The orbit is outside of theirs, or far inside.
        inside = scenario.task.radius_m or HIGHEST * radius
        if low * moon.semi_major_axis_m - moon.radius_m < inside:
            radius, keep_out = max(radius, _OUTSIDE * reach), max(keep_out, reach)
    radius = scenario.task.radius_m or radius
    if radius < longest:
        raise InputError(
            f"task.radius_m: an orbit of {radius:.3g} m is not outside of any body that the "
            f"ellipsoid permits, of {longest:.3g} m"
        )
    start, reach = _FROM[1] * _size(axes, radius), scenario.task.reach_m
    if reach is not None and reach < start:
        raise InputError(
            f"task.reach_m: the lidar never sees the body: it reaches {reach:.4g} m, and the "
            f"survey starts up to {start:.4g} m away"
        )
    turned = math.degrees(abs(rate) * scenario.task.period_s)
    if turned > _TURNED:
        raise InputError(
            f"the body spins too fast for its survey: it turns by {turned:.3g} degrees from "
            f"frame to frame, at most {_TURNED:g} are allowed; set task.period_s lower"
        )
    return Around(
        axes, gm, errors.gravity, rate, radius, keep_out, errors.acceleration, errors.varying,
        errors.varying_time, body.config.moons, tumbling,
    )  # fmt: skip


def _size(semi_axes: Vector3, radius: float) -> float:
    """The length in m by which a survey's start is far away: see `_FROM`."""
    return max(2.0 * float(semi_axes.max()), 0.5 * radius)


def survey_world(scenario: Scenario, body: Body) -> World:
    """The world of a survey, whose transit begins far away."""
    around, drawn = around_of(scenario, body), draw_world(scenario, body)
    # The gentle limits are of no use where K turns beneath: the controller has its own.
    assert isinstance(drawn.task, SurveyConfig)
    craft = dc.replace(drawn.spacecraft, speed_limit_m_s=1e5)
    size = _size(around.semi_axes, around.radius)
    reach = drawn.task.reach_m or _REACH * size
    lidar = dc.replace(drawn.lidar, max_range_m=reach)
    period = drawn.task.period_s
    # Runtime assurance of a survey is a part of its controller.
    drawn = dc.replace(
        drawn, spacecraft=craft, lidar=lidar, control_period_s=period, assurance=None
    )
    random = generator(scenario.transit.seed, scenario.transit.index, 2)
    start = random.standard_normal(3)
    start *= size * random.uniform(*_FROM) / np.linalg.norm(start)
    distance, up = float(np.linalg.norm(start)), start / np.linalg.norm(start)
    side = np.cross(up, random.standard_normal(3))
    side /= np.linalg.norm(side)
    low = around.radius * random.uniform(*_PASSES)
    speed = math.sqrt(2.0 * around.gm / distance)
    across = math.sqrt(low / distance)
    velocity = speed * (across * side - math.sqrt(1.0 - across**2) * up)
    true_body = make_true_body(body, drawn.truth)
    turning = velocity - np.cross(true_body.spin.rate, start)
    ends = start, 100.0 * start
    seed, index = scenario.transit.seed, scenario.transit.index
    return World(drawn, body, true_body, Transit(seed, index, *ends, turning))


def sphere_limits(scenario: Scenario, body: Body, thrust: float) -> SphereLimits:
    """What `SphereAssurance` promises of a survey, whose thrust gives so much in m/s^2.

    Of what is dispersed the ends count, three standard deviations.
    """
    around, errors = around_of(scenario, body), survey_errors(scenario, body)
    task, mass = scenario.task, scenario.spacecraft.mass_kg
    assert isinstance(task, SurveyConfig)
    far = _FROM[1] * _size(around.semi_axes, around.radius)
    pull = _PULL * around.gm * (1.0 + 3.0 * errors.gravity) / around.keep_out**2
    push = 3.0 * math.sqrt(3.0) * math.hypot(errors.acceleration, errors.varying)
    push += greatest_from_sky(scenario, body, mass, far)[1]
    # A moon pulls the most at the ball about it, which nothing should enter.
    moons = [moon for moon in body.config.moons if moon.radius_m > 0.0]
    push += sum(GRAVITATIONAL_CONSTANT * each.mass_kg / each.radius_m**2 for each in moons)
    return SphereLimits(around.keep_out, pull + push, thrust, 3.0 * errors.thrust, task.period_s)


def _with_assurance(controller: SurveyController, assurance: SphereAssurance) -> Diagram:
    """A controller under runtime assurance, with the ports of a controller."""
    builder = DiagramBuilder()
    builder.AddSystem(controller)
    builder.AddNamedSystem("assurance", assurance)
    for name in ("state", "force", "deviations"):
        builder.Connect(controller.GetOutputPort(name), assurance.GetInputPort(name))
    builder.Connect(assurance.GetOutputPort("force"), controller.GetInputPort("given_force"))
    for name in ("ranges", "body_attitude"):
        builder.ExportInput(controller.GetInputPort(name), name)
    builder.ExportOutput(assurance.GetOutputPort("force"), "force")
    builder.ExportOutput(controller.GetOutputPort("state"), "state")
    assured = builder.Build()
    assured.set_name("assured_controller")
    return assured


class Flying:
    """A survey's flight that can be flown on."""

    def __init__(self, scenario: Scenario, body: Body):
        """Takes a scenario with a survey as its task, and the body as believed.

        Of the body's mesh only the extents count.

        Raises:
          InputError: see `around_of`.
        """
        self._around, task = around_of(scenario, body), scenario.task
        assert isinstance(task, SurveyConfig)
        self._task = task
        self._world = survey_world(scenario, body)
        craft, lidar = self._world.scenario.spacecraft, self._world.scenario.lidar_geometry
        limit = craft.thrust_limit_n
        if self._world.scenario.is_rigid:  # Along its own axes, wherever these point.
            limit /= math.sqrt(3.0)
        self._controller = SurveyController(
            self._around, lidar.directions, craft.mass_kg, limit, task.period_s,
            survey_errors(scenario, body).least_impulse,
        )  # fmt: skip
        self._controller.set_name("controller")
        commanding, flies = self._controller, self._controller
        if scenario.assurance is not None:
            limits = sphere_limits(scenario, body, limit / craft.mass_kg)
            deviations = scenario.assurance.deviations
            commanding = SphereAssurance(limits, craft.mass_kg, deviations)
            flies = _with_assurance(self._controller, commanding)
        self._diagram = diagram_of(self._world, flies)
        self._kept = _Kept(self._diagram, self._controller, commanding, self._world)
        self._simulator = make_simulator(self._diagram, self._world.scenario)

    def fly(self, hours: float, progress: Progress = silent) -> SurveyFlight:
        """Flies on for at least so long in orbit, all in all, and until the surface is seen.

        It ends at `task.hours` anyway. `progress` is called with the share of that time.

        Raises:
          InputError: the body is never seen, or the orbit is not reached in time.
        """
        task, controller = self._task, self._controller
        enough = 1.0 if task.enough is None else task.enough.covered
        if task.enough is None:
            hours = task.hours

        def monitor(context: Context) -> EventStatus:
            own = controller.GetMyContextFromRoot(context)
            self._kept.keep(context, own)
            over, seen = controller.kept_for(own) / 3600.0, controller.seen(own)
            time = context.get_time() / 3600.0
            progress(over / task.hours, f"{time:.1f} h, {seen:.0%} of the surface seen")
            if over >= task.hours or (over >= hours and seen >= enough):
                return EventStatus.ReachedTermination(controller, "enough was seen")
            return EventStatus.DidNothing()

        self._simulator.set_monitor(monitor)
        self._simulator.AdvanceTo(3600.0 * (task.hours + task.approach_hours))
        own = controller.GetMyContextFromRoot(self._simulator.get_context())
        return self._kept.flight(self._around, controller.kept_for(own) / 3600.0)

    def close(self) -> None:
        """Lets the diagram go."""
        let_go(self._diagram, None)


class _Kept:
    """What a survey's flight leaves: the returns, and figures of it."""

    def __init__(
        self, diagram: Diagram, controller: SurveyController, commanding: LeafSystem, world: World
    ):
        """Takes the diagram, its controller, and what gives the force in the end."""
        self._diagram, self._controller, self._world = diagram, controller, world
        self._commanding, self._period = commanding, world.scenario.control_period_s
        self._interventions = 0
        self._times: list[float] = []
        self._frames: list[tuple[np.ndarray, np.ndarray]] = []
        self._axes: list[Matrix3] = []
        self._forces: list[np.ndarray] = []
        self._states: list[np.ndarray] = []
        self._attitudes: list[np.ndarray] = []
        self._orbit: float | None = None

    def keep(self, context: Context, own: Context) -> None:
        """Keeps what there is at a control step."""
        now = context.get_time()
        if abs(now / self._period - round(now / self._period)) > 1e-6:
            return

        def output(system: str, port: str) -> np.ndarray:
            found = self._diagram.GetSubsystemByName(system)
            return found.GetOutputPort(port).Eval(found.GetMyContextFromRoot(context)).copy()

        masked = self._diagram.HasSubsystemNamed("moon_mask")
        ranges = output("moon_mask" if masked else "lidar", "ranges")
        lidar = self._diagram.GetSubsystemByName("lidar")
        port, within = lidar.GetInputPort("attitude"), lidar.GetMyContextFromRoot(context)
        turned = port.HasValue(within)
        self._attitudes.append(port.Eval(within).copy() if turned else np.eye(4)[0])
        seen = np.flatnonzero(np.isfinite(ranges))
        self._states.append(output("spacecraft", "state"))
        self._times.append(now)
        self._frames.append((seen, ranges[seen]))
        axes = np.eye(3)
        if self._world.scenario.is_rigid:
            axes = rotation_matrix(output("attitude_filter", "body_attitude"))
            if self._forces:  # What was given since the last step.
                self._forces[-1] = output("given_force", "mean_force")
        self._axes.append(axes)
        within = self._commanding.GetMyContextFromRoot(context)
        self._forces.append(self._commanding.GetOutputPort("force").Eval(within).copy())
        wanted = self._controller.GetOutputPort("force").Eval(own)
        self._interventions += int((self._forces[-1] != wanted).any())
        if self._orbit is None and self._controller.kept_for(own) > 0.0:
            self._orbit = now

    def flight(self, around: Around, hours: float) -> SurveyFlight:
        """The flight.

        Raises:
          InputError: it did not come to its orbit.
        """
        if self._orbit is None:
            if max(len(seen) for seen, _ in self._frames) < FEWEST:
                raise InputError(
                    "the lidar never saw the body: check lidar.max_range_m, its rays and field of "
                    "view, and task.reach_m"
                )
            raise InputError(
                "the survey did not come to its orbit in time: set task.approach_hours higher"
            )
        scenario, body = self._world.scenario, self._world.body
        times = np.array(self._times)
        chosen = np.flatnonzero(times >= self._orbit)
        attitudes = np.array([around.turn(time) for time in times[chosen].tolist()])
        forces, mass = np.array(self._forces), scenario.spacecraft.mass_kg
        thrusts = np.einsum("fij,fj->fi", attitudes, forces[chosen]) / mass
        attitudes = attitudes @ np.array(self._axes)[chosen]
        directions = scenario.lidar_geometry.directions
        rays = [self._frames[k] for k in chosen]
        returns = Returns(
            times[chosen], attitudes,
            thrusts,
            np.repeat(np.arange(len(chosen)), [len(seen) for seen, _ in rays]),
            directions[np.concatenate([seen for seen, _ in rays])],
            np.concatenate([ranges for _, ranges in rays]),
        )  # fmt: skip
        places = np.array(self._states)[:, :3]
        within = np.linalg.norm(places, axis=1) < around.keep_out
        inside = self._world.true_body.gravity_field.evaluate(places).inside
        return SurveyFlight(
            returns, around, self._orbit,
            float(np.abs(forces).sum() * self._period / mass),
            float(clearances(body.keep_out_semi_axes, places).min()),
            int(within[0]) + int((within[1:] & ~within[:-1]).sum()), self._interventions, hours,
            bool(inside.any()), np.concatenate([seen for seen, _ in rays]),
            times, np.array(self._states), np.array(self._attitudes), forces, self._world,
        )  # fmt: skip
