"""The rigid spacecraft against closed forms, Drake's MultibodyPlant and an integration in N."""

import math

import numpy as np
import pytest
from pydrake.autodiffutils import ExtractGradient, InitializeAutoDiff
from pydrake.common.value import Value
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce, MultibodyPlant
from pydrake.multibody.tree import RevoluteJoint, SpatialInertia, UnitInertia
from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from pydrake.systems.primitives import ConstantVectorSource
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from proxops.diagrams.scenario.body import load_body
from proxops.systems import InputError, PolyhedralGravity, RigidSpacecraft
from proxops.systems.common import check_inertia, cross_matrix
from proxops.systems.vehicle import RigidBodyStart
from proxops.systems.vehicle.actual_thrust import STANDARD_GRAVITY

WHEELS = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.6, 0.0, 0.8]])
INERTIA = np.array([[38.0, 1.0, -2.0], [1.0, 31.0, 0.5], [-2.0, 0.5, 24.0]])
STILL = {"force": 3, "torque": 3, "gravity": 3, "gravity_gradient": 9, "mass_flow": 1}


def flown(craft, duration, step=0.1, wheel_torque=None, gravity=None, **inputs):
    """The state of a spacecraft after a time under constant inputs, by RK5 in equal steps."""
    builder = DiagramBuilder()
    builder.AddSystem(craft)
    if gravity is not None:
        builder.AddSystem(gravity)
        builder.Connect(craft.GetOutputPort("position"), gravity.GetInputPort("position"))
        builder.Connect(gravity.GetOutputPort("acceleration"), craft.GetInputPort("gravity"))
        builder.Connect(gravity.GetOutputPort("gradient"), craft.GetInputPort("gravity_gradient"))
    if wheel_torque is not None:
        inputs["wheel_torque"] = wheel_torque
    for name, size in STILL.items():
        if gravity is None or not name.startswith("gravity"):
            inputs.setdefault(name, np.zeros(size))
    for name, value in inputs.items():
        source = builder.AddSystem(ConstantVectorSource(np.atleast_1d(value)))
        builder.Connect(source.get_output_port(), craft.GetInputPort(name))
    simulator = Simulator(builder.Build())
    ResetIntegratorFromFlags(simulator, "runge_kutta5", step).set_fixed_step_mode(True)
    simulator.AdvanceTo(duration)
    context = craft.GetMyContextFromRoot(simulator.get_context())
    return {
        port.get_name(): port.Eval(context)
        for port in (craft.get_output_port(k) for k in range(craft.num_output_ports()))
    }


def rotation(quaternion):
    return Rotation.from_quat(quaternion, scalar_first=True)


def test_a_symmetric_top_turns_as_in_closed_form():
    """Torque-free, J = diag(a, a, c): w precesses about z at (c - a) / a w_z (Wertz, 16.1)."""
    a, c, w = 10.0, 18.0, np.array([0.03, 0.01, 0.04])
    craft = RigidSpacecraft(
        100.0,
        np.diag([a, a, c]),
        np.zeros(3),
        RigidBodyStart(np.zeros(6), angular_velocity=tuple(w)),
    )
    out = flown(craft, 900.0, step=0.5)
    rate = (c - a) / a * w[2]
    precession = Rotation.from_rotvec([0, 0, rate * 900.0])
    np.testing.assert_allclose(out["angular_velocity"], precession.apply(w), atol=1e-9)
    # The attitude: turned about the fixed momentum at |L| / a, and back about the axis.
    momentum = np.diag([a, a, c]) @ w
    closed = Rotation.from_rotvec(momentum / a * 900.0) * precession.inv()
    assert (rotation(out["attitude"]) * closed.inv()).magnitude() < 1e-7


def test_energy_and_angular_momentum_stay():
    """With wheels that coast, the bus's energy and the whole momentum in N stay to 1e-10."""
    w = np.array([0.02, -0.03, 0.05])
    craft = RigidSpacecraft(
        100.0,
        INERTIA,
        np.zeros(3),
        RigidBodyStart(np.zeros(6), angular_velocity=tuple(w)),
        wheel_axes=WHEELS,
        wheel_inertia=0.05,
    )
    bus = INERTIA - 0.05 * WHEELS.T @ WHEELS
    out = flown(craft, 600.0, wheel_torque=np.zeros(3))

    def momentum(rate, wheels, attitude):
        return rotation(attitude).apply(bus @ rate + wheels @ WHEELS)

    first = momentum(w, 0.05 * WHEELS @ w, [1, 0, 0, 0])
    last = momentum(out["angular_velocity"], out["wheel_momentum"], out["attitude"])
    assert np.linalg.norm(last - first) < 1e-10 * np.linalg.norm(first)
    # Wheels without motors keep their momentum, so the bus's own energy is kept.
    energies = [rate @ bus @ rate for rate in (w, out["angular_velocity"])]
    assert abs(energies[1] / energies[0] - 1.0) < 1e-10


class _PushedBody(LeafSystem):
    """Force and torque that are constant in a body's own axes, for MultibodyPlant."""

    def __init__(self, plant, body, force, torque):
        super().__init__()
        self.index, self.push = body.index(), (torque, force)
        poses = self.DeclareAbstractInputPort("poses", Value([RigidTransform()]))
        self.DeclareAbstractOutputPort(
            "forces",
            lambda: Value([ExternallyAppliedSpatialForce()]),
            lambda context, out: out.set_value([self.wrench(poses.Eval(context))]),
        )

    def wrench(self, poses):
        turn = poses[int(self.index)].rotation().matrix()
        push = ExternallyAppliedSpatialForce()
        push.body_index = self.index
        push.F_Bq_W = SpatialForce(*(turn @ part for part in self.push))
        return push


def test_it_moves_as_drakes_multibody_plant_does():
    """A bus with three driven wheels under a force and a torque, 100 s."""
    wheel_mass, wheel_inertia, w = 4.0, 0.05, (0.01, 0.02, -0.015)
    force, torque = np.array([1.0, -2.0, 0.5]), np.array([0.02, 0.01, -0.03])
    motors = np.array([0.02, -0.03, 0.01])
    builder = DiagramBuilder()
    plant = builder.AddSystem(MultibodyPlant(0.0))
    plant.mutable_gravity_field().set_gravity_vector(np.zeros(3))
    shape = UnitInertia(0.4, 0.36, 0.3, 0.01, -0.02, 0.0)
    bus = plant.AddRigidBody("bus", SpatialInertia(88.0, np.zeros(3), shape))
    ball = UnitInertia.SolidSphere(math.sqrt(2.5 * wheel_inertia / wheel_mass))
    for k, axis in enumerate(WHEELS):
        wheel = plant.AddRigidBody(f"w{k}", SpatialInertia(wheel_mass, np.zeros(3), ball))
        frames = bus.body_frame(), wheel.body_frame()
        plant.AddJointActuator(f"m{k}", plant.AddJoint(RevoluteJoint(f"j{k}", *frames, axis)))
    plant.Finalize()
    pushed = builder.AddSystem(_PushedBody(plant, bus, force, torque))
    builder.Connect(plant.get_body_poses_output_port(), pushed.get_input_port())
    builder.Connect(pushed.get_output_port(), plant.get_applied_spatial_force_input_port())
    simulator = Simulator(builder.Build())
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    plant.get_actuation_input_port().FixValue(context, motors)
    plant.SetVelocities(context, np.append(w, np.zeros(plant.num_velocities() - 3)))
    bodies = plant.GetBodyIndices(bus.model_instance())
    whole = plant.CalcSpatialInertia(context, bus.body_frame(), bodies)
    craft = RigidSpacecraft(
        whole.get_mass(),
        whole.CalcRotationalInertia().CopyToFullMatrix3(),
        np.zeros(3),
        RigidBodyStart(np.zeros(6), angular_velocity=w),
        wheel_axes=WHEELS,
        wheel_inertia=wheel_inertia,
    )
    ResetIntegratorFromFlags(simulator, "runge_kutta5", 0.1).set_fixed_step_mode(True)
    simulator.AdvanceTo(100.0)
    out = flown(craft, 100.0, force=force, torque=torque, wheel_torque=motors)
    pose = plant.EvalBodyPoseInWorld(context, bus)
    assert np.linalg.norm(pose.translation() - out["position"]) < 1e-6
    other = Rotation.from_matrix(pose.rotation().matrix())
    assert (other.inv() * rotation(out["attitude"])).magnitude() < 1e-6


class _PointMasses:
    """A rigid body of a few point masses, in the field of a body that turns: in N, by DOP853."""

    def __init__(self, field, spin, masses, places):
        self.field, self.spin, self.masses, self.places = field, spin, masses, places
        squares = np.sum(places**2, axis=1)
        self.inertia = (masses @ squares) * np.eye(3) - (places.T * masses) @ places

    def rates(self, time, state):
        place, velocity, momentum = state[:3], state[3:6], state[6:9]
        attitude = state[9:].reshape(3, 3)
        body = Rotation.from_rotvec(np.array(self.spin) * time).as_matrix()
        points = place + self.places @ attitude.T
        pulls = self.field.evaluate(points @ body).acceleration @ body.T
        forces = self.masses[:, None] * pulls
        torque = np.cross(points - place, forces).sum(axis=0)
        rate = attitude @ np.linalg.solve(self.inertia, attitude.T @ momentum)
        return np.concatenate(
            [
                velocity,
                forces.sum(axis=0) / self.masses.sum(),
                torque,
                (cross_matrix(rate) @ attitude).ravel(),
            ]
        )


def test_motion_and_gravity_gradient_are_those_of_point_masses_in_n():
    """The torque of the gradient, the turning frame and the spin, without any of our formulas."""
    field, spin = load_body("kleopatra").gravity_field, np.array([1e-4, -5e-5, 3e-4])
    masses = np.array([20.0, 30.0, 20.0, 30.0])
    # Kilometres long, so that the gradient turns it at all.
    places = 600.0 * np.array([[1.0, 0, 0], [0, 0.7, 0.1], [0, 0, 0.5], [0, 0, 0]])
    places -= masses @ places / masses.sum()
    bodies = _PointMasses(field, spin, masses, places)
    start = np.array([1.2e5, 3e4, 5e4, -10.0, 15.0, 5.0])
    w = np.array([2e-4, -3e-4, 1e-4])
    in_n = start[3:] + np.cross(spin, start[:3])
    first = np.concatenate([start[:3], in_n, bodies.inertia @ w, np.eye(3).ravel()])
    found = solve_ivp(bodies.rates, (0, 1500), first, "DOP853", rtol=1e-11, atol=1e-9).y[:, -1]
    craft = RigidSpacecraft(
        100.0, bodies.inertia, spin, RigidBodyStart(start, angular_velocity=tuple(w))
    )
    out = flown(craft, 1500.0, step=5.0, gravity=PolyhedralGravity(field))
    body = Rotation.from_rotvec(spin * 1500.0)
    # The rest is the third derivative of the field over the body's length.
    np.testing.assert_allclose(body.apply(out["position"]), found[:3], atol=1.0)
    turned = (body * rotation(out["attitude"])).inv() * Rotation.from_matrix(
        found[9:].reshape(3, 3)
    )
    free = RigidSpacecraft(
        100.0, bodies.inertia, np.zeros(3), RigidBodyStart(start, angular_velocity=tuple(w))
    )
    without = rotation(flown(free, 1500.0, step=5.0)["attitude"]).inv()
    effect = (without * Rotation.from_matrix(found[9:].reshape(3, 3))).magnitude()
    assert effect > 0.1
    assert turned.magnitude() < 0.02 * effect


def test_burning_propellant_follows_tsiolkovsky():
    """Δv = Isp g0 ln(m0 / m)."""
    impulse, force = 220.0, 4.0
    flow = force / (impulse * STANDARD_GRAVITY)
    craft = RigidSpacecraft(100.0, INERTIA, np.zeros(3))
    out = flown(craft, 2000.0, step=1.0, force=[force, 0, 0], mass_flow=flow)
    change = impulse * STANDARD_GRAVITY * math.log(100.0 / out["mass"][0])
    assert out["velocity"][0] == pytest.approx(change, rel=1e-10)
    empty = RigidSpacecraft(1.0, INERTIA, np.zeros(3))
    with pytest.raises(InputError, match="propellant is used up"):
        flown(empty, 2000.0, step=1.0, mass_flow=1e-3)


def test_autodiff_gives_the_derivatives_of_finite_differences():
    """Of all rates, by all states."""
    rng = np.random.default_rng(4)
    craft = RigidSpacecraft(
        100.0,
        INERTIA,
        np.array([1e-4, 2e-4, 3e-4]),
        RigidBodyStart(rng.normal(size=6), (0.6, 0.0, 0.8, 0.0), (0.01, 0.02, 0.03)),
        wheel_axes=WHEELS,
        wheel_inertia=0.05,
    )
    context = craft.CreateDefaultContext()
    sizes = {**STILL, "wheel_torque": 3}
    for name, size in sizes.items():
        craft.GetInputPort(name).FixValue(context, rng.normal(size=size))
    state = context.get_continuous_state_vector().CopyToVector()

    def rates(x):
        context.SetContinuousState(x)
        return craft.EvalTimeDerivatives(context).CopyToVector()

    steps = 1e-6 * np.maximum(1.0, np.abs(state))
    expected = np.array(
        [
            (rates(state + d) - rates(state - d)) / (2.0 * step)
            for d, step in zip(np.diag(steps), steps, strict=True)
        ]
    ).T
    context.SetContinuousState(state)
    other = craft.ToAutoDiffXd()
    seeded = other.CreateDefaultContext()
    other.FixInputPortsFrom(craft, context, seeded)
    seeded.SetContinuousState(InitializeAutoDiff(state).ravel())
    found = ExtractGradient(other.EvalTimeDerivatives(seeded).CopyToVector())
    np.testing.assert_allclose(found, expected, atol=1e-7)


@pytest.mark.parametrize(
    ("inertia", "words"),
    [
        (np.diag([1.0, 1.0, 3.0]), "exceeds the sum of the others"),
        (np.diag([1.0, -1.0, 1.0]), "must be positive"),
        (np.array([[1.0, 0.5, 0], [0, 1, 0], [0, 0, 1]]), "symmetric"),
    ],
)
def test_an_inertia_that_no_body_has_is_refused(inertia, words):
    with pytest.raises(InputError, match=words):
        check_inertia("it", inertia)
