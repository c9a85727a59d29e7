"""The filter as a system, in the diagram, in the log; and against the plain functions."""

import numpy as np
import pytest
from one_system import context_of
from short_flights import BRIEF, Scripted, falling_flight, kleopatra, short_scenario

from proxops.diagrams.flight import fly, make_backup
from proxops.diagrams.logs.flight_log import FlightLog, differences
from proxops.diagrams.scenario.scenario import load_scenario
from proxops.systems import BackupBraking, InputError, InterventionReason, RuntimeAssurance
from proxops.systems.assurance import AssuranceBounds, AssuranceConfig
from proxops.systems.vehicle.state_prediction import predicted_state

# 1 km above the ellipsoid's end on the spin axis.
ABOVE_THE_POLE = {"transit__start_m": [0.0, 0.0, 66e3], "arrival__deadline_s": 1600.0}


@pytest.fixture(scope="module")
def backup() -> BackupBraking:
    bounds = AssuranceBounds(surface_m=100.0)
    return make_backup(load_scenario(), kleopatra(), AssuranceConfig(bounds))


@pytest.fixture(scope="module")
def held_flight() -> FlightLog:
    """The same as `falling_flight`, but with assurance."""
    return fly(short_scenario(**ABOVE_THE_POLE, assurance={"bounds": {"surface_m": 100}}), "zero")


def evaluate(system: RuntimeAssurance, state, force) -> tuple[np.ndarray, np.ndarray]:
    context = context_of(system, state=state, force=force)
    output = system.GetOutputPort("force").Eval(context)
    return output, system.GetOutputPort("intervention").Eval(context)


def test_what_is_safe_passes_bit_for_bit(backup: BackupBraking) -> None:
    wanted = [0.1 + 0.2, -1.0 / 3.0, 7.0]
    force, intervention = evaluate(
        RuntimeAssurance(backup), [150e3, 0, 80e3, 1.0, 2.0, 3.0], wanted
    )
    assert force.tobytes() == np.array(wanted).tobytes()
    assert np.array_equal(intervention, [0.0, InterventionReason.NONE])


def test_a_command_that_is_not_finite_is_left_to_the_thrusters(backup: BackupBraking) -> None:
    force, intervention = evaluate(RuntimeAssurance(backup), [150e3, 0, 0, 0, 0, 0], [np.nan, 0, 0])
    assert np.isnan(force[0])
    assert np.array_equal(intervention, [0.0, 0.0])
    with pytest.raises(InputError, match="a force must be finite"):
        fly(short_scenario(assurance={}, **BRIEF), Scripted(lambda time: np.full(3, np.nan)))


def test_no_thrust_at_all_ends_in_a_hover(held_flight: FlightLog) -> None:
    assert falling_flight().summary["keep_out_violations"] > 0
    summary = held_flight.summary
    assert summary["keep_out_violations"] == 0
    assert not summary["collided"]
    assert summary["min_clearance_m"] > 90.0
    # It is let fall for a while, then held with what gravity takes there: 2.4 N.
    assert summary["interventions"] > 120
    assert 25.0 < summary["intervention_delta_v_m_s"] < 50.0


def test_interventions_for_the_keep_out_are_counted_apart(held_flight: FlightLog) -> None:
    outwards = Scripted(lambda time: np.array([9.0, 0.0, 0.0]))
    clipped = fly(short_scenario(assurance={}, **BRIEF), outwards).summary
    assert clipped["interventions"] == clipped["steps"]
    assert clipped["interventions_keep_out"] == 0
    held = held_flight.summary
    assert 0 < held["interventions_keep_out"] <= held["interventions"]


def test_log_tells_each_intervention(held_flight: FlightLog, tmp_path) -> None:
    data = held_flight.dataset
    force, change = data["force"].values[:-1], data["intervention"].values[:-1]
    reason = data["intervention_reason"].values[:-1]
    # The command is zero, and nothing disturbs.
    assert change == pytest.approx(np.linalg.norm(force, axis=1), rel=1e-12)
    assert np.array_equal(change > 0.0, reason != InterventionReason.NONE)
    assert not data["disturbance"].values.any()
    assert data["intervention"].attrs["units"] == "N"
    margin = data["assurance_margin"].values[:-1]
    assert np.array_equal(margin < 0.0, reason >= InterventionReason.KEEP_OUT)
    assert not data["assurance_position"].values[:-1].any()
    meanings = data["intervention_reason"].attrs["flag_meanings"].split()
    assert meanings == ["none", "thrust_limit", "speed_limit", "keep_out", "backup"]
    summary = held_flight.summary
    assert summary["assured_share"] == 1.0
    assert summary["interventions"] == int((change > 1e-3).sum())
    assert summary["intervention_delta_v_m_s"] == pytest.approx(change.sum() * 10.0 / 100.0)
    held_flight.to_netcdf(tmp_path / "flight.nc")
    assert differences(held_flight, FlightLog.load(tmp_path / "flight.nc")) == []
    # Without it neither log nor summary has a word of it.
    assert not [name for name in falling_flight().dataset if "intervention" in str(name)]
    assert not [name for name in falling_flight().summary if "intervention" in name]


def test_same_flight_as_by_the_plain_functions(
    held_flight: FlightLog, backup: BackupBraking
) -> None:
    body, logged = kleopatra(), held_flight.dataset["state"].values
    state = logged[0]
    for row in range(150):
        force = backup.assure(state, np.zeros(3)).force
        assert force == pytest.approx(held_flight.dataset["force"].values[row], abs=2e-3)
        state = predicted_state(state, force, 10.0, body.gravity_field, 100.0, body.spin_rate)
        assert state == pytest.approx(logged[row + 1], abs=0.1)
    assert (held_flight.dataset["intervention"].values[:150] > 0.0).any()


def test_the_expert_is_left_alone() -> None:
    bare, assured = (fly(short_scenario(**BRIEF, **extra)) for extra in ({}, {"assurance": {}}))
    assert np.array_equal(bare.dataset["force"].values, assured.dataset["force"].values)
    assert np.array_equal(bare.dataset["state"].values, assured.dataset["state"].values)
    assert assured.summary["interventions"] == 0
    assert assured.summary["intervention_delta_v_m_s"] == 0.0


def test_stands_before_the_disturbance() -> None:
    """The logged disturbance holds nothing that the assurance changed."""
    settings = {"assurance": {}, "force_noise": {"std_n": 0.5}, **BRIEF}
    log = fly(short_scenario(**settings), Scripted(lambda time: np.array([-7.0, 0.0, 0.0])))
    bare = fly(short_scenario(**settings | {"assurance": None}), Scripted())
    noise = bare.dataset["disturbance"].values
    clipped = np.abs(log.dataset["force"].values) == 7.0
    assert (~clipped).sum() > 20
    assert log.dataset["disturbance"].values[~clipped] == pytest.approx(noise[~clipped], abs=1e-12)


def test_a_longer_covariance_needs_a_wider_margin(backup: BackupBraking) -> None:
    """As if the errors were the box's own: the box of the same bounds gives the same margin."""
    system = RuntimeAssurance(backup, deviations=3.0)
    state, force = np.array([0.0, 0.0, 68e3, 5.0, 0.0, -4.0]), np.array([1.0, 0.0, 0.0])
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    covariance = np.eye(9)
    covariance[:3, :3] = turn @ np.diag([4.0, 30.0, 50.0]) ** 2 @ turn.T
    covariance[3:6, 3:6] = turn @ np.diag([0.01, 0.02, 0.1]) ** 2 @ turn.T
    context = context_of(system, state=state, force=force)
    known = system.GetOutputPort("margin").Eval(context)
    assert known == pytest.approx([backup.assure(state, force).margin, 0.0, 0.0])
    system.GetInputPort("covariance").FixValue(context, covariance.ravel())
    margin, position, velocity = system.GetOutputPort("margin").Eval(context)
    assert (position, velocity) == pytest.approx((150.0, 0.3), rel=1e-9)
    assert margin == pytest.approx(backup.assure(state, force, 150.0, 0.3).margin, rel=1e-9)
    assert margin < known[0] - 150.0
    # Where a velocity is so uncertain that nothing at rest is admitted, nothing is judged.
    rest = np.array([0.0, 0.0, 90e3, 0.0, 0.0, 0.0])
    system.GetInputPort("state").FixValue(context, rest)
    for error in (0.3, 1.0, 3.0, 300.0):
        unknown = covariance.copy()
        unknown[3:6, 3:6] = (error / 3.0) ** 2 * np.eye(3)
        system.GetInputPort("covariance").FixValue(context, unknown.ravel())
        admitted = backup.assure(rest, np.zeros(3), 150.0, error).margin > 0.0
        assert np.isfinite(system.GetOutputPort("margin").Eval(context)[0]) == admitted
        assert admitted == (error < 3.0)
    np.testing.assert_array_equal(system.GetOutputPort("force").Eval(context), force)
    # Without a covariance, the navigation has no state.
    system.GetInputPort("covariance").FixValue(context, np.full(81, np.nan))
    assert np.isnan(system.GetOutputPort("margin").Eval(context)).all()
    assert np.array_equal(system.GetOutputPort("force").Eval(context), force)
