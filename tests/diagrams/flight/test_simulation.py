"""Flights obey physics: the log's motion, events and outcomes are each computed a second way."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from jacobi import jacobi_integral
from plain_motion import moved
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from scipy.interpolate import CubicHermiteSpline
from short_flights import (
    disturbed_flight,
    falling_flight,
    kleopatra,
    kleopatra_flight,
    short_scenario,
)

from proxops.diagrams.flight import add_transit, fly, make_transit_diagram, named_controller
from proxops.diagrams.logs.flight_log import FlightLog
from proxops.diagrams.scenario.scenario import load_scenario
from proxops.systems import InputError

SPIN = 2.0 * np.pi / (5.38528 * 3600.0)


def reflown(log: FlightLog, rtol: float = 1e-8) -> np.ndarray:
    """States at the log's times from its first state and its forces, by SciPy."""
    times, forces = log.dataset["time"].values, log.dataset["force"].values
    mass = log.scenario.spacecraft.mass_kg
    states = [log.dataset["state"].values[0]]
    for step, force in zip(np.diff(times), forces, strict=False):
        push = force / mass
        states.append(moved(kleopatra().gravity_field, SPIN, states[-1], push, step, rtol))
    return np.array(states)


def path(log: FlightLog) -> tuple[CubicHermiteSpline, CubicHermiteSpline]:
    """Position in K as a function of time, and its derivative."""
    states = log.dataset["state"].values
    spline = CubicHermiteSpline(log.dataset["time"].values, states[:, :3], states[:, 3:])
    return spline, spline.derivative()


# --- one real flight ------------------------------------------------------------------------------


def test_succeeds() -> None:
    summary = kleopatra_flight().summary
    assert summary["success"]
    assert summary["success_2km"]
    assert not summary["collided"]
    assert summary["keep_out_violations"] == 0
    assert summary["terminal_position_error_m"] < 100.0
    assert summary["terminal_speed_m_s"] < 0.5


@pytest.mark.slow
def test_the_plant_ends_where_a_much_finer_integration_ends() -> None:
    """Within 1 mm is asked for; order 3 in the same steps is up to 13 mm off at other transits."""
    log = kleopatra_flight()
    end = reflown(log, rtol=1e-13)[-1]
    assert np.linalg.norm(log.dataset["state"].values[-1, :3] - end[:3]) < 1e-6


@pytest.mark.parametrize(
    "flight",
    [pytest.param(kleopatra_flight, marks=pytest.mark.slow), disturbed_flight],
)
def test_forces_give_the_states(flight) -> None:
    log = flight()
    error = reflown(log) - log.dataset["state"].values
    assert np.linalg.norm(error[:, :3], axis=1).max() < 0.1
    assert np.linalg.norm(error[:, 3:], axis=1).max() < 1e-3


def test_inertial_motion() -> None:
    data = kleopatra_flight().dataset
    times, states = data["time"].values, data["state"].values
    position, velocity = data["position_inertial"].values, data["velocity_inertial"].values
    np.testing.assert_array_equal(position[0], states[0, :3])
    # The distance from the axis, and along it, are the same in both frames.
    np.testing.assert_allclose(np.hypot(*position[:, :2].T), np.hypot(*states[:, :2].T), rtol=1e-12)
    np.testing.assert_array_equal(position[:, 2], states[:, 2])
    # It turns by the spin with respect to K.
    turned = position[:, 0] + 1j * position[:, 1]
    fixed = states[:, 0] + 1j * states[:, 1]
    np.testing.assert_allclose(turned / fixed, np.exp(1j * SPIN * times), rtol=1e-9)
    # Velocity is the derivative of position: central differences at 10 s, error h^2 a''/6.
    rows = slice(1, -2)
    slope = (position[2:-1] - position[:-3]) / 20.0
    assert np.abs(slope - velocity[rows]).max() < 0.1
    np.testing.assert_allclose(velocity[0], np.cross([0.0, 0.0, SPIN], position[0]), rtol=1e-12)


def test_arrival_is_the_start_of_the_dwell() -> None:
    log = kleopatra_flight()
    spot, rate = path(log)
    goal = log.dataset["target"].values[0, :3]
    times = np.arange(0.0, log.dataset["time"].values[-1], 0.05)
    near = np.linalg.norm(spot(times) - goal, axis=1) <= 1e3
    slow = np.linalg.norm(rate(times), axis=1) <= 1.0
    outside = np.flatnonzero(~(near & slow))
    arrival = log.summary["arrival_time_s"]
    assert arrival == pytest.approx(times[outside[-1]], abs=0.1)
    # The first such stretch, which ends the flight when it is 600 s long.
    assert np.diff(outside, prepend=-1).max() * 0.05 < 600.0
    assert log.dataset["time"].values[-1] == 10.0 * np.ceil((arrival + 600.0) / 10.0)


# --- events ---------------------------------------------------------------------------------------


def test_collision() -> None:
    log = falling_flight()
    summary = log.summary
    assert summary["collided"]
    assert not summary["success"]
    assert summary["arrival_time_s"] is None
    assert summary["delta_v_m_s"] == 0.0
    # The end lies on the mesh, coming from outside.
    spot, rate = path(log)
    end = log.dataset["time"].values[-1]
    around = spot(end + np.array([-0.5, 0.5])) if end % 10.0 else spot([end - 0.5, end])
    around[1] = spot(end) + 0.5 * rate(end)
    inside = kleopatra().gravity_field.evaluate(around).inside
    assert inside.tolist() == [False, True]
    # And nothing before did.
    before = spot(np.arange(0.0, end - 0.5, 0.5))
    low = before[np.sum((before / [140e3, 70e3, 65e3]) ** 2, axis=1) < 1.0]
    assert not kleopatra().gravity_field.evaluate(low).inside.any()


def test_free_fall_keeps_the_jacobi_integral() -> None:
    data = falling_flight().dataset
    states = data["state"].values
    potentials = kleopatra().gravity_field.evaluate(states[:, :3]).potential
    integral = jacobi_integral(states[:, :3], states[:, 3:], potentials, SPIN)
    # The last kilometres go past the edges of facets, where gravity is not smooth.
    np.testing.assert_allclose(integral, integral[0], rtol=1e-7)
    high = np.linalg.norm(states[:, :3], axis=1) > 60e3
    np.testing.assert_allclose(integral[high], integral[0], rtol=1e-9)


# --- refusals -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "complaint"),
    [
        ("pid", "controller 'pid' is not known: use mpc"),
        ("no_such_module:make", "there is no module no_such_module in"),
        ("short_flights:no_such_factory", "no function 'no_such_factory'"),
        ("builtins:isinstance", "isinstance"),
        ("folder/mine:make", "as mine:make, and run the command in its folder"),
        ("short_flights:blob", r"blob must take \(scenario, body\)"),
    ],
)
def test_controllers_refused(name: str, complaint: str) -> None:
    with pytest.raises(InputError, match=complaint) as caught:
        named_controller(name, load_scenario(), kleopatra())
    assert repr(name) in str(caught.value)


def test_errors_of_a_users_controller_have_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("half_written.py").write_text("def make(scenario, body:\n")
    with pytest.raises(InputError, match=r"SyntaxError: .*\(half_written.py, line 1\)$"):
        named_controller("half_written:make", load_scenario(), kleopatra())
    Path("unnamed.py").write_text(
        "from pydrake.systems.primitives import PassThrough\n\n\n"
        "def make(scenario, body):\n    return PassThrough(3)\n"
    )
    made = named_controller("unnamed:make", load_scenario(), kleopatra())
    assert made.get_name() == "unnamed:make"


def test_what_a_users_controller_raises_in_flight_has_its_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("too_short.py").write_text(
        "from pydrake.systems.framework import LeafSystem\n\n\n"
        "class Short(LeafSystem):\n"
        "    def __init__(self):\n"
        "        super().__init__()\n"
        "        self.DeclareVectorOutputPort('force', 3, self.calc)\n\n"
        "    def calc(self, context, output):\n"
        "        output.SetFromVector([0.0, 0.0])\n\n\n"
        "def make(scenario, body):\n    return Short()\n"
    )
    with pytest.raises(InputError, match=r"'too_short:make': \w+: .*\(too_short\.py, line 10\)$"):
        fly(short_scenario(), "too_short:make", body=kleopatra())


@pytest.mark.parametrize(
    ("given", "cure"),
    [
        (LeafSystem, "make one of this class"),
        (lambda scenario, body: None, r"call it with what it takes, such as \(scenario, load_body"),
        ("pd", r"named_controller\(name, scenario, load_body\(scenario\.body\)\) makes one"),
    ],
)
def test_what_is_no_controller_is_told_how_to_make_one(given: Any, cure: str) -> None:
    with pytest.raises(InputError, match=f"not a System: {cure}"):
        make_transit_diagram(short_scenario(), given, body=kleopatra())


def test_meshcat_is_a_meshcat() -> None:
    wrong: Any = True
    with pytest.raises(InputError, match=r"meshcat is True, not a Meshcat: give .*StartMeshcat"):
        make_transit_diagram(short_scenario(), meshcat=wrong, body=kleopatra())


def test_two_transits_have_two_names() -> None:
    builder = DiagramBuilder()
    first = add_transit(builder, short_scenario(), body=kleopatra())
    with pytest.raises(InputError, match="give that another name"):
        add_transit(builder, short_scenario(), body=kleopatra())
    first.set_name("first")
    add_transit(builder, short_scenario(), body=kleopatra())
    assert builder.Build().GetSubsystemByName("transit").num_output_ports() > 1


def test_a_period_of_several_steps_keeps_one_frame_each():
    """The steps' sum may be a rounding short of the control step, and Drake then takes one more."""
    brief = {"arrival__deadline_s": 20 * 41.23, "arrival__dwell_s": 1.0}
    log = fly(short_scenario(control_period_s=41.23, **brief), "zero", body=kleopatra())
    assert log.dataset.sizes["time"] > 10
    assert len(log.dataset["ranges"]) == log.dataset.sizes["time"]
