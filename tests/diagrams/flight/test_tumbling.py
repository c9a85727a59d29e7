"""Flights at a body that tumbles: against an integration in N, and of those who know it or not."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydrake.autodiffutils import AutoDiffXd, ExtractGradient, InitializeAutoDiff
from scipy.integrate import solve_ivp
from short_flights import BRIEF, kleopatra, short_scenario

from proxops.assets import ASSETS
from proxops.diagrams.flight import fly
from proxops.diagrams.scenario import load_body, load_scenario
from proxops.diagrams.scenario.body import Body
from proxops.diagrams.scenario.bounds import tumbling
from proxops.diagrams.scenario.true_body import make_true_body
from proxops.systems import InputError, RigidSpacecraft, Spacecraft
from proxops.systems.rotation import SteadySpin, TorqueFreeSpin

SHIPPED = ASSETS / "kleopatra" / "kleopatra.yaml"


def written(folder: Path, rotation: str, **changes: str) -> str:
    """A body's file: Kleopatra with another rotation."""
    lines = SHIPPED.read_text().splitlines()
    lines = [line for line in lines if line.partition(":")[0] not in ("mesh", *changes)]
    lines += [f"mesh: {SHIPPED.with_name('kleopatra.obj')}", f"rotation: {rotation}"]
    lines += [f"{key}: {value}" for key, value in changes.items()]
    path = folder / "other.yaml"
    path.write_text("\n".join(lines))
    return str(path)


@pytest.fixture(scope="module")
def wobbling(tmp_path_factory) -> Body:
    """Kleopatra as its own inertia, 13.7 degrees off the axis, makes it turn."""
    return load_body(written(tmp_path_factory.mktemp("wobbling"), "!TorqueFreeSpin {}"))


@pytest.mark.parametrize("spacecraft", ["PointMass", "RigidBody"])
@pytest.mark.parametrize("told", [True, False])
def test_a_coasting_spacecraft_moves_as_in_n(wobbling, spacecraft, told):
    """Gravity of the body as it is turned at the time, integrated in N with Euler's equation."""
    changes = {"spacecraft": {"_tag": f"!{spacecraft}"}, "truth__tumbles": not told}
    log = fly(short_scenario(**BRIEF, **changes), "zero", body=wobbling if told else kleopatra())
    states = log.dataset["state"].values
    rate, inertia = wobbling.spin.rate, wobbling.inertia_of(wobbling.shape)

    def derivative(_, y):
        position, velocity, w, turn = y[:3], y[3:6], y[6:9], y[9:].reshape(3, 3)
        pull = wobbling.gravity_field.evaluate((turn.T @ position)[None]).acceleration[0]
        change = -np.linalg.solve(inertia, np.cross(w, inertia @ w))
        return np.concatenate([velocity, turn @ pull, change, np.cross(turn, w).ravel()])

    start = states[0, :3], states[0, 3:] + np.cross(rate, states[0, :3]), rate, np.eye(3).ravel()
    end = float(log.dataset["time"].values[-1])
    path = solve_ivp(derivative, (0.0, end), np.concatenate(start), "DOP853", rtol=1e-12)
    position, velocity, w, turn = np.split(path.y[:, -1], [3, 6, 9])
    turn = turn.reshape(3, 3)
    seen = turn.T @ velocity - np.cross(w, turn.T @ position)
    np.testing.assert_allclose(states[-1, :3], turn.T @ position, atol=1e-4)
    np.testing.assert_allclose(states[-1, 3:], seen, atol=1e-6)
    np.testing.assert_allclose(log.dataset["position_inertial"].values[-1], position, atol=1e-4)


@pytest.mark.parametrize("kind", [Spacecraft, RigidSpacecraft])
def test_derivatives_by_a_spin_that_is_told(kind: Any) -> None:
    """AutoDiff by the state and by what the ports say of the spin, against differences."""
    craft = RigidSpacecraft(100.0, np.diag([30.0, 35.0, 38.0]), None)
    if kind is Spacecraft:
        craft = Spacecraft(100.0, None)
    context = craft.CreateDefaultContext()
    size = context.num_continuous_states()
    for k in range(craft.num_input_ports()):
        port = craft.get_input_port(k)
        port.FixValue(context, np.linspace(1e-4, 3e-4, port.size()))
    state = context.get_continuous_state_vector().CopyToVector()
    state[-6:] += np.linspace(1.0, 2.0, 6)

    def rates(system, context, values):
        context.SetContinuousState(values[:size])
        for k, name in enumerate(("spin", "spin_rate")):
            part = values[size + 3 * k : size + 3 * k + 3]
            system.GetInputPort(name).FixValue(context, part)
        return system.EvalTimeDerivatives(context).CopyToVector()

    values = np.concatenate([state, [1e-4, -2e-4, 3e-4], [3e-8, 1e-8, -2e-8]])
    twin = craft.ToAutoDiffXd()
    other = twin.CreateDefaultContext()
    other.SetTimeStateAndParametersFrom(context)
    for k in range(craft.num_input_ports()):
        port = craft.get_input_port(k)
        twin.get_input_port(k).FixValue(other, port.Eval(context).astype(AutoDiffXd))
    found = ExtractGradient(rates(twin, other, InitializeAutoDiff(values).ravel()))
    for k in range(size, size + 6):
        change = 1e-6 * np.eye(values.size)[k]
        column = rates(craft, context, values + change) - rates(craft, context, values - change)
        np.testing.assert_allclose(found[:, k], column / 2e-6, rtol=1e-6, atol=1e-9)


@pytest.mark.slow
def test_who_knows_the_wobble_flies_as_if_there_were_none(wobbling):
    """Navigation and MPC, against the flight at a body that turns steadily; and who is not told."""
    settings = {"transit.index": 0, "log_ranges": False}
    worlds = ((kleopatra(), False), (wobbling, False), (kleopatra(), True))
    steady, told, untold = (
        fly(load_scenario(None, settings | {"truth.tumbles": tumbles}), "mpc", body=body)
        for body, tumbles in worlds
    )
    spent = [log.summary["delta_v_m_s"] for log in (steady, told, untold)]
    assert spent[1] < 1.01 * spent[0]
    assert spent[2] > 1.2 * spent[0]

    def off(log):
        state = log.dataset["state"].values[:, :3]
        away = log.dataset["navigation_state"].values[:, :3] - state
        return float(np.nanmedian(np.linalg.norm(away, axis=1)))

    assert off(told) < 1.2 * off(steady)
    assert off(untold) > 50.0 * off(steady)


def test_the_true_rotation_follows_from_the_true_shape(wobbling):
    scenario = load_scenario(None, {"truth.surface_rms_m": 300.0, "truth.spin": 1.01})
    truth = make_true_body(wobbling, scenario.truth)
    assert isinstance(truth.spin, TorqueFreeSpin)
    np.testing.assert_allclose(truth.spin.inertia, wobbling.inertia_of(truth.shape))
    np.testing.assert_allclose(truth.spin.rate, 1.01 * wobbling.spin.rate)
    assert make_true_body(wobbling, load_scenario().truth).spin is wobbling.spin
    scenario = load_scenario(None, {"truth.tumbles": True})
    untold = make_true_body(kleopatra(), scenario.truth).spin
    np.testing.assert_array_equal(untold.attitude(5e3), wobbling.spin.attitude(5e3))


def test_runtime_assurance_counts_the_wobble(tmp_path):
    """Its box covers what a spin about z leaves out, at any place, speed and time near the body."""
    inertia = "[1.0, 20.0, 20.1, 0.0, 0.0, 0.0]"
    body = load_body(
        written(tmp_path, f"!TorqueFreeSpin {{axis: [0.02, 0.0, 1.0], inertia: {inertia}}}")
    )
    random = np.random.default_rng(3)
    worst = 0.0
    for time in random.uniform(0.0, 2e5, 300):
        place = random.normal(size=3)
        place *= 280e3 / np.linalg.norm(place)
        speed = random.choice([-40.0, 40.0], 3)
        w, e = body.spin.angular_velocity(time), body.spin.angular_acceleration(time)
        about_z = np.array([0.0, 0.0, body.spin_about_z])
        felt, known = (
            2.0 * np.cross(w, speed) + np.cross(w, np.cross(w, place)) for w in (w, about_z)
        )
        worst = max(worst, float(np.abs(felt + np.cross(e, place) - known).max()))
    bound = tumbling(body, 40.0)
    assert 0.2 * bound < worst < bound
    assert tumbling(kleopatra(), 40.0) == 0.0
    with pytest.raises(InputError, match="does not hold"):
        fly(
            short_scenario(assurance={"bounds": {}}),
            "zero",
            body=load_body(written(tmp_path, "!TorqueFreeSpin {}")),
        )


def test_rotations_of_a_file(tmp_path):
    retrograde = load_body(written(tmp_path, "{axis: [0, 0, -1]}"))
    assert isinstance(retrograde.spin, SteadySpin)
    assert retrograde.spin_about_z == -kleopatra().spin_rate
    for rotation, words in (
        ("{axis: [0, 0, 0]}", "rotation.axis has no direction"),
        ("!TorqueFreeSpin {inertia: [1, 2]}", "rotation.inertia must be six"),
        ("!TorqueFreeSpin {inertia: [1, 1, 3, 0, 0, 0]}", "exceeds the sum"),
        ("!Wobble {}", "Wobble"),
    ):
        with pytest.raises(InputError, match=words):
            load_body(written(tmp_path, rotation))
