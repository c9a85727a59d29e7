"""Events of scripted flights against the times at which geometry says they happen."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest
import trimesh
from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator, SimulatorStatus
from pydrake.systems.framework import BasicVector, DiagramBuilder, LeafSystem
from pydrake.systems.primitives import ConstantVectorSource, LogVectorOutput
from scipy.interpolate import CubicSpline
from trimesh.ray.ray_triangle import RayMeshIntersector

from proxops.diagrams.scenario.body import load_body
from proxops.systems import FlightMonitor, GravityField, Polyhedron
from proxops.systems.shapes.ellipsoid import clearances
from proxops.systems.vehicle.flight_events import (
    COLLIDED,
    ENTERED_GOAL,
    FINISHED,
    NEVER,
    VIOLATIONS,
    FlightEvents,
    containing_ellipsoid,
)

KEEP_OUT = np.array([40e3, 30e3, 25e3])
RADIUS, SPEED, DWELL = 1e3, 1.0, 600.0
PERIOD = 10.0
Script = Callable[[float], np.ndarray]


def cube() -> GravityField:
    """20 km along each edge, about the origin."""
    mesh = trimesh.creation.box(extents=3 * [20e3])
    return GravityField(Polyhedron.from_trimesh(mesh, "m"), density=2000.0)


class Scripted(LeafSystem):
    """A state that is a function of time."""

    def __init__(self, script: Script):
        super().__init__()
        # A continuous state, so that time passes in an integrator's steps.
        self.DeclareContinuousState(BasicVector([0.0]))
        self.DeclareVectorOutputPort(
            "state",
            6,
            lambda context, output: output.SetFromVector(script(context.get_time())),
            prerequisites_of_calc={self.time_ticket()},
        )

    def DoCalcTimeDerivatives(self, context, derivatives):  # noqa: N802
        derivatives.get_mutable_vector().SetFromVector([1.0])


class Flown(NamedTuple):
    end: float
    reason: SimulatorStatus.ReturnReason
    times: np.ndarray
    outcomes: np.ndarray
    """(N, 4), every control period."""

    @property
    def last(self) -> np.ndarray:
        return self.outcomes[-1]


REACHED = SimulatorStatus.ReturnReason.kReachedTerminationCondition
RAN_OUT = SimulatorStatus.ReturnReason.kReachedBoundaryTime


def watch(
    script: Script,
    target=(300e3, 0.0, 0.0, 0.0, 0.0, 0.0),
    until: float = 2000.0,
    field: GravityField | None = None,
    keep_out=KEEP_OUT,
    speed=SPEED,
) -> Flown:
    builder = DiagramBuilder()
    flight = builder.AddSystem(Scripted(script))
    goal = builder.AddSystem(ConstantVectorSource(np.array(target, dtype=float)))
    monitor = builder.AddSystem(
        FlightMonitor(FlightEvents(field or cube(), keep_out, RADIUS, speed, DWELL))
    )
    builder.Connect(flight.get_output_port(), monitor.GetInputPort("state"))
    builder.Connect(goal.get_output_port(), monitor.GetInputPort("target"))
    sink = LogVectorOutput(monitor.GetOutputPort("outcome"), builder, publish_period=PERIOD)
    diagram = builder.Build()
    simulator = Simulator(diagram)
    simulator.get_mutable_context().SetAccuracy(1e-6)
    ResetIntegratorFromFlags(simulator, "runge_kutta5", PERIOD)
    simulator.Initialize()
    status = simulator.AdvanceTo(until)
    assert status.reason() != SimulatorStatus.ReturnReason.kEventHandlerFailed
    context = simulator.get_context()
    log = sink.FindLog(context)
    last = monitor.GetOutputPort("outcome").Eval(monitor.GetMyContextFromRoot(context))
    outcomes = np.concatenate([log.data().T, last[None]])
    return Flown(
        context.get_time(), status.reason(), np.append(log.sample_times(), context.get_time()),
        outcomes,
    )  # fmt: skip


def straight(start, velocity) -> Script:
    state, velocity = np.array([*start, *velocity], dtype=float), np.array(velocity, dtype=float)
    return lambda time: state + time * np.append(velocity, np.zeros(3))


# Arrival

GOAL = np.array([100e3, 20e3, -30e3])


def past_the_goal(distances: CubicSpline) -> Script:
    """As far from the goal as a spline says, in m along y; its knots are at control steps."""
    rate = distances.derivative()

    def script(time: float) -> np.ndarray:
        time = min(time, distances.x[-1])  # Then it stays.
        state = np.concatenate([GOAL, np.zeros(3)])
        state[[1, 4]] += distances(time), rate(time)
        return state

    return script


def goal_flight(script: Script, until: float = 3000.0, speed: float = SPEED) -> Flown:
    return watch(script, target=[*GOAL, 0.0, 0.0, 0.0], until=until, speed=speed)


def test_enters_dwells_and_ends():
    # 0.9 m/s towards the goal, from 1 km + 0.9 * 123.456 away: on its way for 2,222 s within.
    distance = RADIUS + 0.9 * 123.456
    flown = goal_flight(straight(GOAL - [distance, 0, 0], [0.9, 0, 0]))
    assert flown.last[ENTERED_GOAL] == pytest.approx(123.456, abs=1e-3)
    assert flown.end == 730.0  # The first control step after the dwell.
    assert flown.reason == REACHED
    assert flown.last.tolist()[1:] == [0.0, 0.0, 1.0]
    # Before that it says so.
    before = flown.outcomes[flown.times < 123.0]
    assert np.all(before == [NEVER, 0.0, 0.0, 0.0])


def test_leaving_starts_the_dwell_anew():
    times = [0.0, 100.0, 150.0, 200.0, 300.0, 400.0, 500.0]
    offsets = CubicSpline(times, [1100.0, 1010.0, 500.0, 990.0, 1300.0, 1010.0, 10.0])
    first, left, again = offsets.solve(RADIUS, extrapolate=False)
    flown = goal_flight(past_the_goal(offsets), speed=100.0)
    entered = flown.outcomes[:, ENTERED_GOAL]
    inside = (flown.times > first) & (flown.times < left)
    away = (flown.times > left) & (flown.times < again)
    assert inside.sum() > 5 < away.sum()
    assert entered[inside] == pytest.approx(np.full(inside.sum(), first), abs=1e-6)
    assert np.all(entered[away] == NEVER)
    assert flown.last[ENTERED_GOAL] == pytest.approx(again, abs=1e-6)
    assert flown.end == PERIOD * np.ceil((again + DWELL) / PERIOD)
    assert flown.last[FINISHED] == 1.0


@pytest.mark.parametrize(("dwelt", "arrives"), [(DWELL - 1.0, False), (DWELL + 1.0, True)])
def test_leaving_at_the_last_moment(dwelt, arrives):
    """In at 105 s, and out in the middle of a control period."""
    middle, half = 105.0 + 0.5 * dwelt, 0.5 * dwelt
    times = np.arange(0.0, 901.0, PERIOD)
    knots = RADIUS + 0.01 * ((times - middle) ** 2 - half**2)  # Below 0 it is on the other side.
    spline = CubicSpline(times, knots)  # A parabola.
    flown = goal_flight(past_the_goal(spline), until=900.0, speed=100.0)
    assert flown.last[FINISHED] == arrives
    if arrives:
        assert flown.reason == REACHED
        assert flown.end == pytest.approx(710.0)
        assert flown.last[ENTERED_GOAL] == pytest.approx(105.0, abs=1e-6)
    else:
        assert flown.reason == RAN_OUT
        assert flown.last.tolist() == [NEVER, 0.0, 0.0, 0.0]


def test_speed_counts_as_well_as_distance():
    """Within 1 km all the time; 1 m/s at 60.25 s, at rest at 160.25 s, and 1 m/s at 260.25 s."""

    def script(time: float) -> np.ndarray:
        since = time - 160.25
        return np.concatenate([GOAL + [0.0, 0.0, 0.005 * since**2], [0.0, 0.0, 0.01 * since]])

    flown = goal_flight(script, until=500.0)
    entered = flown.outcomes[:, ENTERED_GOAL]
    inside = (flown.times > 60.25) & (flown.times < 260.25)
    assert entered[inside] == pytest.approx(np.full(inside.sum(), 60.25), abs=1e-6)
    assert np.all(entered[~inside] == NEVER)


# Keep-out


def over_the_top(times, heights, keep_out=KEEP_OUT) -> Script:
    """Above the ellipsoid's pole on the z axis, where clearance is height."""

    def script(time: float) -> np.ndarray:
        return np.array([0.0, 0.0, keep_out[2] + np.interp(time, times, heights), 0.0, 0.0, 0.0])

    return script


@pytest.mark.parametrize(("factor", "tolerance"), [(1.0, 0.4), (5.0, 1.0)])
@pytest.mark.parametrize(("depth", "count"), [(0.0, 0), (0.9, 0), (1.1, 1), (500.0, 1)])
def test_violations_are_deeper_than_the_tolerance(factor, tolerance, depth, count):
    """A hundred-thousandth of the longest semi-axis, 40 km, or 1 m where it is 200 km."""
    keep_out, depth = factor * KEEP_OUT, depth * tolerance
    heights = [400.0, -depth, -depth, 400.0]
    script = over_the_top([0.0, 100.0, 200.0, 300.0], heights, keep_out)
    flown = watch(script, until=320.0, keep_out=keep_out)
    assert flown.last[VIOLATIONS] == count
    assert flown.reason == RAN_OUT  # It is counted; the flight goes on.


def test_violation_is_found_when_it_happens():
    # 5 m/s downwards from 401 m: at a depth of 0.4 m after 80.28 s.
    flown = watch(over_the_top([0.0, 100.0], [401.0, -99.0]), until=110.0)
    violations = flown.outcomes[:, VIOLATIONS]
    assert np.all(violations[flown.times < 80.28] == 0.0)
    assert np.all(violations[flown.times > 80.281] == 1.0)


def test_each_entry_is_counted():
    times = [0.0, 50.0, 100.0, 150.0, 200.0, 250.0, 300.0]
    heights = [100.0, -50.0, 30.0, -50.0, -0.3, -50.0, 100.0]
    # The third dip comes from within the tolerance: an entry too.
    assert watch(over_the_top(times, heights), until=310.0).last[VIOLATIONS] == 3.0
    heights[4] = -2.0
    assert watch(over_the_top(times, heights), until=310.0).last[VIOLATIONS] == 2.0


def test_graze_within_a_control_period_is_counted():
    """The ends of the step are outside, the middle is some metres deep."""
    half, depth = 5.0, 10.0
    speed = 1.05 * np.sqrt(2.0 * depth * KEEP_OUT[0] ** 2 / KEEP_OUT[2]) / half

    def script(time: float) -> np.ndarray:
        along = speed * (time - 55.0)
        return np.array([along, 0.0, KEEP_OUT[2] - depth, speed, 0.0, 0.0])

    ends = np.stack([script(50.0)[:3], script(60.0)[:3]])
    assert clearances(KEEP_OUT, ends).min() > 0.0
    assert watch(script, until=100.0).last[VIOLATIONS] == 1.0


# Collision


def rays_through(field: GravityField, keep_out: np.ndarray, count: int):
    """Starts outside the keep-out, velocities towards the body, exact times of collision."""
    random = np.random.default_rng(5)
    mesh = field.shape.to_trimesh()
    for _ in range(count):
        direction = random.normal(size=3)
        start = 1.4 * keep_out * direction / np.linalg.norm(direction)
        aim = mesh.triangles_center[random.integers(len(mesh.faces))] * 0.7
        velocity = 35.0 * (aim - start) / np.linalg.norm(aim - start)
        hits, _, _ = RayMeshIntersector(mesh).intersects_location(
            start[None], velocity[None] / 35.0, multiple_hits=True
        )
        yield start, velocity, np.linalg.norm(hits - start, axis=1).min() / 35.0


@pytest.mark.parametrize("body", ["cube", "kleopatra"])
def test_collision_is_found_when_the_path_meets_the_mesh(body):
    kleopatra = load_body("kleopatra")
    field, keep_out = cube(), KEEP_OUT
    if body == "kleopatra":
        field, keep_out = kleopatra.exact_field, kleopatra.keep_out_semi_axes
    for start, velocity, time in rays_through(field, keep_out, 4):
        flown = watch(straight(start, velocity), until=9000.0, field=field, keep_out=keep_out)
        assert flown.reason == REACHED
        assert flown.end == pytest.approx(time, abs=1e-3)
        assert flown.last.tolist() == [NEVER, 1.0, 1.0, 0.0]
        # The keep-out was counted before, when its tolerance was used up.
        first = flown.times[np.argmax(flown.outcomes[:, VIOLATIONS] > 0)]
        path = start + flown.times[:, None] * velocity
        deep = clearances(keep_out, path) < -min(1.0, 1e-5 * keep_out.max())
        assert first == flown.times[np.argmax(deep)]
        assert first < flown.end


def across_the_edge(cut: float, speed: float) -> Script:
    """Diagonally across the cube's edge x = y = 10 km, `cut` within it, at 55 s."""
    along = np.array([-1.0, 1.0, 0.0]) / np.sqrt(2.0)
    middle = np.array([10e3 - cut, 10e3 - cut, 1234.0])
    return lambda time: np.concatenate([middle + speed * (time - 55.0) * along, speed * along])


@pytest.mark.parametrize("cut", [5.0, 40.0])
def test_corner_cut_within_a_step_is_a_collision(cut):
    """At 40 m/s the path is within the mesh for 0.35 s or 2.8 s, between two ends of steps."""
    script = across_the_edge(cut, 40.0)
    inside = 2.0 * cut * np.sqrt(2.0) / 40.0
    field = cube()
    ends = np.stack([script(time)[:3] for time in (50.0, 60.0)])
    assert not field.evaluate(ends).inside.any()
    flown = watch(script, until=200.0)
    assert flown.reason == REACHED
    assert flown.last[COLLIDED] == 1.0
    assert 55.0 - 0.5 * inside - 1e-3 < flown.end <= 60.0
    missed = watch(across_the_edge(-1.0, 40.0), until=80.0)
    assert missed.reason == RAN_OUT
    assert missed.last[COLLIDED] == 0.0


def test_violation_is_never_after_the_collision():
    """A corner just below the ellipsoid, cut within one step: both happen between its ends."""
    keep_out = np.array([10e3 * np.sqrt(3.0) * 1.0005] * 3)

    def script(time: float) -> np.ndarray:
        out = np.ones(3) / np.sqrt(3.0)
        along = np.array([1.0, -1.0, 0.0]) / np.sqrt(2.0)
        position = (10e3 * np.sqrt(3.0) - 8.0) * out + 200.0 * (time - 55.0) * along
        return np.concatenate([position, 200.0 * along])

    ends = np.stack([script(time)[:3] for time in (50.0, 60.0)])
    assert clearances(keep_out, ends).min() > 0.0
    flown = watch(script, until=100.0, keep_out=keep_out)
    assert flown.last[COLLIDED] == 1.0
    assert flown.last[VIOLATIONS] == 1.0


# A mesh that sticks out of the keep-out ellipsoid

SMALL = np.array([12e3, 9e3, 8e3])
"""The cube's corners, edges and most of its facets are outside it."""


def test_collision_outside_the_keep_out_is_found():
    """Down to the facet z = 10 km beside the ellipsoid, with no keep-out violation before."""
    start = np.array([8e3, 8e3, 10e3 + 35.0 * 123.4])
    flown = watch(straight(start, [0.0, 0.0, -35.0]), keep_out=SMALL)
    assert clearances(SMALL, np.array([[8e3, 8e3, 10e3]]))[0] > 1e3
    assert flown.reason == REACHED
    assert flown.end == pytest.approx(123.4, abs=1e-3)
    assert flown.last.tolist() == [NEVER, 0.0, 1.0, 0.0]


def test_ellipsoid_around_a_mesh():
    vertices = cube().shape.vertices
    assert containing_ellipsoid(KEEP_OUT, vertices) is KEEP_OUT  # To the last bit.
    larger = containing_ellipsoid(SMALL, vertices)
    assert larger / larger[0] == pytest.approx(SMALL / SMALL[0], rel=1e-14)
    levels = np.linalg.norm(vertices / larger, axis=1)
    assert 1.0 - 1e-8 < levels.max() < 1.0
