"""Flights of a rigid spacecraft: as a point's where they must be, and who is told what."""

import dataclasses as dc
from pathlib import Path

import numpy as np
import pytest
from pydrake.systems.framework import LeafSystem
from short_flights import NEAR, flown_and_taken_up

from proxops.diagrams.flight import fly
from proxops.diagrams.flight.transit_diagram import make_transit_diagram
from proxops.diagrams.logs import FlightLog
from proxops.diagrams.scenario import RigidBodyConfig, Scenario, load_scenario, load_spacecraft
from proxops.systems.attitude import AttitudeGuidanceConfig, pointing_error
from proxops.systems.common import InputError
from proxops.systems.navigation.navigator import Navigator
from proxops.systems.vehicle import STANDARD_GRAVITY

# Errors of everything that a rigid spacecraft has, and of all else, are drawn and declared.
DISPERSED = {"dispersions": "after_survey_rigid", "transit.index": 3}


def rigid(model: str = "smallsat", navigated: bool = True, **changes: object) -> Scenario:
    """`NEAR` with a rigid spacecraft; dots in keys are written as two underscores."""
    own = {key.replace("__", "."): value for key, value in changes.items()}
    scenario = load_scenario(None, {**NEAR, **own}, on_true_state=not navigated)
    return dc.replace(scenario, spacecraft=RigidBodyConfig(model=model))


def pointing_errors(log: FlightLog) -> np.ndarray:
    """The angles (N,) in degrees from the reference attitude to the true one."""
    pairs = zip(
        log.dataset["inertial_attitude"].values,
        log.dataset["reference_attitude"].values,
        strict=True,
    )
    return np.degrees([pointing_error(true, wanted) for true, wanted in pairs])


@pytest.fixture(scope="module")
def dispersed() -> FlightLog:
    """By the MPC on lidar navigation, with all errors."""
    return fly(rigid(**DISPERSED))


def test_it_arrives_and_points_though_nothing_is_as_on_the_data_sheet(dispersed):
    figures = dispersed.summary
    assert figures["success"]
    assert figures["navigation_consistent"] > 0.9
    # The star tracker's own error is not its to know; guidance and control are.
    mounting = np.linalg.norm(dispersed.scenario.truth.attitude.constant_deg)
    assert np.percentile(pointing_errors(dispersed)[5:], 99) < mounting + 0.1
    wheels = load_spacecraft("smallsat").wheels
    assert wheels is not None
    assert np.abs(dispersed.dataset["wheel_momentum"].values).max() < 0.5 * wheels.momentum
    assert not dispersed.dataset["failed_thrusters"].values.any()


def test_what_its_thrusters_gave_is_what_they_burned(dispersed):
    """Tsiolkovsky, and little more than the point takes that thrusts along its axes for nothing."""
    mass = dispersed.dataset["mass"].values
    change = STANDARD_GRAVITY * 220.0 * np.log(mass[0] / mass[-1])
    figures = dispersed.summary
    total = figures["delta_v_m_s"] + figures["hold_delta_v_m_s"]
    assert total == pytest.approx(change, rel=1e-6)
    point = fly(load_scenario(None, NEAR | DISPERSED | {"dispersions": "after_survey"})).summary
    assert total < 1.1 * (point["delta_v_m_s"] + point["hold_delta_v_m_s"])


def test_a_log_is_the_same_each_time_and_when_read_again(dispersed, tmp_path):
    brief = rigid(**DISPERSED, arrival__deadline_s=100.0, arrival__dwell_s=50.0)
    again = fly(brief).dataset
    for name in ("state", "inertial_attitude", "on_times", "wheel_momentum", "mass"):
        rows = again.sizes["time"]
        np.testing.assert_array_equal(again[name], dispersed.dataset[name][:rows])
    dispersed.to_netcdf(tmp_path / "flight.nc")
    read = FlightLog.load(tmp_path / "flight.nc")
    assert read.summary == dispersed.summary
    assert read.scenario.is_rigid


def test_a_flight_goes_on_from_a_clone_of_its_context():
    scenario = rigid(**DISPERSED)
    first, second = flown_and_taken_up(make_transit_diagram(scenario), scenario, 33.0, 70.0)
    np.testing.assert_array_equal(
        first.get_continuous_state_vector().CopyToVector(),
        second.get_continuous_state_vector().CopyToVector(),
    )


def test_a_thruster_that_fails_is_found_and_flown_without():
    failure = {
        "truth__rigid_body__failed_thruster": 2,
        "truth__rigid_body__failure_time_s": 50.0,
    }
    # From nearer by it takes longer.
    log = fly(rigid("smallsat", **failure, transit__goal_m=[160e3, 8e3, 0.0]))
    assert log.summary["success"]
    assert np.flatnonzero(log.dataset["failed_thrusters"].values[-1]).tolist() == [2]
    assert log.summary["lost_directions"] == ["-x"]
    assert 0.0 <= log.summary["failure_found_after_s"] <= 30.0
    # It turned, so that nobody asks for that.
    turned = log.dataset["reference_attitude"].values
    assert np.degrees(pointing_error(turned[-1], turned[0])) > 20.0


def test_pointing_takes_no_frames_but_those_of_control_steps(monkeypatch):
    """Guidance asks where the body is at each attitude step, and frames come at control steps."""
    times: list[float] = []
    step = Navigator.step

    def counted(self, *given, **options):
        times.append(len(times))
        return step(self, *given, **options)

    monkeypatch.setattr(Navigator, "step", counted)
    brief = rigid(arrival__deadline_s=60.0, arrival__dwell_s=30.0)
    craft = dc.replace(brief.spacecraft, pointing=AttitudeGuidanceConfig(mode="body"))
    log = fly(dc.replace(brief, spacecraft=craft))
    assert len(times) <= log.summary["steps"] + 2
    assert pointing_errors(log)[5:].max() < 0.1


class Tumble(LeafSystem):
    """A law of attitude guidance of one's own: turns about x at a rate in rad/s."""

    def __init__(self, rate: float, size: int = 4):
        super().__init__()
        self.rate = rate
        self.DeclareVectorOutputPort("reference", size, self._calc_reference)
        self.DeclareVectorOutputPort("reference_rate", 3, self._calc_rate)

    def _calc_reference(self, context, output):
        half = 0.5 * self.rate * context.get_time()
        output.SetFromVector([np.cos(half), np.sin(half), 0.0, 0.0])

    def _calc_rate(self, context, output):
        output.SetFromVector([self.rate, 0.0, 0.0])


def test_a_law_of_ones_own_turns_the_spacecraft(tmp_path, monkeypatch):
    law = Path(__file__).stem
    monkeypatch.chdir(Path(__file__).parent)
    brief = rigid(arrival__deadline_s=100.0, arrival__dwell_s=50.0)

    def by(name: str) -> Scenario:
        pointing = AttitudeGuidanceConfig(law=f"{law}:{name}")
        return dc.replace(brief, spacecraft=RigidBodyConfig(pointing=pointing))

    log = fly(by("tumbling"), "zero")
    assert pointing_errors(log)[5:].max() < 0.1
    turned = pointing_error(*log.dataset["inertial_attitude"].values[[0, -1]])
    assert np.degrees(turned) == pytest.approx(np.degrees(2e-3) * log.dataset["time"][-1], abs=1.0)
    with pytest.raises(InputError, match="'reference' of 4 numbers"):
        fly(by("wrong"), "zero")


def tumbling(scenario, body) -> Tumble:
    return Tumble(2e-3)


def wrong(scenario, body) -> Tumble:
    return Tumble(2e-3, 3)


# What may know how the spacecraft truly moves and turns: the world, its sensors, and the log.
WORLD = {
    "gravity", "accelerations", "lidar", "monitor", "inertial_attitude", "star_tracker", "gyro",
    "wheel_friction", "thruster_cluster", "spacecraft",
}  # fmt: skip


def test_no_wire_brings_the_truth_to_what_turns_the_spacecraft():
    diagram = make_transit_diagram(rigid(**DISPERSED, assurance={}))
    told = set()
    for (to, port), (source, out) in diagram.connection_map().items():
        names = source.get_name(), source.get_output_port(out).get_name()
        told.add((*names, to.get_name(), to.get_input_port(port).get_name()))
    for source, out, to, port in told:
        if to in WORLD or to.startswith("log_"):
            continue
        if source == "spacecraft":
            # Tachometers tell the speed of the wheels.
            assert (out, port) == ("wheel_momentum", "wheel_momentum"), (to, port)
        assert source not in ("inertial_attitude", "gravity", "thruster_cluster", "wheel_friction")
    readers = {to for source, _, to, _ in told if source in ("star_tracker", "gyro")}
    assert readers == {"attitude_filter"}
    # What is on board is made from the data sheet: it holds neither the true layout nor inertia.
    true = diagram.GetSubsystemByName("thruster_cluster").layout.places
    for name in ("thruster_allocation", "torque_estimator"):
        known = diagram.GetSubsystemByName(name).layout.places
        assert np.abs(known - true).max() > 1e-3
    inertia = diagram.GetSubsystemByName("spacecraft").inertia
    for name in ("attitude_control", "torque_estimator"):
        assert np.abs(diagram.GetSubsystemByName(name).inertia - inertia).max() > 0.1
