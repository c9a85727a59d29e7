"""Simulates one flight: `fly` takes a scenario and a controller and returns a `FlightLog`."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable

from pydrake.geometry import Meshcat
from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator
from pydrake.systems.framework import Context, Diagram, EventStatus, System

from proxops.diagrams.flight.named_controllers import errors_told, named_controller
from proxops.diagrams.flight.recording import Flown, KeptFrames, make_log
from proxops.diagrams.flight.touching import TouchMotion
from proxops.diagrams.flight.transit_diagram import diagram_of
from proxops.diagrams.logs import FlightLog
from proxops.diagrams.meshcat import PLAYBACK_SPEED, add_flight
from proxops.diagrams.scenario import (
    Body,
    RigidBodyConfig,
    Scenario,
    TouchAndGoConfig,
    TrueBody,
    World,
)
from proxops.systems.common import Progress, check_type, compilation_timed, silent

# Relative accuracy with which the time of an event is found.
_EVENT_ACCURACY = 1e-6
# Longest step of the integration (s). With RK5 the end of a transit is then within 1e-5 m of the
# exact one. Drake has no scheme between it and RK3, which is off by up to 1e-2 m.
_LONGEST_STEP = 20.0


def fly(
    scenario: Scenario,
    controller: str | System = "mpc",
    meshcat: Meshcat | None = None,
    progress: Progress = silent,
    body: Body | None = None,
    true_body: TrueBody | None = None,
    finished: Callable[[Diagram, Context], object] | None = None,
) -> FlightLog:
    """Flies a scenario's transit from start to arrival, collision or the deadline.

    Args:
      scenario: the scenario. If it has dispersions, the world of its transit is drawn from them,
        and the log holds the scenario as drawn.
      controller: a name that `named_controller` takes, or a System that `make_transit_diagram`
        takes. The System may have, all optional: a method `logged_ports`, which gives the
        `LoggedPort` of each column that it adds to the log; `legend_entry`, a `LegendEntry` for
        plots and replays; `bundle`, the policy bundle that it flies; `delay`, the time in s from a
        control step to the moment at which its force acts.
      meshcat: shows the flight live, at the replay's speed, and the replay afterwards.
      progress: is called at every step with the share of the longest time that has passed.
      body: the body as believed; None: the body that the scenario names.
      true_body: the body as it is; None: it is made from `scenario.truth`.
      finished: is called after the flight with the transit diagram and its Context at the end, to
        keep what is not in the log. Such as `mended_map_of_flight`.

    Returns:
      The log. On one machine, the same scenario and controller give the same log bit for bit,
      except for wall times.

    Raises:
      UnflyableWorldError: the flight cannot begin in its world.
      InputError: the scenario cannot be flown or the controller does not fit.
      RuntimeError: an event of the simulation failed.
    """
    check_type("fly", Scenario, scenario=scenario)
    return fly_world(World.of(scenario, body, true_body), controller, meshcat, progress, finished)


def fly_world(
    world: World,
    controller: str | System = "mpc",
    meshcat: Meshcat | None = None,
    progress: Progress = silent,
    finished: Callable[[Diagram, Context], object] | None = None,
) -> FlightLog:
    """Flies in a world that is made already: see `fly`."""
    scenario = world.scenario
    own = isinstance(controller, str)
    name = controller if isinstance(controller, str) else type(controller).__name__
    if isinstance(controller, str):
        controller = named_controller(controller, world.belief, world.body)
    diagram = diagram_of(world, controller, meshcat)
    with errors_told(name), contextlib.ExitStack() as end:
        end.callback(let_go, diagram, None if own else controller)
        simulator = make_simulator(diagram, scenario)
        if meshcat is not None:
            simulator.set_target_realtime_rate(PLAYBACK_SPEED)  # A person can follow it.
        latest = scenario.arrival.deadline_s + scenario.arrival.dwell_s
        frames = KeptFrames(diagram, scenario.control_period_s) if scenario.log_ranges else None
        touches = isinstance(scenario.task, TouchAndGoConfig)
        motion = TouchMotion(world, diagram) if touches else None
        _watch(simulator, frames, progress, latest, motion)
        with compilation_timed() as compiled:
            started = time.perf_counter()
            simulator.AdvanceTo(latest)
            context = simulator.get_context()
            while motion is not None and motion.near(context) and context.get_time() < latest:
                motion.fly(simulator, latest)
                simulator.AdvanceTo(latest)
            if frames is not None:
                frames.keep_end(context)
            wall_time = time.perf_counter() - started - compiled()
        flown = Flown(diagram, context, world, controller, name, frames, motion)
        log = make_log(flown, wall_time)
        if meshcat is not None:
            add_flight(meshcat, log)  # The replay.
        if finished is not None:
            finished(diagram, context)
    return log


def _watch(
    simulator: Simulator,
    frames: KeptFrames | None,
    progress: Progress,
    latest: float,
    motion: TouchMotion | None = None,
) -> None:
    """Has the simulator keep frames and report the share of `latest`, in s, at every step.

    With a `TouchMotion` it stops where the ground is near.
    """
    if frames is None and progress is silent and motion is None:
        return

    def monitor(context: Context) -> EventStatus:
        if frames is not None:
            frames.keep(context)
        progress(context.get_time() / latest, f"{context.get_time():.0f} s")
        if motion is not None and motion.near(context):
            return EventStatus.ReachedTermination(motion.spacecraft, "the ground is near")
        return EventStatus.DidNothing()

    monitor(simulator.get_context())  # The start.
    simulator.set_monitor(monitor)


def let_go(diagram: Diagram, kept: System | None) -> None:
    """Empties the systems of a diagram that nobody will use again, all but `kept`.

    Diagrams with systems in Python are never freed (drake#22515). Meshes, tables and networks that
    their systems hold would fill the memory of a process that flies many flights.
    """
    for system in diagram.GetSystems():
        if system is kept:
            continue
        if isinstance(system, Diagram):
            let_go(system, kept)
        held = vars(system)
        for name in [name for name in held if not name.startswith("_pydrake")]:
            del held[name]


def make_simulator(
    diagram: Diagram, scenario: Scenario, context: Context | None = None
) -> Simulator:
    """Makes an initialised Simulator that integrates in equal steps.

    A point by RK5 in steps of at most 20 s; a rigid body by RK3, in steps of an attitude period,
    within 1e-7 m of the exact motion after 500 s, because thrust is constant over each.

    Args:
      diagram: a transit diagram, or one that holds it. scenario: the transit's.
      context: the diagram's, to go on from; None: a new one.
    """
    simulator = Simulator(diagram, context)
    # Without an accuracy in the Context, events fire at the end of their step.
    simulator.get_mutable_context().SetAccuracy(_EVENT_ACCURACY)
    steps, scheme = math.ceil(scenario.control_period_s / _LONGEST_STEP), "runge_kutta5"
    if isinstance(scenario.spacecraft, RigidBodyConfig):
        steps, scheme = scenario.attitude_steps, "runge_kutta3"
    integrator = ResetIntegratorFromFlags(
        simulator, scheme=scheme, max_step_size=scenario.control_period_s / steps
    )
    # The Context does not hold the size of an adaptive step. With adaptive steps, a flight that is
    # continued from a cloned Context would differ in its last bits.
    integrator.set_fixed_step_mode(True)
    simulator.Initialize()
    return simulator
