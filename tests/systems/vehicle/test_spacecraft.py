"""The plant against conserved quantities, two-body motion and finite differences."""

import numpy as np
import pytest
from jacobi import jacobi_integral
from one_system import evaluated
from pydrake.autodiffutils import AutoDiffXd
from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator
from pydrake.systems.framework import Diagram, DiagramBuilder, LeafSystem
from pydrake.systems.primitives import ConstantVectorSource, FirstOrderTaylorApproximation
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from proxops.diagrams.flight.simulation import make_simulator
from proxops.diagrams.scenario import load_body, load_scenario
from proxops.systems import (
    InputError,
    PolyhedralGravity,
    PolyhedralGravity_,
    Spacecraft,
    Spacecraft_,
)
from proxops.systems.vehicle import rotating_frame_acceleration
from proxops.systems.vehicle.spacecraft import spinning_frame_acceleration

MU = 1.98227e8
SPIN = 3.24093e-4


class PointMass(LeafSystem):
    """Gravity of a point mass at the origin."""

    def __init__(self):
        super().__init__()
        self._position = self.DeclareVectorInputPort("position", 3)
        self.DeclareVectorOutputPort(
            "acceleration", 3, self._calc, prerequisites_of_calc={self._position.ticket()}
        )

    def _calc(self, context, output):
        p = self._position.Eval(context)
        output.SetFromVector(-MU * p / np.linalg.norm(p) ** 3)


class NoGravity(PointMass):
    def _calc(self, context, output):
        output.SetFromVector(np.zeros(3))


def in_gravity(craft, gravity, **inputs) -> Diagram:
    """A spacecraft in gravity, with constant inputs."""
    builder = DiagramBuilder()
    builder.AddSystem(craft)
    builder.AddSystem(gravity)
    builder.Connect(craft.GetOutputPort("position"), gravity.GetInputPort("position"))
    builder.Connect(gravity.GetOutputPort("acceleration"), craft.GetInputPort("gravity"))
    for name, value in inputs.items():
        source = builder.AddSystem(ConstantVectorSource(np.array(value, dtype=float)))
        builder.Connect(source.get_output_port(), craft.GetInputPort(name))
    return builder.Build()


def coasting(gravity, state, force=(0.0, 0.0, 0.0), spin=SPIN):
    """A simulator of a spacecraft under a constant force, and the plant in it."""
    craft = Spacecraft(100.0, spin, state)
    simulator = Simulator(in_gravity(craft, gravity, force=force))
    ResetIntegratorFromFlags(simulator, "runge_kutta5", 60.0).set_target_accuracy(1e-12)
    return simulator, craft


def state_of(simulator, craft):
    return craft.GetOutputPort("state").Eval(craft.GetMyContextFromRoot(simulator.get_context()))


@pytest.mark.slow
def test_jacobi_integral_is_conserved_over_ten_hours():
    body = load_body("kleopatra")
    start = np.array([150e3, 20e3, 30e3, -5.0, 18.0, -6.0])
    simulator, craft = coasting(PolyhedralGravity(body.gravity_field), start, spin=body.spin_rate)
    states = [start]
    for hour in range(1, 11):
        simulator.AdvanceTo(3600.0 * hour)
        states.append(state_of(simulator, craft))
    states = np.array(states)
    gravity = body.gravity_field.evaluate(states[:, :3])
    assert not gravity.inside.any()
    assert np.ptp(np.linalg.norm(states[:, :3], axis=1)) > 20e3  # It really went somewhere.
    jacobi = jacobi_integral(states[:, :3], states[:, 3:], gravity.potential, body.spin_rate)
    assert np.abs(jacobi / jacobi[0] - 1.0).max() < 1e-9


def test_circular_orbit_seen_from_the_rotating_frame():
    radius, inclination = 200e3, 0.4
    rate = np.sqrt(MU / radius**3)
    tilt = Rotation.from_euler("x", inclination).as_matrix()
    inertial = tilt @ [radius, 0.0, 0.0]
    velocity = tilt @ [0.0, radius * rate, 0.0] - np.cross([0, 0, SPIN], inertial)
    simulator, craft = coasting(PointMass(), np.concatenate([inertial, velocity]))
    time = 20_000.0
    simulator.AdvanceTo(time)
    angle = rate * time
    later = tilt @ (radius * np.array([np.cos(angle), np.sin(angle), 0.0]))
    expected = Rotation.from_euler("z", -SPIN * time).as_matrix() @ later
    assert np.linalg.norm(state_of(simulator, craft)[:3] - expected) < 0.01


def plant_with_gravity(body):
    builder = DiagramBuilder()
    craft = builder.AddSystem(Spacecraft(100.0, body.spin_rate))
    gravity = builder.AddSystem(PolyhedralGravity(body.gravity_field))
    builder.Connect(craft.GetOutputPort("position"), gravity.GetInputPort("position"))
    builder.Connect(gravity.GetOutputPort("acceleration"), craft.GetInputPort("gravity"))
    builder.ExportInput(craft.GetInputPort("force"), "force")
    builder.ExportOutput(craft.GetOutputPort("state"), "state")
    return builder.Build()


def test_linearisation_of_plant_and_gravity_agrees_with_differences():
    body = load_body("kleopatra")
    plant = plant_with_gravity(body)
    context = plant.CreateDefaultContext()
    state = np.array([120e3, 40e3, -30e3, 3.0, -7.0, 2.0])
    force = np.array([1.0, 2.0, -3.0])
    context.SetContinuousState(state)
    plant.get_input_port().FixValue(context, force)
    linear = FirstOrderTaylorApproximation(plant, context)

    def rates(state, force):
        context.SetContinuousState(state)
        plant.get_input_port().FixValue(context, force)
        return plant.EvalTimeDerivatives(context).CopyToVector()

    steps = np.repeat([10.0, 1e-2], 3)
    for k, step in enumerate(steps):
        change = step * np.eye(6)[k]
        column = (rates(state + change, force) - rates(state - change, force)) / (2 * step)
        assert linear.A()[:, k] == pytest.approx(column, rel=1e-6, abs=1e-13)
    assert linear.B()[3:] == pytest.approx(np.eye(3) / 100.0)
    assert linear.C() == pytest.approx(np.eye(6))


def test_autodiff_versions_exist_and_keep_values():
    body = load_body("kleopatra")
    gravity = PolyhedralGravity(body.gravity_field)
    twin = gravity.ToAutoDiffXd()
    assert isinstance(twin, PolyhedralGravity_[AutoDiffXd])
    assert isinstance(Spacecraft(100.0, SPIN).ToAutoDiffXd(), Spacecraft_[AutoDiffXd])
    for system in (gravity, Spacecraft(100.0, SPIN)):
        assert system.ToSymbolicMaybe() is None
    position = np.array([90e3, -50e3, 20e3])
    values = {}
    for system, scalar in ((gravity, float), (twin, AutoDiffXd)):
        context = system.CreateDefaultContext()
        system.GetInputPort("position").FixValue(context, [scalar(x) for x in position])
        for name in ("acceleration", "potential"):
            out = system.GetOutputPort(name).Eval(context)
            values[scalar, name] = [x if scalar is float else x.value() for x in out]
    for name in ("acceleration", "potential"):
        assert values[float, name] == values[AutoDiffXd, name]


def test_gravity_outputs_alone():
    body = load_body("kleopatra")
    gravity = PolyhedralGravity(body.gravity_field)
    position = np.array([100e3, 60e3, -10e3])
    direct = body.gravity_field.evaluate(position[None])
    for name in ("acceleration", "gradient", "potential"):
        found = evaluated(gravity, name, position=position)
        assert np.array_equal(found, np.ravel(getattr(direct, name)[0]))


# A spin axis anywhere, and a mass that is used up

TILTED = SPIN * 1.02 * np.array([0.05, -0.08, 0.99])
AXIS_POINT = np.array([900.0, -2500.0, 400.0])


def as_flights_do(craft, gravity, **inputs) -> Simulator:
    """A simulator with the integrator of transits: steps of 10 s."""
    return make_simulator(in_gravity(craft, gravity, **inputs), load_scenario(None))


def test_any_spin_axis_against_the_inertial_frame():
    """The body turns about an axis through c, at rest in the inertial frame; the force is in K."""
    body, end = load_body("kleopatra"), 2000.0
    start = np.array([60e3, 90e3, 45e3, 12.0, 8.0, 5.0])
    force = np.array([1.5, -0.5, 2.0])

    def rates(time, state):
        to_k = Rotation.from_rotvec(-time * TILTED)
        place = AXIS_POINT + to_k.apply(state[:3] - AXIS_POINT)
        pull = body.gravity_field.evaluate(place[None]).acceleration[0] + force / 100.0
        return np.concatenate([state[3:], to_k.inv().apply(pull)])

    inertial = start.copy()
    inertial[3:] += np.cross(TILTED, start[:3] - AXIS_POINT)
    flown = solve_ivp(rates, (0.0, end), inertial, method="DOP853", rtol=1e-12, atol=1e-9)
    to_k = Rotation.from_rotvec(-end * TILTED)
    away = to_k.apply(flown.y[:3, -1] - AXIS_POINT)
    velocity = to_k.apply(flown.y[3:, -1]) - np.cross(TILTED, away)

    craft = Spacecraft(100.0, TILTED, start, axis_point=AXIS_POINT)
    simulator = as_flights_do(craft, PolyhedralGravity(body.gravity_field), force=force)
    simulator.AdvanceTo(end)
    found = state_of(simulator, craft)
    assert np.linalg.norm(found[:3] - AXIS_POINT - away) < 1e-3
    assert np.linalg.norm(found[3:] - velocity) < 1e-6


def test_about_z_both_forms_agree():
    draws = np.random.default_rng(3)
    for _ in range(20):
        position, velocity, gravity, force = draws.normal(size=(4, 3))
        numbers = (1e5 * position, 10.0 * velocity, 1e-2 * gravity, force, 90.0)
        plain = rotating_frame_acceleration(*numbers, SPIN)
        about_z = spinning_frame_acceleration(*numbers, (0.0, 0.0, SPIN), np.zeros(3))
        assert about_z == pytest.approx(plain, rel=1e-13)


def test_propellant_against_tsiolkovsky():
    """A burn along x without gravity or spin, from 100 kg to 60 kg."""
    exhaust, thrust, burnt = 220.0 * 9.80665, 7.0, 40.0
    flow = thrust / exhaust
    end = burnt / flow
    craft = Spacecraft(100.0, 0.0, np.zeros(6), burns_propellant=True)
    simulator = as_flights_do(craft, NoGravity(), force=[thrust, 0, 0], mass_flow=[flow])
    simulator.AdvanceTo(end)
    context = craft.GetMyContextFromRoot(simulator.get_context())
    left = craft.GetOutputPort("mass").Eval(context)[0]
    assert left == pytest.approx(100.0 - burnt, rel=1e-12)
    change = exhaust * np.log(100.0 / left)
    state = state_of(simulator, craft)
    assert state[3] == pytest.approx(change, rel=1e-10)
    # The way: v_e (t - (m / m') ln(m_0 / m)).
    assert state[0] == pytest.approx(exhaust * end - change * left / flow, rel=1e-10)
    assert state.size == 6
    assert craft.GetOutputPort("position").Eval(context).tolist() == state[:3].tolist()
    assert craft.GetOutputPort("velocity").Eval(context).tolist() == state[3:].tolist()


def test_propellant_that_is_used_up_says_so():
    craft = Spacecraft(100.0, 0.0, np.zeros(6), burns_propellant=True)
    simulator = as_flights_do(craft, NoGravity(), force=[7, 0, 0], mass_flow=[0.5])
    with pytest.raises(InputError, match=r"the propellant is used up: of 100 kg, less than 0\.1"):
        simulator.AdvanceTo(1000.0)


def test_derivatives_of_all_of_it_agree_with_differences():
    craft = Spacecraft(90.0, TILTED, np.zeros(6), axis_point=AXIS_POINT, burns_propellant=True)
    twin = craft.ToAutoDiffXd()
    assert isinstance(twin, Spacecraft_[AutoDiffXd])
    state = np.array([120e3, 40e3, -30e3, 3.0, -7.0, 2.0, 80.0])
    inputs = {"force": np.array([1.0, 2.0, -3.0]), "gravity": np.array([1e-3, 2e-3, 3e-3])}

    def rates(system, values, flow):
        context = system.CreateDefaultContext()
        context.SetContinuousState(values)
        for name, value in inputs.items():
            system.GetInputPort(name).FixValue(context, value.astype(values.dtype))
        system.GetInputPort("mass_flow").FixValue(context, np.array([flow], dtype=values.dtype))
        return system.EvalTimeDerivatives(context).CopyToVector()

    flow = AutoDiffXd(2e-3)
    found = rates(twin, np.array([AutoDiffXd(x, np.eye(7)[k]) for k, x in enumerate(state)]), flow)
    assert [each.value() for each in found] == pytest.approx(rates(craft, state, 2e-3), rel=1e-15)
    jacobian = np.array([np.resize(each.derivatives(), 7) for each in found[:6]])
    for k, step in enumerate([10.0] * 3 + [1e-2] * 4):
        change = step * np.eye(7)[k]
        column = rates(craft, state + change, 2e-3) - rates(craft, state - change, 2e-3)
        assert jacobian[:, k] == pytest.approx(column[:6] / (2 * step), rel=1e-6, abs=1e-11)
