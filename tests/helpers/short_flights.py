"""Flights for tests: one whole transit round Kleopatra, and some that are over in a second."""

from functools import cache
from pathlib import Path

import numpy as np
import trimesh
from pydrake.systems.framework import Context, Diagram, LeafSystem

from proxops.diagrams.flight.simulation import fly, make_simulator
from proxops.diagrams.logs.flight_log import FlightLog
from proxops.diagrams.scenario import (
    LidarNavigationConfig,
    Scenario,
    load_body,
    load_scenario,
)

# 8 km past the long end of the body, then 100 s in the goal region: 130 steps.
SHORT = {
    "transit.start_m": [160e3, 0.0, 0.0],
    "transit.goal_m": [160e3, 8e3, 0.0],
    "arrival.dwell_s": 100.0,
    "mpc.intervals": 10,
}
# The same, and 1.2 km: 55 steps.
NEAR = SHORT | {"transit.goal_m": [160e3, 1.2e3, 0.0]}
# Over after 15 steps, wherever it is then.
BRIEF = {"arrival__deadline_s": 100.0, "arrival__dwell_s": 50.0}


def short_scenario(**changes: object) -> Scenario:
    """`SHORT` on the true state, with changes, whose dots are written as two underscores."""
    changes = SHORT | {k.replace("__", "."): v for k, v in changes.items()}
    return load_scenario(None, changes, on_true_state=True)


def on_lidar(**changes: object) -> Scenario:
    """The same, on the navigation's state."""
    scenario = short_scenario(**changes)
    scenario.navigation = LidarNavigationConfig()
    return scenario


@cache
def kleopatra_flight() -> FlightLog:
    """Transit 0 of seed 10000 by the MPC on the true state, flown once a session.

    Do not change it.
    """
    return fly(load_scenario(on_true_state=True))


@cache
def disturbed_flight() -> FlightLog:
    """The brief flight with the paper's disturbance, noise seed 3."""
    return fly(short_scenario(disturbance={}, noise_seed=3, **BRIEF))


@cache
def falling_flight() -> FlightLog:
    """Let go 1 km above the keep-out's end on the spin axis; falls through it onto Kleopatra."""
    return fly(short_scenario(transit__start_m=[0.0, 0.0, 66e3]), "zero")


@cache
def kleopatra():
    return load_body("kleopatra")


def flown_and_taken_up(
    diagram: Diagram, scenario: Scenario, cloned_at: float, end: float
) -> tuple[Context, Context]:
    """The Contexts at the end (s) of a flight, and of one that goes on from a clone of its own."""
    simulator = make_simulator(diagram, scenario)
    simulator.AdvanceTo(cloned_at)
    clone = simulator.get_context().Clone()
    simulator.AdvanceTo(end)
    again = make_simulator(diagram, scenario, clone)
    again.AdvanceTo(end)
    return simulator.get_context(), again.get_context()


class PdController(LeafSystem):
    """A user's own: proportional and derivative, clipped, with the least of ports."""

    def __init__(self):
        super().__init__()
        self.state = self.DeclareVectorInputPort("state", 6)
        self.target = self.DeclareVectorInputPort("target", 6)
        self.DeclareVectorOutputPort("force", 3, self._calc_force)

    def _calc_force(self, context, output):
        error = self.target.Eval(context) - self.state.Eval(context)
        wanted = 0.02 * error[:3] + 3.0 * error[3:]
        output.SetFromVector(np.clip(wanted, -7.0, 7.0))


class Scripted(LeafSystem):
    """Commands what a function of time says; its ports may be made wrong on purpose."""

    def __init__(self, force=lambda time: np.zeros(3), ports=(), output="force"):
        super().__init__()
        for name, width in ports:
            self.DeclareVectorInputPort(name, width)
        self.DeclareVectorOutputPort(
            output, 3, lambda context, out: out.SetFromVector(force(context.get_time()))
        )


BLOB = {
    "name": "Blob",
    "mesh": "blob.obj",
    "mesh_unit": "km",
    "mass_kg": 2.97e18,
    "rotation_period_h": 5.0,
    "keep_out_semi_axes_m": [140e3, 70e3, 65e3],
}


def blob() -> trimesh.Trimesh:
    """An ellipsoid of 80 facets about as large as Kleopatra, in km."""
    ball = trimesh.creation.icosphere(1)
    return trimesh.Trimesh(ball.vertices * [110.0, 50.0, 50.0], ball.faces, process=False)


def write_blob(folder: Path, **changes: object) -> str:
    """Writes the body's YAML file and, unless it is there, its mesh; returns the YAML's path."""
    path = folder / "blob.obj"
    if not path.exists():
        path.write_text(obj_text(blob()))
    tree = BLOB | changes
    (folder / "blob.yaml").write_text("".join(f"{key}: {value}\n" for key, value in tree.items()))
    return str(folder / "blob.yaml")


def obj_text(mesh: trimesh.Trimesh) -> str:
    """Wavefront text with every digit, written here so that no library repairs anything."""
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in mesh.vertices.tolist()]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in mesh.faces.tolist()]
    return "\n".join(lines) + "\n"
