"""Keeps the frames of a flight while it is simulated, and makes its log after it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.systems.framework import Context, Diagram, System
from pydrake.systems.primitives import VectorLogSink

from proxops.diagrams.flight.origin import made_with
from proxops.diagrams.flight.touching import TouchMotion, contact_figures
from proxops.diagrams.flight.world import has_thruster_errors
from proxops.diagrams.logs import (
    CONTROLLER_COLUMNS,
    LEGEND,
    RECORDS,
    FlightLog,
    legend_text,
    make_dataset,
)
from proxops.diagrams.scenario import World
from proxops.systems.common import offers_of
from proxops.systems.hybrid import FlownBy
from proxops.systems.lidar import FrameDelay, LearnedLidar, PlanarLidar
from proxops.systems.vehicle import (
    COLLIDED,
    ENTERED_GOAL,
    NEVER,
    VIOLATIONS,
    DelayedHold,
    thrust_given,
)

Columns = dict[str, np.ndarray]
# Times that are closer than this share of a control period are the same control step: a step's time
# is a sum of shorter steps, and a flight's end one of two settings.
_ROUNDING = 1e-9
# Columns of the last row if the flight ended between two control steps: the motion then, by the
# system that knows it, and what was held. What is on board has no other outputs then.
_MOVING = ("state", "mass", "attitude", "angular_velocity", "wheel_momentum")
_HELD = ("target", "command", "force", "kick", "decision")


class KeptFrames:
    """The frames of a transit diagram as they were received, and what became of their returns.

    A log sink is no place for them: it would keep 35 kB a frame in a Diagram that is never freed
    (drake#22515). They were computed for somebody on board in most flights, and are then cached.

    Attributes:
      ranges: float32 (planes * rays,) in m of each frame; +inf: no return.
      use: the navigation's `ReturnUse` int8 (planes * rays,) of each frame; empty without one.
    """

    def __init__(self, diagram: Diagram, period: float):
        """Takes a transit diagram and the control period in s."""
        systems = diagram.GetSystems()
        late = [each for each in systems if isinstance(each, FrameDelay)]
        self._lidar = late[0] if late else diagram.GetSubsystemByName("lidar")
        self._ranges = self._lidar.GetOutputPort("ranges")
        navigation = (each for each in systems if each.HasOutputPort("return_use"))
        self._navigation = next(navigation, None)
        self._period, self._slack, self._last = period, _ROUNDING * period, -np.inf
        self.ranges: list[np.ndarray] = []
        self.use: list[np.ndarray] = []

    def keep(self, context: Context) -> None:
        """Keeps the frame of a diagram's Context, if that is at a control step."""
        now = context.get_time()
        # An event may end a step of the simulation between two control steps.
        steps = round(now / self._period)
        if now <= self._last or abs(now - steps * self._period) > self._slack:
            return
        if self._last >= steps * self._period:
            return  # A rounding after the control step, whose frame is kept and used.
        if now <= self._last + self._slack:
            # The sum of several steps was a rounding short of the control step, which is now.
            self.ranges.pop()
            del self.use[-1:]
        self._keep_ranges(context)
        if self._navigation is not None:
            here = self._navigation.GetMyContextFromRoot(context)
            use = self._navigation.GetOutputPort("return_use").Eval(here)
            self.use.append(use.astype(np.int8))

    def keep_end(self, context: Context) -> None:
        """Keeps the frame of the flight's end, if that is between two control steps.

        The navigation does not use it.
        """
        if context.get_time() > self._last + self._slack:
            self._keep_ranges(context)
            self.use += [np.zeros_like(self.use[-1])] if self.use else []

    def _keep_ranges(self, context: Context) -> None:
        ranges = self._ranges.Eval(self._lidar.GetMyContextFromRoot(context))
        self.ranges.append(ranges.astype(np.float32))
        self._last = context.get_time()


@dataclass(frozen=True)
class Flown:
    """A transit diagram in or after its flight: the Context now, and what is flown."""

    diagram: Diagram
    context: Context
    world: World
    controller: System
    name: str
    """Name of the controller in the log."""
    frames: KeptFrames | None
    """None: the log has no frames."""
    motion: TouchMotion | None = None
    """That of a touch-and-go."""

    def value(self, system: str, port: str) -> np.ndarray:
        """Gives the value of a subsystem's output port now."""
        found = self.diagram.GetSubsystemByName(system)
        return found.GetOutputPort(port).Eval(found.GetMyContextFromRoot(self.context))


def make_log(flown: Flown, wall_time: float) -> FlightLog:
    """Makes the log of a flight from the diagram's log sinks; its last row is the flight's end.

    Args:
      flown: the diagram after the flight.
      wall_time: wall time in s of the whole flight.
    """
    times, columns = _sampled(flown)
    times, columns = _with_end(flown, times, columns)
    columns = _split_records(columns, len(times))
    scenario = flown.world.scenario
    if flown.frames is not None:
        columns |= _frames(flown, flown.frames)
    if has_thruster_errors(scenario):
        errors, period = scenario.truth.thrusters.errors(), scenario.control_period_s
        columns["thrust"] = np.array(
            [
                thrust_given(force, errors, period, time)
                for force, time in zip(columns["force"], times, strict=True)
            ]
        )
    own = {
        name: (logged.units, logged.description)
        for name, logged in offers_of(flown.controller).logged_ports.items()
        if name not in CONTROLLER_COLUMNS
    }
    attributes = _attributes(flown, wall_time)
    body, true_body = flown.world.body, flown.world.true_body
    dataset = make_dataset(columns, times, scenario, body, attributes, own, true_body)
    return FlightLog(dataset, body)


def _frames(flown: Flown, kept: KeptFrames) -> Columns:
    """Gives the frames (N, planes, rays), and what the navigation made of them, if there is one."""
    lidar = flown.diagram.GetSubsystemByName("lidar")
    assert isinstance(lidar, PlanarLidar)
    shape = (-1, lidar.geometry.planes, lidar.geometry.rays)
    columns = {"ranges": np.stack(kept.ranges).reshape(shape)}
    if kept.use:
        columns["navigation_return_use"] = np.stack(kept.use).reshape(shape)
    return columns


def _sampled(flown: Flown) -> tuple[np.ndarray, Columns]:
    """Gives the times (N,) in s and the columns of all log sinks."""
    sinks = {
        system.get_name().removeprefix("log_"): system.FindLog(flown.context)
        for system in flown.diagram.GetSystems()
        if isinstance(system, VectorLogSink)
    }
    times = sinks["state"].sample_times()
    # Of a control step that was sampled twice, as the training environment does, the second counts.
    last = np.append(np.diff(times) > 0.0, True)
    return times[last], {name: log.data().T[last] for name, log in sinks.items()}


def _with_end(flown: Flown, times: np.ndarray, columns: Columns) -> tuple[np.ndarray, Columns]:
    """Adds a last row if the flight ended between two control steps; it repeats the held values."""
    end = flown.context.get_time()
    if end <= times[-1] + _ROUNDING * flown.world.scenario.control_period_s:
        return times, columns
    columns = {name: np.concatenate([rows, rows[-1:]]) for name, rows in columns.items()}
    for name, rows in columns.items():
        if name in _MOVING:
            own = name == "attitude" and flown.diagram.HasSubsystemNamed(name)
            rows[-1] = flown.value(name if own else "spacecraft", name)
        elif name not in _HELD:
            rows[-1] = np.nan
    return np.append(times, end), columns


def _split_records(columns: Columns, rows: int) -> Columns:
    """Splits each record into its columns, and adds the columns that follow from others."""
    columns = {"mpc_record": np.full((rows, 3), np.nan), **columns}
    columns["disturbance"] = columns["force"] - columns.pop("command")
    if "decision" not in columns:
        by = FlownBy.POLICY if "policy_force" in columns else FlownBy.CONTROLLER
        by = FlownBy.MPC if "mpc_force" in columns else by
        columns["decision"] = np.full((rows, 1), by)
    columns["decision"] = columns["decision"].astype(np.int8)
    for record, names in RECORDS.items():
        if record in columns:
            columns |= dict(zip(names, columns.pop(record).T, strict=True))
    if "navigation_covariance" in columns:
        columns["navigation_covariance"] = columns["navigation_covariance"].reshape(rows, 9, 9)
    for name, values in columns.items():
        if values.ndim == 2 and values.shape[1] == 1:
            columns[name] = values[:, 0]
    nobodys = {name: np.full((rows, 3), np.nan) for name in ("mpc_force", "policy_force")}
    return nobodys | columns


def _attributes(flown: Flown, wall_time: float) -> dict[str, Any]:
    """Gives the attributes of the log: provenance and outcome of the flight."""
    scenario, end = flown.world.scenario, flown.context.get_time()
    outcome = flown.value("monitor", "outcome")
    # A flight that ends in the goal region before the dwell is over has not arrived.
    entered = outcome[ENTERED_GOAL]
    dwelt = entered < NEVER and end - entered >= scenario.arrival.dwell_s * (1.0 - 1e-9)
    hold = flown.diagram.GetSubsystemByName("hold")
    attributes = {
        **{f"proxops_{name}": text for name, text in made_with().items()},
        "controller": flown.name,
        "seed": scenario.transit.seed,
        "transit": scenario.transit.index,
        "noise_seed": scenario.noise_seed,
        "force_delay_s": hold.delay if isinstance(hold, DelayedHold) else 0.0,
        "arrival_time_s": float(entered) if dwelt else np.nan,
        "collided": int(outcome[COLLIDED]),
        "keep_out_violations": int(outcome[VIOLATIONS]),
        "wall_s": wall_time,
    }
    if flown.motion is not None:
        attributes |= contact_figures(flown.motion, flown.world)
    lidar = flown.diagram.GetSubsystemByName("lidar")
    if isinstance(lidar, LearnedLidar):
        attributes["lidar_sha256"] = lidar.bundle.sha256
    offers = offers_of(flown.controller)
    if offers.bundle is not None:
        attributes["policy_sha256"] = offers.bundle.sha256
    if offers.legend_entry is not None:
        attributes[LEGEND] = legend_text(offers.legend_entry)
    return attributes
