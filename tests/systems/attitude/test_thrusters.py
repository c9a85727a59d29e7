"""Layouts, allocation against scipy, pulses, and what thrusters truly give."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog
from scipy.spatial.transform import Rotation

from proxops.diagrams.scenario import load_spacecraft
from proxops.systems import InputError, ThrusterErrors
from proxops.systems.attitude import (
    AllocationProgram,
    Failure,
    ThrusterAllocation,
    ThrusterCluster,
    ThrusterLayout,
    TrueRigidBodyConfig,
    lost_directions,
    true_layout,
)
from proxops.systems.attitude.thruster_allocation import pulses

TWELVE = load_spacecraft("smallsat").thrusters
SIXTEEN = load_spacecraft("smallsat_16").thrusters


@pytest.mark.parametrize("layout", [TWELVE, SIXTEEN], ids=["12", "16"])
def test_an_allocation_takes_the_least_propellant_as_scipy_finds_it(layout):
    rng = np.random.default_rng(3)
    program, wrenches = AllocationProgram(layout), layout.wrenches()
    for _ in range(50):
        force, torque = rng.uniform(-4, 4, 3), rng.uniform(-0.5, 0.5, 3)
        found = program.solve(force, torque, wrenches)
        given_wrench = wrenches @ found.shares
        np.testing.assert_allclose(given_wrench, np.append(force, torque), atol=1e-9)
        other = linprog(
            layout.forces, A_eq=wrenches, b_eq=np.append(force, torque), bounds=(0.0, 1.0)
        )
        assert layout.forces @ found.shares == pytest.approx(other.fun, rel=1e-7)
        # Basilisk's way: the pseudo-inverse, less its least.
        shares = np.linalg.pinv(wrenches) @ np.append(force, torque)
        assert layout.forces @ (shares - shares.min()) > 1.2 * other.fun


@pytest.mark.parametrize("layout", [TWELVE, SIXTEEN], ids=["12", "16"])
def test_what_follows_from_the_basis_before_is_what_the_solver_finds(layout):
    rng = np.random.default_rng(5)
    program, wrenches = AllocationProgram(layout), layout.wrenches()
    force, torque, basis, kept = np.array([1.0, -2.0, 0.5]), np.zeros(3), None, 0
    for _ in range(200):
        force = force + rng.normal(scale=0.3, size=3)
        torque = 0.9 * torque + rng.normal(scale=0.01, size=3)
        found = program.solve(force, torque, wrenches, basis)
        fresh = program.solve(force, torque, wrenches)
        assert layout.forces @ found.shares == pytest.approx(layout.forces @ fresh.shares, abs=1e-4)
        assert found.force == pytest.approx(fresh.force, abs=1e-5)
        kept += found.basis is basis
        basis = found.basis
    assert kept > 100
    assert not program.solve(np.zeros(3), np.zeros(3), wrenches, basis).shares.any()


def test_where_a_force_cannot_be_given_torque_and_direction_stay():
    program, wrenches = AllocationProgram(TWELVE), TWELVE.wrenches()
    force, torque = np.array([30.0, 15.0, 0.0]), np.array([0.2, -0.1, 0.3])
    found = program.solve(force, torque, wrenches)
    np.testing.assert_allclose(
        wrenches @ found.shares, [*(found.force * force), *torque], atol=1e-9
    )
    assert 0.2 < found.force < 0.3
    # Not even the torque: as much as there is, and no force.
    found = program.solve(force, np.array([100.0, 0.0, 0.0]), wrenches)
    assert found.force == pytest.approx(0.0, abs=1e-9)
    assert (wrenches @ found.shares)[3] == pytest.approx(3.2)


@pytest.mark.parametrize("lost", range(16))
def test_sixteen_thrusters_give_every_wrench_without_any_one(lost):
    program, wrenches = AllocationProgram(SIXTEEN), SIXTEEN.wrenches()
    wrenches[:, lost] = 0.0
    for axis in np.concatenate([np.eye(3), -np.eye(3)]):
        found = program.solve(3.0 * axis, 0.5 * axis, wrenches)
        np.testing.assert_allclose(
            wrenches @ found.shares, np.tile(axis, 2) * np.repeat([3, 0.5], 3), atol=1e-9
        )
        assert found.shares[lost] == 0.0


def test_a_thruster_that_fails_takes_a_direction_along_and_the_rest_of_the_force_is_given():
    wrenches = TWELVE.wrenches()
    for failed, name in ((0, [1, 0, 0]), (3, [-1, 0, 0]), (6, [0, -1, 0])):
        left = wrenches.copy()
        left[:, failed] = 0.0
        np.testing.assert_array_equal(lost_directions(left), [name])
        # As linprog finds it: no force along it without a torque.
        axis = np.append(name, np.zeros(3))
        assert linprog(np.ones(12), A_eq=left, b_eq=axis, bounds=(0.0, 1.0)).status == 2
    assert not lost_directions(wrenches).size
    assert not any(lost_directions(np.delete(SIXTEEN.wrenches(), k, 1)).size for k in range(16))
    system = ThrusterAllocation(TWELVE, 1.0)
    context = system.CreateDefaultContext()
    failed = np.zeros(12)
    failed[0] = 1.0
    for port, value in (
        ("force", [2.0, -1.0, 3.0]), ("attitude", [1.0, 0.0, 0.0, 0.0]),
        ("torque", np.zeros(3)), ("failed", failed),
    ):  # fmt: skip
        system.GetInputPort(port).FixValue(context, value)
    given_force = system.GetOutputPort("given_force").Eval(context)
    np.testing.assert_allclose(given_force, [0.0, -1.0, 3.0], atol=1e-9)
    np.testing.assert_array_equal(system.GetOutputPort("lost").Eval(context), [1.0, 0.0, 0.0])


@settings(max_examples=50)
@given(st.lists(st.floats(0.0, 1.0), min_size=5, max_size=30), st.floats(0.0, 0.3))
def test_pulses_owe_no_more_than_one_that_is_too_short(wanted, least):
    owed, total = np.zeros(1), 0.0
    for share in wanted:
        on, owed = pulses(np.array([share]), owed, 1.0, least)
        total += on[0]
        assert on[0] == 0.0 or least <= on[0] <= 1.0
        assert owed[0] >= 0.0
    # A thruster that is on all the time forgets what it owes.
    assert total <= sum(wanted) + 1e-9
    assert sum(wanted) - total <= least + 1e-9 or max(wanted) + least > 1.0


def test_the_diagrams_allocation_turns_the_force_into_s_and_says_what_it_gives():
    system = ThrusterAllocation(TWELVE, 1.0)
    context = system.CreateDefaultContext()
    turn = Rotation.from_rotvec([0.4, -0.3, 0.8])
    force, torque = np.array([2.0, 1.0, -3.0]), np.array([0.1, 0.2, -0.1])
    for name, value in (
        ("force", force), ("attitude", turn.as_quat(scalar_first=True)), ("torque", torque)
    ):  # fmt: skip
        system.GetInputPort(name).FixValue(context, value)

    def output(name):
        return system.GetOutputPort(name).Eval(context)

    np.testing.assert_allclose(output("given_force"), force, atol=1e-9)
    np.testing.assert_allclose(output("given_torque"), torque, atol=1e-9)
    in_s = TWELVE.wrenches() @ output("on_times")
    np.testing.assert_allclose(turn.apply(in_s[:3]), force, atol=1e-9)
    each = output("on_times")[:, None] * TWELVE.forces[:, None] * turn.apply(TWELVE.directions)
    np.testing.assert_allclose(output("given_apart"), np.linalg.norm(each, axis=0), atol=1e-9)
    # What is estimated of the thrusters, and one that has failed.
    torques = TWELVE.wrenches()[3:] + 0.02 * np.sin(np.arange(36.0)).reshape(3, 12)
    system.GetInputPort("thruster_torques").FixValue(context, torques.ravel())
    np.testing.assert_allclose(torques @ output("on_times"), torque, atol=1e-9)
    system.GetInputPort("failed").FixValue(context, np.eye(12)[2])
    assert output("on_times")[2] == 0.0


def test_a_cluster_gives_what_each_thruster_gives_at_its_place():
    layout = true_layout(
        TWELVE,
        TrueRigidBodyConfig(
            centre_of_mass_m=[0.02, -0.01, 0.03],
            thruster_scale_std=0.02,
            thruster_direction_std_deg=0.5,
            thruster_place_std_m=0.01,
        ),
        ThrusterErrors(scale=(1.1, 0.9, 1.0), direction=(0.0, 0.0, 0.05)),
        seed=4,
    )
    cluster = ThrusterCluster(layout, 2.0, 220.0, Failure(5, 100.0))
    context = cluster.CreateDefaultContext()
    times = np.linspace(0.0, 2.0, 12)
    cluster.get_input_port().FixValue(context, times)
    for time in (0.0, 200.0):
        context.SetTime(time)
        working = times * (np.arange(12) != 5) if time else times
        parts = [
            share / 2.0 * size * direction
            for share, size, direction in zip(
                working, layout.forces, layout.directions, strict=True
            )
        ]
        force, torque, flow = (
            cluster.GetOutputPort(name).Eval(context) for name in ("force", "torque", "mass_flow")
        )
        np.testing.assert_allclose(force, sum(parts))
        np.testing.assert_allclose(torque, np.cross(layout.places, parts).sum(axis=0))
        assert flow[0] == pytest.approx(working @ layout.forces / 2.0 / (220.0 * 9.80665))
    # All directions are turned together by 0.05 rad, and each by itself.
    mean = np.cross(TWELVE.directions, layout.directions).sum(axis=0)
    assert mean[2] == pytest.approx(8 * 0.05, abs=0.03)
    np.testing.assert_allclose(np.median(layout.forces[:4]) / 4.0, 1.1, atol=0.04)
    np.testing.assert_allclose(
        (layout.places - TWELVE.places).mean(axis=0), [-0.02, 0.01, -0.03], atol=0.01
    )


def test_thrusters_that_cannot_turn_about_an_axis_are_refused():
    with pytest.raises(InputError, match="torque about x in both"):
        ThrusterLayout(np.zeros((12, 3)), TWELVE.directions, TWELVE.forces)
    one_way = np.abs(TWELVE.directions)
    with pytest.raises(InputError, match="force along x in both"):
        ThrusterLayout(TWELVE.places, one_way, TWELVE.forces)
