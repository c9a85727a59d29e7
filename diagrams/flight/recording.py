"""Makes the log of a flight from its transit diagram after the simulation."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import metadata
from typing import Any

import numpy as np
from pydrake.systems.framework import Context, Diagram, System
from pydrake.systems.primitives import VectorLogSink

from proxops.diagrams.flight.kept_frames import ROUNDING, KeptFrames
from proxops.diagrams.flight.transit_diagram import logged_ports
from proxops.diagrams.flight.world import has_thruster_errors, thruster_errors
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
from proxops.systems.lidar import LearnedLidar, PlanarLidar
from proxops.systems.vehicle import (
    COLLIDED,
    ENTERED_GOAL,
    NEVER,
    VIOLATIONS,
    DelayedHold,
    thrust_given,
)

Columns = dict[str, np.ndarray]


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
    if has_thruster_errors(scenario.truth):
        errors, period = thruster_errors(scenario.truth), scenario.control_period_s
        columns["thrust"] = np.array(
            [
                thrust_given(force, errors, period, time)
                for force, time in zip(columns["force"], times, strict=True)
            ]
        )
    own = {
        name: (logged.units, logged.description)
        for name, logged in logged_ports(flown.controller).items()
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
    if end <= times[-1] + ROUNDING * flown.world.scenario.control_period_s:
        return times, columns
    columns = {name: np.concatenate([rows, rows[-1:]]) for name, rows in columns.items()}
    for name, system in (
        ("state", "spacecraft"), ("mass", "spacecraft"), ("attitude", "attitude"),
    ):  # fmt: skip
        if name in columns:
            columns[name][-1] = flown.value(system, name)
    # What is on board has outputs only at control steps.
    on_board = [name for name in columns if name.startswith("navigation_")]
    for name in (
        "intervention_record",
        "assurance_record",
        *on_board,
        *logged_ports(flown.controller),
    ):
        if name in columns and name != "decision":
            columns[name][-1] = np.nan
    return np.append(times, end), columns


def _split_records(columns: Columns, rows: int) -> Columns:
    """Splits each record into its columns, and adds the columns that follow from others."""
    blank = np.full((rows, 3), np.nan)
    columns = {"mpc_record": blank.copy(), **columns}
    columns["disturbance"] = columns["force"] - columns.pop("command")
    if "decision" in columns:
        columns["decision"] = columns["decision"][:, 0].astype(np.int8)
    else:
        by = FlownBy.CONTROLLER
        by = FlownBy.POLICY if "policy_force" in columns else by
        by = FlownBy.MPC if "mpc_force" in columns else by
        columns["decision"] = np.full(rows, by, dtype=np.int8)
    for record, names in RECORDS.items():
        if record in columns:
            columns |= dict(zip(names, columns.pop(record).T, strict=True))
    if "navigation_covariance" in columns:
        columns["navigation_covariance"] = columns["navigation_covariance"].reshape(rows, 9, 9)
    for name, values in columns.items():
        if values.ndim == 2 and values.shape[1] == 1:
            columns[name] = values[:, 0]
    return {"mpc_force": blank, "policy_force": blank.copy(), **columns}


def _attributes(flown: Flown, wall_time: float) -> dict[str, Any]:
    """Gives the attributes of the log: provenance and outcome of the flight."""
    scenario, end = flown.world.scenario, flown.context.get_time()
    outcome = flown.value("monitor", "outcome")
    # A flight that ends in the goal region before the dwell is over has not arrived.
    entered = outcome[ENTERED_GOAL]
    dwelt = entered < NEVER and end - entered >= scenario.arrival.dwell_s * (1.0 - 1e-9)
    hold = flown.diagram.GetSubsystemByName("hold")
    attributes = {
        "proxops_version": metadata.version("proxops"),
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
    lidar = flown.diagram.GetSubsystemByName("lidar")
    if isinstance(lidar, LearnedLidar):
        attributes["lidar_sha256"] = lidar.bundle.sha256
    offers = offers_of(flown.controller)
    if offers.bundle is not None:
        attributes["policy_sha256"] = offers.bundle.sha256
    if offers.legend_entry is not None:
        attributes[LEGEND] = legend_text(offers.legend_entry)
    return attributes
