"""The plant against conserved quantities, two-body motion and finite differences."""

import numpy as np
import pytest
from pydrake.autodiffutils import AutoDiffXd
from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from pydrake.systems.primitives import ConstantVectorSource, FirstOrderTaylorApproximation
from scipy.spatial.transform import Rotation

from proxops.diagrams.scenario.body import load_body
from proxops.systems import (
    InputError,
    PolyhedralGravity,
    PolyhedralGravity_,
    Spacecraft,
    Spacecraft_,
    jacobi_integral,
)

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


def coasting(gravity, state, force=(0.0, 0.0, 0.0), spin=SPIN):
    """A simulator of a spacecraft under a constant force, and the plant in it."""
    builder = DiagramBuilder()
    craft = builder.AddSystem(Spacecraft(100.0, spin, state))
    gravity = builder.AddSystem(gravity)
    thrust = builder.AddSystem(ConstantVectorSource(np.array(force)))
    builder.Connect(thrust.get_output_port(), craft.GetInputPort("force"))
    builder.Connect(craft.GetOutputPort("position"), gravity.GetInputPort("position"))
    builder.Connect(gravity.GetOutputPort("acceleration"), craft.GetInputPort("gravity"))
    simulator = Simulator(builder.Build())
    ResetIntegratorFromFlags(simulator, "runge_kutta5", 60.0).set_target_accuracy(1e-12)
    return simulator, craft


def state_of(simulator, craft):
    return craft.GetOutputPort("state").Eval(craft.GetMyContextFromRoot(simulator.get_context()))


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


def test_thrust_alone_moves_it_by_half_a_t_squared():
    class NoGravity(PointMass):
        def _calc(self, context, output):
            output.SetFromVector(np.zeros(3))

    simulator, craft = coasting(NoGravity(), np.zeros(6), force=(7.0, -3.5, 1.0), spin=0.0)
    simulator.AdvanceTo(100.0)
    expected = 0.5 * np.array([7.0, -3.5, 1.0]) / 100.0 * 100.0**2
    assert state_of(simulator, craft)[:3] == pytest.approx(expected, rel=1e-12)


def test_outputs_alone_need_no_simulator():
    craft = Spacecraft(100.0, SPIN, np.arange(6.0))
    context = craft.CreateDefaultContext()
    assert craft.GetOutputPort("position").Eval(context).tolist() == [0.0, 1.0, 2.0]
    assert craft.GetOutputPort("velocity").Eval(context).tolist() == [3.0, 4.0, 5.0]
    assert not craft.HasAnyDirectFeedthrough()


@pytest.mark.parametrize("mass", [0.0, -1.0, np.nan, np.inf])
def test_senseless_mass_is_refused(mass):
    with pytest.raises(InputError, match="Spacecraft needs mass above 0"):
        Spacecraft(mass, SPIN)


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
    context = gravity.CreateDefaultContext()
    position = np.array([100e3, 60e3, -10e3])
    gravity.GetInputPort("position").FixValue(context, position)
    direct = body.gravity_field.evaluate(position[None])
    assert np.array_equal(
        gravity.GetOutputPort("acceleration").Eval(context), direct.acceleration[0]
    )
    assert np.array_equal(
        gravity.GetOutputPort("gradient").Eval(context).reshape(3, 3), direct.gradient[0]
    )
    assert gravity.GetOutputPort("potential").Eval(context)[0] == direct.potential[0]
