"""What flies on the navigation: who is told what, in which axes, and what the log keeps of it."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from navigation_double import IDENTITY, NavigationDouble, use
from pydrake.systems.framework import Diagram, System
from scipy.spatial.transform import Rotation
from short_flights import BRIEF, Scripted, kleopatra, on_lidar
from summary_names import NAVIGATION_SUMMARY

from proxops.diagrams.flight import fly, make_transit_diagram, named_controller
from proxops.diagrams.logs import FlightLog, differences, why_never_known
from proxops.diagrams.scenario import Scenario
from proxops.systems import PlanReason
from proxops.systems.common.errors import InputError

START = np.array([160e3, 0.0, 0.0, 0.0, 0.0, 0.0])
NOWHERE = np.full(6, np.nan)
# S is truly turned by 90 degrees about z, and by 90 degrees about x after that.
TURN = Rotation.from_rotvec([0.0, 0.0, np.pi / 2.0]) * Rotation.from_rotvec([np.pi / 2.0, 0.0, 0.0])


def built(controller: System | str, scenario: Scenario) -> Diagram:
    if isinstance(controller, str):
        controller = named_controller(controller, scenario, kleopatra())
    return make_transit_diagram(scenario, controller, body=kleopatra())


def wires(diagram: Diagram) -> set[tuple[str, str, str, str]]:
    """All connections: from which system and port to which."""
    found = set()
    for (system, port), (source, output) in diagram.connection_map().items():
        found.add(
            (
                source.get_name(), source.get_output_port(output).get_name(),
                system.get_name(), system.get_input_port(port).get_name(),
            )
        )  # fmt: skip
    return found


def scripted(force: Callable[[float], np.ndarray]) -> System:
    """Commands what a function of time says, and could read a state."""
    return Scripted(force, ports=[("state", 6)])


# --- who is told what -----------------------------------------------------------------------------

# What may know the true motion: the world, the lidar, and what watches a flight.
WORLD = {"gravity", "lidar", "monitor", "log_state", "view", "paths"}


@pytest.mark.filterwarnings("ignore:.*exceed assurance.bounds")
@pytest.mark.parametrize("controller", ["mpc", "pd", "hybrid", "policy"])
def test_no_wire_brings_the_truth_on_board(
    controller: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    use(monkeypatch, NavigationDouble(lambda time: START))
    scenario = on_lidar(
        assurance={"bounds": {}}, disturbance={}, kicks={}, truth__lidar__latency_steps=1,
        truth__attitude__constant_deg=[0.1, 0.0, 0.0], truth__specific_impulse_s=220.0,
    )  # fmt: skip
    found = wires(built(controller, scenario))
    told = {(to, port) for source, _, to, port in found if source == "spacecraft"}
    assert {to for to, _ in told} <= WORLD | {"log_mass"}
    turned = {to for source, _, to, _ in found if source == "attitude"}
    assert turned == {"lidar", "attitude_hold", "log_attitude"}
    # The lidar's frames go to what is on board alone.
    assert {to for source, _, to, _ in found if source == "lidar"} == {"frame_delay"}
    # And all that is on board is fed by the navigation, by frames, by commands and by the target.
    feeds = {
        source
        for source, _, to, _ in found
        if to in ("controller", controller, "navigation", "assurance", "command_axes")
    }
    feeds -= {"controller", controller}
    assert feeds <= {
        "navigation", "navigation_parts", "frame_delay", "command_hold", "target", "assurance",
    }  # fmt: skip
    assert ("navigation", "state", "assurance", "state") in found


def test_every_port_of_motion_is_the_navigation_s(monkeypatch: pytest.MonkeyPatch) -> None:
    use(monkeypatch, NavigationDouble(lambda time: START + np.arange(6)))
    controller = Scripted(ports=[("state", 6), ("position", 3), ("velocity", 3)])
    diagram = built(controller, on_lidar())
    context = controller.GetMyContextFromRoot(diagram.CreateDefaultContext())
    seen = {name: controller.GetInputPort(name).Eval(context) for name in ("position", "velocity")}
    np.testing.assert_array_equal(seen["position"], [160e3, 1.0, 2.0])
    np.testing.assert_array_equal(seen["velocity"], [3.0, 4.0, 5.0])
    np.testing.assert_array_equal(
        controller.GetInputPort("state").Eval(context), START + np.arange(6)
    )


# --- axes -----------------------------------------------------------------------------------------


def test_a_command_in_k_acts_in_k(monkeypatch: pytest.MonkeyPatch) -> None:
    """If the attitude is known, the turned axes change nothing of what a command in K does."""
    quaternion = TURN.as_quat(scalar_first=True)
    turned = {"truth__attitude__constant_deg": np.degrees(TURN.as_rotvec()).tolist()}

    def flown(scenario: Scenario, attitude: np.ndarray) -> FlightLog:
        use(monkeypatch, NavigationDouble(lambda time: START, lambda time: attitude))
        return fly(scenario, scripted(lambda time: np.array([5.0, -2.0, 0.1 * time])),
                   body=kleopatra())  # fmt: skip

    plain, same = flown(on_lidar(**BRIEF), IDENTITY), flown(on_lidar(**turned, **BRIEF), quaternion)
    np.testing.assert_allclose(same.dataset["state"], plain.dataset["state"], rtol=1e-9, atol=1e-6)
    # What the thrusters are to give is along the axes of S: x of S is z of K after both turns.
    force, command = same.dataset["force"].values, plain.dataset["force"].values
    np.testing.assert_allclose(TURN.apply(force.copy()), command, atol=1e-12)
    assert not np.allclose(force, command)


def test_the_held_command_is_told_in_s(monkeypatch: pytest.MonkeyPatch) -> None:
    """To the navigation: clipped and in S, one period late, and without the disturbance."""
    quaternion = TURN.as_quat(scalar_first=True)
    double = NavigationDouble(lambda time: START, lambda time: quaternion)
    use(monkeypatch, double)
    heard = double.told
    controller = scripted(lambda time: np.array([9.0, 0.1 * time, -3.0]))
    scenario = on_lidar(disturbance={}, force_noise={}, **BRIEF)
    data = fly(scenario, controller, body=kleopatra()).dataset
    assert np.abs(data["disturbance"]).max() > 0.1
    assert len(heard) >= 10
    for time, told in heard.items():
        asked = np.array([9.0, 0.1 * (time - 10.0), -3.0])
        expected = np.clip(TURN.inv().apply(asked), -7.0, 7.0) if time > 0.0 else np.zeros(3)
        np.testing.assert_allclose(told, expected, atol=1e-12)


# --- without a state ------------------------------------------------------------------------------


@pytest.mark.parametrize("controller", ["mpc", "pd", "hybrid"])
def test_flights_wait_for_the_navigation(controller: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is commanded on a state that is not there, but by a policy that needs none."""
    use(monkeypatch, NavigationDouble(lambda time: NOWHERE if time < 35.0 else START))
    log = fly(on_lidar(assurance={}, **BRIEF), controller, body=kleopatra())
    force = log.dataset["force"].values
    if controller != "hybrid":
        assert not force[:4].any()
    assert force[4:].any()
    if controller == "mpc":
        reasons = log.dataset["solve_reason"].values
        assert (reasons[:4] == PlanReason.INPUT_NOT_FINITE).all()
        assert reasons[4] == PlanReason.SOLVED_ANEW_NO_PLAN


# --- the log --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def drifting() -> FlightLog:
    """Nothing is commanded for 150 s. The navigation begins at 40 s, and is off by (3, 4, 0) m and
    0.03 rad."""
    off = np.array([3.0, 4.0, 0.0, 0.0, 0.0, 0.5])
    turn = np.array([np.cos(0.015), 0.0, np.sin(0.015), 0.0])
    double = NavigationDouble(
        lambda time: NOWHERE if time < 35.0 else START + off, lambda time: turn
    )
    scenario = on_lidar(log_ranges=True, **BRIEF)
    with pytest.MonkeyPatch.context() as monkeypatch:
        use(monkeypatch, double)
        return fly(scenario, Scripted(ports=[("state", 6)]), body=kleopatra())


@pytest.fixture
def log(drifting: FlightLog, monkeypatch: pytest.MonkeyPatch) -> FlightLog:
    """The drifting flight, whose figures count from 60 s on. Do not change it."""
    monkeypatch.setattr("proxops.diagrams.logs.navigation_figures._SETTLED", 60.0)
    return drifting


def test_phases_that_there_are_not_are_refused(log: FlightLog, tmp_path: Path) -> None:
    data = log.dataset
    damaged = data.assign(navigation_phase=data["navigation_phase"] + 7.0)
    FlightLog(damaged, log.body).to_netcdf(tmp_path / "flight.nc")
    with pytest.raises(InputError, match=r"has wrong .*navigation_phase"):
        FlightLog.load(tmp_path / "flight.nc")


def test_columns(log: FlightLog, tmp_path: Path) -> None:
    data = log.dataset
    assert np.isnan(data["navigation_state"].values[:4]).all()
    np.testing.assert_array_equal(data["navigation_state"].values[4, :2], [160e3 + 3.0, 4.0])
    np.testing.assert_array_equal(data["navigation_covariance"].values[5], np.eye(9))
    assert data["navigation_phase"].values[:6].tolist() == [0, 0, 0, 0, 1, 1]
    assert data["navigation_phase"].attrs["flag_meanings"] == "acquiring following lost"
    returns = np.isfinite(data["ranges"].values).sum(axis=(1, 2))
    np.testing.assert_array_equal(data["navigation_returns"].values, returns)
    for name, value in (("residual", 12.0), ("rejected", 3.0), ("innovation", 1.5)):
        assert (data[f"navigation_{name}"].values == value).all()
    log.to_netcdf(tmp_path / "flight.nc")
    assert differences(log, FlightLog.load(tmp_path / "flight.nc")) == []


def test_why_it_never_knew(log: FlightLog) -> None:
    scenario, surface = log.scenario, log.true_body.shape.vertices
    assert why_never_known(log.dataset, scenario, surface) == []
    data = log.dataset.copy(deep=True)
    data["navigation_state"][:] = np.nan
    ranges = data["ranges"].values
    most = np.isfinite(ranges).sum(axis=(1, 2)).max()
    ranges[::2] = np.inf
    data["ranges"][:] = ranges
    frames, seen = len(ranges), len(ranges) // 2
    assert why_never_known(data, scenario, surface) == [
        ("why it never did", "no frame showed for certain where it is"),
        ("frames with returns, and most returns of one", f"{seen} of {frames}, {most}"),
    ]
    # The spacecraft stays near [160, 0, 0] km; the body reaches to 104 km along x.
    (why, reach) = why_never_known(data.drop_vars("ranges"), scenario, surface)
    assert why == ("why it never did", "unknown: log_ranges is false")
    limit, away = re.findall(r"([\d.]+) km", reach[1])
    assert limit == "350"
    assert float(away) == pytest.approx(160 - surface[:, 0].max() / 1e3, abs=8.0)
    assert why_never_known(data.drop_vars("navigation_state"), scenario, surface) == []


def test_figures(log: FlightLog) -> None:
    data, summary = log.dataset, log.summary
    assert [name for name in summary if name.startswith("navigation_")] == NAVIGATION_SUMMARY
    late = data["time"].values >= 60.0
    fallen = (data["state"].values - START - [3.0, 4.0, 0.0, 0.0, 0.0, 0.5])[late]
    position = np.linalg.norm(fallen[:, :3], axis=1)
    assert summary["navigation_position_error_m_median"] == pytest.approx(np.median(position))
    assert summary["navigation_position_error_m_p95"] == pytest.approx(np.percentile(position, 95))
    velocity = np.linalg.norm(fallen[:, 3:], axis=1)
    assert summary["navigation_velocity_error_m_s_median"] == pytest.approx(np.median(velocity))
    assert summary["navigation_attitude_error_deg_median"] == pytest.approx(np.degrees(0.03))
    inside = (np.abs(fallen) <= 3.0).mean(axis=0)
    assert summary["navigation_consistent"] == pytest.approx(inside.min())
    steps = summary["steps"]
    assert summary["navigation_following"] == pytest.approx(1.0 - 4.0 / steps)
