"""Touch-and-goes: who may fly one, the plant that moves it, and a short one from end to end."""

import math

import numpy as np
import pytest

from proxops.assets import ASSETS
from proxops.diagrams.flight import fly, make_simulator, make_transit_diagram
from proxops.diagrams.flight.touching import TouchMotion
from proxops.diagrams.logs import FlightLog, all_flown_by, fallback_steps
from proxops.diagrams.scenario import (
    RigidBodyConfig,
    Scenario,
    TouchAndGoConfig,
    World,
    load_body,
    load_scenario,
    touch_site,
    with_site,
)
from proxops.systems.common import InputError
from proxops.systems.hybrid import FlownBy
from proxops.systems.touch import TouchPhase

SITE = [-252.14338085390872, -69.76997925691796, 42.55667400738204]
# From 9 m, on the true state.
LOW = {
    "navigation": {"_tag": "!TrueState"},
    "log_ranges": False,
    "lidar.planes": 2,
    "lidar.rays": 8,
    "task.site": SITE,
    "task.aside_m": 0.1,
    "task.limits.length_m": 20.0,
    "task.descent.home_m": 9.0,
    "task.descent.checkpoint_m": 8.0,
    "task.descent.matchpoint_m": 7.0,
    "task.descent.terminal_m": 4.0,
    "task.descent.checkpoint_s": 24.0,
    "task.descent.matchpoint_s": 12.0,
    "task.descent.contact_s": 72.0,
    "task.away.high_m": 7.0,
    "task.away.speed_m_s": 0.15,
    "arrival.deadline_s": 600.0,
}


def low(**changes: object) -> Scenario:
    return load_scenario("bennu_touch_and_go", {**LOW, **changes})


@pytest.mark.slow  # Who asks for a place that cannot be touched is told which can.
@pytest.mark.parametrize(
    ("changes", "controller", "message"),
    [
        ({"task.site": [80.0, 0.0, 1.0]}, "mpc", "task.site: the position is .* off the map"),
        ({"task.site": [1.0]}, "mpc", "task.site: give LAT,LON in degrees or X,Y,Z"),
        ({"task.limits.slope_deg": 0.1}, "mpc", "no place of Bennu can be touched, most for"),
        ({"spacecraft": {"_tag": "!PointMass"}}, "mpc", "spacecraft: !RigidBody"),
        ({}, "pd", "'pd' flies transits: a touch-and-go is flown by mpc, policy or hybrid"),
        ({}, f"policy:{ASSETS / 'any_body'}", "is not the bundle of a descent"),
        ({"task.descent.home_m": 5.0}, "mpc", "must fall"),
        ({"task.transit": True}, "mpc", r"home, 9 m .* too near for a transit"),
        (
            {"task.transit": True, "task.descent.home_m": 125.0},
            "mpc",
            r"keep_out_margin_m, 3000 m, .*: set mpc\.keep_out_margin_m below 77.*, or task\.desc",
        ),
    ],
)
def test_refused(changes: dict, controller: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        fly(low(**changes), controller)


def test_a_site_by_its_direction_and_as_it_was_written() -> None:
    """A position stays as it is to the bit; and the arm points against the normal."""
    body, (x, y, z) = load_body("bennu"), SITE
    where = [math.degrees(math.atan2(z, math.hypot(x, y))), math.degrees(math.atan2(y, x))]
    once = with_site(low(**{"task.site": where}), body)
    assert isinstance(once.task, TouchAndGoConfig)
    assert isinstance(once.spacecraft, RigidBodyConfig)
    assert once.task.site is not None
    np.testing.assert_allclose(once.task.site, SITE, atol=1e-6)
    again = with_site(once, body)
    assert again == once
    pointing, site = once.spacecraft.pointing, touch_site(once, body)
    down = np.array(pointing.place_m) - site.position
    np.testing.assert_allclose(down / np.linalg.norm(down), -site.normal, atol=1e-5)
    np.testing.assert_allclose(site.position - 3.0 * site.normal, once.task.site, atol=1e-9)


@pytest.mark.slow
def test_above_the_ground_both_plants_agree() -> None:
    """With thrust and wheels; the contact plant is of first order, in steps of 20 ms."""
    site = touch_site(low(), load_body("bennu"))
    start = site.position + 0.6 * site.normal
    ends = {f"transit.{end}_m": start.tolist() for end in ("start", "goal")}
    far = {"task.descent.home_m": 125.0}  # It thrusts to go there.
    scenario = low(**ends, **far, control_period_s=2.0)
    world = World.of(scenario)
    found = []
    for by_contact in (False, True):
        diagram = make_transit_diagram(scenario)
        simulator = make_simulator(diagram, world.scenario)
        context, craft = simulator.get_mutable_context(), diagram.GetSubsystemByName("spacecraft")
        own = craft.GetMyMutableContextFromRoot(context)
        state = own.get_continuous_state_vector().CopyToVector()
        state[7:10] += [1e-3, -2e-3, 1e-3]
        own.SetContinuousState(state)
        motion = TouchMotion(world, diagram)
        assert motion.near(context)
        if by_contact:
            motion.fly(simulator, 6.0)
        else:
            simulator.AdvanceTo(6.0)
        found.append(own.get_continuous_state_vector().CopyToVector())
    moved = np.abs(found[0] - state)
    assert moved[4:7].max() > 0.01
    assert moved[13:17].max() > 0.1  # The wheels turn it back.
    np.testing.assert_allclose(found[1][4:7], found[0][4:7], atol=2e-3)
    np.testing.assert_allclose(found[1][10:13], found[0][10:13], atol=1e-4)
    np.testing.assert_allclose(found[1][:4], found[0][:4], atol=1e-4)
    np.testing.assert_allclose(found[1][7:10], found[0][7:10], atol=5e-5)
    np.testing.assert_allclose(found[1][13:17], found[0][13:17], atol=0.02)
    assert found[1][17] == pytest.approx(found[0][17], abs=1e-4)


@pytest.fixture(scope="module")
def touched() -> FlightLog:
    return fly(low())


@pytest.mark.slow
def test_down_touched_and_home(touched: FlightLog) -> None:
    found, data = touched.summary, touched.dataset
    assert found["success"]
    assert found["safe"]
    assert found["touch_aborts"] == []
    phases = data["touch_phase"].values
    assert sorted(set(phases)) == [*range(TouchPhase.AWAY + 1)]
    assert found["touch_miss_m"] < 0.05
    assert found["touch_down_m_s"] == pytest.approx(0.1, abs=0.005)
    # A mass on the damped arm, of 1,385 kg: zeta = 200 / (2 sqrt(1100 1385)) = 0.081.
    frequency, damping = np.sqrt(1100.0 / 1385.0), 100.0 / np.sqrt(1100.0 * 1385.0)
    stroke = found["touch_down_m_s"] / frequency * np.exp(-damping * np.pi / 2.0)
    assert found["touch_stroke_m"] == pytest.approx(stroke, rel=0.05)
    assert found["touch_duration_s"] == pytest.approx(np.pi / frequency, abs=0.5)
    kinetic = 0.5 * 1400.0 * found["touch_down_m_s"] ** 2
    assert found["touch_energy_j"] == pytest.approx(kinetic, rel=0.05)
    # The damper leaves so much of it; the thrust away begins while the head is on the ground.
    kept = np.exp(-2.0 * damping * np.pi)
    assert kept < found["touch_energy_left_j"] / found["touch_energy_j"] < 1.2 * kept
    assert found["touch_force_n"] == data["contact_force"].values.max()


@pytest.mark.slow
def test_one_log_without_a_gap(touched: FlightLog) -> None:
    data, period = touched.dataset, touched.scenario.control_period_s
    np.testing.assert_allclose(np.diff(data["time"].values), period, atol=1e-6)
    states, force = data["state"].values, data["contact_force"].values
    way = np.diff(states[:, :3], axis=0)
    mean = 0.5 * period * (states[1:, 3:] + states[:-1, 3:])
    free = (force[1:] == 0.0) & (force[:-1] == 0.0)
    # By the trapezoidal rule, whose error is a'' T^3 / 12 at most.
    assert np.abs(way - mean)[free].max() < 6.0 / 1400.0 * period**2 / 4.0
    assert (force > 0.0).sum() in (1, 2, 3)


@pytest.mark.slow
def test_it_flies_again_bit_for_bit(touched: FlightLog) -> None:
    again = fly(touched.scenario)
    np.testing.assert_array_equal(again.dataset["state"].values, touched.dataset["state"].values)


@pytest.mark.slow
@pytest.mark.parametrize(("controller", "share"), [("policy", 1.0), ("hybrid", 0.3)])
def test_a_policy_flies_the_legs(controller: str, share: float) -> None:
    """The hybrid asks the program at each tenth step, and at the first."""
    log = fly(low(), controller)
    found, data = log.summary, log.dataset
    legs = np.isin(data["touch_phase"].values[:-1], [1, 2, 3])
    assert found["success"]
    assert found["touch_miss_m"] < 0.1
    assert found["touch_policy_share"] == data["touch_by_policy"].values[:-1][legs].mean()
    assert share <= found["touch_policy_share"] <= (1.0 if controller == "policy" else 0.9)
    assert not data["touch_by_policy"].values[:-1][~legs].any()
    assert {FlownBy.POLICY, FlownBy.TOUCH} <= {*all_flown_by(data)}


@pytest.mark.slow
def test_a_transit_comes_first_and_an_orbit_last() -> None:
    """The hybrid flies it under assurance, and nothing of it counts once it is at home."""
    bennu = load_scenario("bennu")
    site = touch_site(low(), load_body("bennu"))
    start = site.position + 120.0 * site.normal + [0.0, 0.0, 20.0]
    scenario = low(
        **{
            "task.transit": True,
            "task.away.park_m": 380.0,
            "task.descent.home_m": 60.0,
            "task.descent.checkpoint_m": 40.0,
            "task.descent.matchpoint_m": 20.0,
            "task.descent.checkpoint_s": 250.0,
            "task.descent.matchpoint_s": 200.0,
            "task.descent.contact_s": 200.0,
            "transit.start_m": start.tolist(),
            "transit.start_velocity_m_s": [0.02, 0.0, 0.01],
            "assurance": {"_tag": "!Assurance"},
            "mpc.nominal_acceleration_m_s2": bennu.mpc.nominal_acceleration_m_s2,
            "mpc.min_horizon_s": bennu.mpc.min_horizon_s,
            "mpc.keep_out_margin_m": 5.0,
            "arrival.deadline_s": 4000.0,
        }
    )
    log = fly(scenario, "hybrid")
    found, data = log.summary, log.dataset
    phases = data["touch_phase"].values
    np.testing.assert_array_equal(data["state"].values[0], [*start, 0.02, 0.0, 0.01])
    assert found["success"]
    assert phases[0] == TouchPhase.TRANSIT
    assert phases[-1] == TouchPhase.PARK
    assert found["parked_m"] == pytest.approx(380.0, abs=40.0)
    assert not data["force"].values[-10:].any()
    steps = np.flatnonzero(phases != TouchPhase.TRANSIT)[0]
    assert (phases[steps:] >= TouchPhase.HOME).all()
    assert found["mpc_solves"] <= steps
    assert sum(fallback_steps(data).values()) == 0
    assert not np.nan_to_num(data["policy_force"].values[steps + 1 :]).any()  # It has no state.
