"""The policy for any body: what it is told, what it refuses, and how it flies before it learns.

Eq. 20 and 21 of docs/method/equations.md.
"""

import dataclasses
import io
import math
import re
from pathlib import Path

import numpy as np
import pytest
import torch
from contact_binary import contact_binary
from exported_once import change_json, copied
from hypothesis import given, settings
from hypothesis import strategies as st
from known_guidance import write_guidance
from one_system import context_of, evaluated
from short_flights import kleopatra, short_scenario

from proxops.assets import ASSETS
from proxops.diagrams.flight import surroundings
from proxops.systems import (
    GravityField,
    GuidanceBundle,
    GuidancePolicy,
    InputError,
    PointMassField,
    Polyhedron,
    Surroundings,
)
from proxops.systems.policy import INPUTS, GuidanceNetwork
from proxops.systems.policy.guidance_policy import COAST
from proxops.systems.rotation import Spin, TorqueFreeSpin, spin_model
from proxops.training.networks import AnyBodyGuidance
from proxops.training.recipes.any_body import mirrored

AXES = np.array([140e3, 65e3, 64e3])


def around(scale: float = 1.0, push: float = 0.07) -> Surroundings:
    """Kleopatra's proportions as a point mass: all lengths times `scale`, at a thrust `push`."""
    rate = np.sqrt(push / 0.07 / scale)
    mass = 3e18 * scale**2 * push / 0.07
    return Surroundings(
        PointMassField(mass), mass, 3.2e-4 * rate, scale * AXES, push,
        40.0 * scale * rate, 10.0 / rate, 0.03 * push / 0.07,
    )  # fmt: skip


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_guidance(tmp_path_factory.mktemp("guidance") / "bundle")


@settings(max_examples=20)
@given(st.floats(1e-3, 1e2), st.floats(1e-6, 1.0), st.integers(0, 99))
def test_bodies_in_the_same_proportions_are_one(scale: float, push: float, seed: int) -> None:
    random = np.random.default_rng(seed)
    states, goals = random.normal(size=(4, 6)), random.normal(size=(4, 3))
    sizes = np.r_[np.full(3, 2e5), np.full(3, 20.0)]
    speed = np.sqrt(scale * push / 0.07)
    factors = np.r_[np.full(3, scale), np.full(3, speed)]
    mine = around().inputs(sizes * states, 2e5 * goals)
    other = around(scale, push).inputs(factors * sizes * states, scale * 2e5 * goals)
    np.testing.assert_allclose(other, mine, rtol=2e-6, atol=1e-7)


@pytest.mark.parametrize(
    "spin", [3.2e-4, TorqueFreeSpin(np.diag([1.0, 3.0, 3.2]), np.array([2e-4, 1e-4, 1e-4]))]
)
def test_acceleration_without_thrust_is_that_of_a_turning_frame(spin: Spin) -> None:
    """By the cross products of the textbook; over the thrust acceleration."""
    told, random, time = dataclasses.replace(around(), spin=spin), np.random.default_rng(2), 3000.0
    w = spin_model(spin).angular_velocity(time)
    change = spin_model(spin).angular_acceleration(time)
    states, goals = random.normal(size=(5, 6)) * 1e5, random.normal(size=(5, 3)) * 1e5
    given_ = told.at_rest(goals, time)
    told.fill_way(states, goals, given_, time)
    for row, state, goal in zip(given_, states, goals, strict=True):
        for at, where, velocity in (
            (slice(9, 12), state[:3], state[3:]),
            (slice(12, 15), goal, np.zeros(3)),
        ):
            wanted = told.field.evaluate(where[None]).acceleration[0] - np.cross(change, where)
            wanted = wanted - 2.0 * np.cross(w, velocity) - np.cross(w, np.cross(w, where))
            np.testing.assert_allclose(row[at], wanted / told.acceleration, rtol=1e-5)


def test_a_mirrored_body_gives_mirrored_inputs() -> None:
    mesh = contact_binary(250e3, 2)
    signs = np.array([-1.0, -1.0, -1.0])  # Mirrored in the equator, and turned by half a turn.
    other = Polyhedron(mesh.vertices * signs, mesh.faces[:, ::-1])
    body = Polyhedron(mesh.vertices, mesh.faces)
    random = np.random.default_rng(4)
    states, goals = random.normal(size=(6, 6)) * 2e5, random.normal(size=(6, 3)) * 2e5
    states[:, 3:] *= 1e-4
    rows = []
    for shape, flip in ((body, np.ones(3)), (other, signs)):
        told = dataclasses.replace(around(), field=GravityField(shape, density=3000.0))
        rows.append(told.inputs(states * np.tile(flip, 2), goals * flip))
    flipped, _ = mirrored(
        torch.from_numpy(rows[0]), torch.zeros(6, 3), torch.tensor(signs).float().expand(6, 3)
    )
    np.testing.assert_allclose(flipped.numpy(), rows[1], rtol=1e-5, atol=1e-6)


def test_forces_are_those_of_the_network_within_the_limit(bundle: Path) -> None:
    told = surroundings(short_scenario(), kleopatra())
    system = GuidancePolicy(bundle, told, 7.0)
    network = AnyBodyGuidance(16)
    torch.nn.init.zeros_(network.network[-1].weight)  # type: ignore[arg-type]
    coasts = []
    for state in ([160e3, 0.0, 0.0, 1.0, -2.0, 0.5], [160e3, 1e4, 0.0, 39.0, 0.0, 0.0]):
        force = evaluated(system, "force", state=state, target=[160e3, 8e3, 0.0, 0.0, 0.0, 0.0])
        row = told.inputs(np.array([state]), np.array([[160e3, 8e3, 0.0]]))
        with torch.no_grad():
            wanted = 7.0 * network(torch.from_numpy(row)).numpy()[0].clip(-1.0, 1.0)
        assert np.abs(np.abs(wanted) - 7.0 * COAST).min() > 1e-3
        wanted[np.abs(wanted) < 7.0 * COAST] = 0.0
        np.testing.assert_allclose(force, wanted, atol=1e-4)
        coasts.append((force == 0.0).any())
    assert np.abs(force).max() == 7.0
    assert any(coasts)
    context = context_of(system, state=np.full(6, np.nan), target=np.zeros(6))
    np.testing.assert_array_equal(system.GetOutputPort("force").Eval(context), np.zeros(3))
    assert system.GetOutputPort("record").Eval(context)[1] == 1


def test_it_hurries_where_it_would_be_late(bundle: Path) -> None:
    """Without corrections the force is the law's, of the time that the deadline leaves."""
    told = surroundings(short_scenario(), kleopatra())
    state, goal = np.array([160e3, 0.0, 0.0, 1.0, -2.0, 0.5]), np.array([165e3, 3e4, 0.0])
    row = told.inputs(state[None], goal[None])[0].astype(float)
    away, velocity, natural = row[6:9] - row[:3], row[3:6], row[9:12]
    unit = math.sqrt(told.length / told.acceleration)
    plain, late = (GuidancePolicy(bundle, told, 7.0, latest=end) for end in (math.inf, 5000.0))
    least = plain.bundle.network.least_time(0.03 / 0.07)
    forces = {}
    for time in (0.0, 4100.0, 4500.0, 4950.0):
        for system in (plain, late):
            inputs = {"state": state, "target": np.r_[goal, np.zeros(3)]}
            forces[system, time] = evaluated(system, "force", time, **inputs)
    for time in (4100.0, 4500.0):
        longest = 1.7 * (5000.0 - time) / unit - least
        law = 7.0 * (6.0 * away / longest**2 - 4.0 * velocity / longest - natural)
        law = np.where(np.abs(law) < 7.0 * COAST, 0.0, np.clip(law, -7.0, 7.0))
        np.testing.assert_allclose(forces[late, time], law, atol=1e-4)
        assert forces[late, time][1] > forces[plain, time][1] + 0.1
    for time in (0.0, 4950.0):  # There is time enough; it is too late.
        np.testing.assert_array_equal(forces[late, time], forces[plain, time])
    with pytest.raises(InputError, match="latest must be positive"):
        GuidancePolicy(bundle, told, 7.0, latest=0.0)


def test_what_it_did_not_learn_is_refused_by_name(bundle: Path) -> None:
    told = surroundings(short_scenario(), kleopatra())
    weak = dataclasses.replace(told, acceleration=0.5 * told.acceleration)
    with pytest.raises(InputError, match=r"gravity is .*, and it flies 0 to .*beyond_family"):
        GuidancePolicy(bundle, weak, 3.5)
    GuidancePolicy(bundle, weak, 3.5, beyond_family=True)
    with pytest.raises(InputError) as caught:
        GuidancePolicy(bundle, weak, 3.5)
    (enough,) = map(float, re.findall(r"A thrust limit of (\S+) N is enough", str(caught.value)))
    assert enough > 3.5
    stronger = dataclasses.replace(told, acceleration=enough / 7.0 * told.acceleration)
    GuidancePolicy(bundle, stronger, enough)
    with pytest.raises(InputError, match="shortest_semi_axis"):
        dataclasses.replace(told, semi_axes=np.array([1.0, 1.0, 0.0]))


@pytest.mark.parametrize(
    "axes",
    [
        [420.0, 60.0, 300.0],
        [420.0, 400.0, 50.0],
    ],
)
def test_what_it_says_of_the_keep_out_is_enough(axes: list[float]) -> None:
    """At balls and other bodies beyond its family, by the policy that ships."""
    scale = 150e3 / 420.0
    told = dataclasses.replace(
        surroundings(short_scenario(), kleopatra()), semi_axes=scale * np.array(axes)
    )
    with pytest.raises(InputError, match=r"semi_axis_\w is .* Lengthen") as caught:
        GuidancePolicy(ASSETS / "any_body", told, 7.0)
    assert "thrust" not in str(caught.value)
    longer = re.findall(r"by (\S+) m along ([xyz])", str(caught.value))
    found = told.semi_axes.copy()
    for metres, axis in longer:
        found["xyz".index(axis)] += float(metres)
    GuidancePolicy(ASSETS / "any_body", dataclasses.replace(told, semi_axes=found), 7.0)
    # Half of it is not.
    half = dataclasses.replace(told, semi_axes=0.5 * (found + told.semi_axes))
    with pytest.raises(InputError, match="semi_axis"):
        GuidancePolicy(ASSETS / "any_body", half, 7.0)


def test_a_body_that_is_a_little_rounder_is_told_longer() -> None:
    told = dataclasses.replace(
        surroundings(short_scenario(), kleopatra()), semi_axes=np.array([150e3, 149e3, 144e3])
    )
    policy = GuidancePolicy(ASSETS / "any_body", told, 7.0)
    longer = policy.surroundings.semi_axes - told.semi_axes
    assert 0.0 < longer.max() < 0.02 * 150e3
    assert longer.min() == 0.0
    assert not policy.bundle.beyond(policy.surroundings.numbers())


def test_what_it_says_of_the_control_period_is_enough(bundle: Path) -> None:
    told = surroundings(short_scenario(), kleopatra())
    with pytest.raises(InputError, match="Give a control period up to") as caught:
        GuidancePolicy(bundle, dataclasses.replace(told, period=100.0), 7.0)
    (longest,) = map(float, re.findall(r"up to (\S+) s\.", str(caught.value)))
    GuidancePolicy(bundle, dataclasses.replace(told, period=0.999 * longest), 7.0)


@pytest.mark.parametrize(
    "rows",
    [
        [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],  # Longest along y.
        [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]],  # Along z, and shortest along y.
        [[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]],  # Along z, and shortest along x.
    ],
)
def test_a_body_is_flown_alike_however_it_lies_in_k(rows: list, bundle: Path) -> None:
    """A body, its spin and a flight that are turned get forces that are turned."""
    turn = np.array(rows)
    told = surroundings(short_scenario(), kleopatra())
    shape = kleopatra().shape
    turned = dataclasses.replace(
        told,
        field=GravityField(Polyhedron(shape.vertices @ turn.T, shape.facets), mass=told.mass),
        semi_axes=np.abs(turn) @ told.semi_axes,
        spin=turn @ kleopatra().spin.rate,
    )
    state, target = np.array([170e3, 2e4, 1e4, 1.0, -9.0, 2.0]), np.array([5e4, 1e5, -2e4, 0, 0, 0])
    forces = []
    for around_, axes in ((told, np.eye(3)), (turned, turn)):
        system = GuidancePolicy(bundle, around_, 7.0)
        begun = np.r_[axes @ state[:3], axes @ state[3:]]
        goal = np.r_[axes @ target[:3], np.zeros(3)]
        forces.append(evaluated(system, "force", state=begun, target=goal))
    np.testing.assert_allclose(forces[1], turn @ forces[0], atol=1e-4)
    assert len(set(np.abs(forces[0]).round(3))) > 1


@pytest.mark.parametrize("blind", [False, True])
def test_what_flies_is_the_network_that_was_trained(blind: bool) -> None:
    """At states far from the ellipsoid and in it, at the goal, at rest, and beyond all limits."""
    random = np.random.default_rng(0)
    instead = torch.full((INPUTS,), torch.nan)
    if blind:
        instead[9:] = torch.rand(INPUTS - 9, generator=torch.Generator().manual_seed(1)) + 0.1
    network = AnyBodyGuidance(32, instead)
    rows = random.uniform(-1.0, 1.0, (300, INPUTS)) * 10.0 ** random.uniform(-4.0, 1.0, (300, 1))
    rows[:, 15:] = random.uniform(0.2, 1.5, (300, INPUTS - 15))
    rows[::7, 6:9] = rows[::7, :3]  # At the goal.
    rows[::5, 3:6] = 0.0
    rows = rows.astype(np.float32)
    with torch.no_grad():
        network.network[-1].weight.mul_(30.0)  # type: ignore[operator, union-attr]
        wanted = network(torch.from_numpy(rows)).numpy()
    got = np.array([network.compiled().run(row) for row in rows])
    np.testing.assert_allclose(got, wanted, rtol=2e-4, atol=2e-5 * np.abs(wanted).max())
    kept = GuidanceNetwork.from_bytes(network.compiled().to_bytes())
    np.testing.assert_array_equal([kept.run(row) for row in rows], got)


@pytest.mark.parametrize(
    ("name", "array", "words"),
    [
        ("weights_2", np.zeros((16, 15), np.float32), "weights_2 is float32 .*not float32"),
        ("biases_4", np.zeros(6), "biases_4 is float64"),
        ("law", np.array([1.0, np.nan], np.float32), "law has numbers that are not finite"),
        ("bends", np.array([None] * 9), "cannot be read"),
    ],
)
def test_arrays_of_other_networks_are_refused(name: str, array: np.ndarray, words: str) -> None:
    """Also those that would run code while they are read."""
    file, other = io.BytesIO(), AnyBodyGuidance(16).compiled()._replace(**{name: array})
    np.savez(file, allow_pickle=True, **other._asdict())
    with pytest.raises(InputError, match=words):
        GuidanceNetwork.from_bytes(file.getvalue())


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"ranges": {"spin": [1.0, 10**400]}}, "a least and a greatest"),
        ({"ranges": {"spin": [1.0, 2.0]}}, "each for semi_axis_x"),
        ({"format": "other"}, "not of the format"),
        ({"model_sha256": "0"}, "hash"),
    ],
)
def test_damaged_bundles_are_refused(
    bundle: Path, tmp_path: Path, change: dict, words: str
) -> None:
    folder = copied(bundle, tmp_path)
    change_json(folder / "guidance.json", **change)
    with pytest.raises(InputError, match=words):
        GuidanceBundle.load(folder)
