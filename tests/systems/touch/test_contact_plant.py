"""The contact plant against closed forms and the product's own plant."""

import numpy as np
import pytest
import trimesh
from even_field import EvenField
from pydrake.geometry import AddContactMaterial, HalfSpace, ProximityProperties, Sphere
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialVelocity
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, ContactModel, CoulombFriction
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    PrismaticJoint,
    PrismaticSpring,
    SpatialInertia,
    UnitInertia,
)
from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator
from pydrake.systems.framework import Context, Diagram, DiagramBuilder
from scipy.integrate import solve_ivp

from proxops.diagrams.scenario import load_body
from proxops.systems.common import InputError
from proxops.systems.rotation import Spin
from proxops.systems.shapes import Surface
from proxops.systems.touch.contact_plant import (
    Arm,
    Ground,
    TouchCraft,
    frame_wrench,
    make_contact_plant,
    patch_of,
    place_craft,
)
from proxops.systems.vehicle.rigid_spacecraft import RigidBodyStart, RigidSpacecraft

UPRIGHT, STILL = (1.0, 0.0, 0.0, 0.0), np.zeros(3)
DOWN = np.array([0.0, 0.0, -1.0])


def flat() -> Surface:
    """The ground z = 0: the upper face of a block."""
    mesh = trimesh.creation.box((40.0, 40.0, 2.0))
    mesh.apply_translation((0.0, 0.0, -1.0))
    return Surface(mesh.vertices, mesh.faces)


def craft(parts: bool = True, **arm: float) -> TouchCraft:
    bus = {"bus": (np.zeros(3), np.array([2.4, 2.4, 2.3]))} if parts else {}
    return TouchCraft(1015.0, np.diag([1200.0, 1250.0, 1300.0]), Arm(3.0 * DOWN, DOWN, **arm), bus)


def started(diagram: Diagram, state, rate=STILL, spin: Spin = 0.0) -> tuple[Simulator, Context]:
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    place_craft(diagram, context, np.array(state, dtype=float), UPRIGHT, rate, spin)
    simulator.Initialize()
    return simulator, context


def rows(diagram: Diagram, simulator: Simulator, until: float, *ports: str) -> list[np.ndarray]:
    """What ports put out each 10 ms."""
    context, found = simulator.get_mutable_context(), []
    for k in range(round(until / 0.01)):
        simulator.AdvanceTo(0.01 * (k + 1))
        found.append([diagram.GetOutputPort(port).Eval(context) for port in ports])
    return [np.array(column) for column in zip(*found, strict=True)]


@pytest.mark.parametrize("damping", [0.0, 200.0])
def test_a_mass_on_a_damped_spring(damping: float) -> None:
    """The bus, of 1,000 kg, on the arm, while the light head stays on hard ground."""
    stiff = Ground(modulus_pa=1e7)
    diagram = make_contact_plant(flat(), EvenField(), 0.0, craft(damping=damping), stiff)
    simulator, _ = started(diagram, [0, 0, 3.16, 0, 0, -0.1])
    state, arm, force = rows(diagram, simulator, 4.0, "state", "arm", "contact_force")
    spring = solve_ivp(
        lambda _, y: [y[1], -(1100.0 * y[0] + damping * y[1]) / 1000.0],
        (0.0, 4.0),
        [0.0, 0.1],
        rtol=1e-9,
        dense_output=True,
    )
    # From the first force on; for a quarter of a second the head bounces.
    first = int(np.flatnonzero(force[:, 2])[0])
    times = 0.01 * np.arange(1, 401 - first)
    expected = spring.sol(times)[0]
    pressed = (times > 0.25) & (times < 2.2)
    np.testing.assert_allclose(arm[first:, 0][pressed], expected[pressed], atol=0.002)
    assert arm[:, 0].max() == pytest.approx(expected.max(), rel=0.02)
    # The ground's impulse is the change of momentum.
    after = 1015.0 * state[-1, 5] + 15.0 * arm[-1, 1]
    assert force[:, 2].sum() * 0.01 == pytest.approx(101.5 + after, rel=0.01)
    if damping == 0.0:
        bus, head = state[-1, 5], state[-1, 5] + arm[-1, 1]
        energy = 500.0 * bus**2 + 7.5 * head**2 + 550.0 * arm[-1, 0] ** 2
        # Without what the head had as it was stopped.
        assert energy == pytest.approx(500.0 * 0.1**2, rel=0.01)


def test_half_the_step() -> None:
    found = []
    for step in (0.02, 0.01):
        diagram = make_contact_plant(flat(), EvenField([0, 0, -5e-5]), 0.0, craft(), step=step)
        simulator, _ = started(diagram, [0, 0, 3.18, 0.01, 0, -0.1])
        state, arm = rows(diagram, simulator, 4.0, "state", "arm")
        found.append([arm[:, 0].max(), *state[-1, 3:]])
    np.testing.assert_allclose(found[0], found[1], atol=5e-4)


def test_point_contact_on_a_half_space() -> None:
    """A plant with neither meshes nor hydroelastic contact, in a tenth of the step."""
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, 0.001)
    plant.set_contact_model(ContactModel.kPoint)
    plant.mutable_gravity_field().set_gravity_vector(np.zeros(3))
    material = ProximityProperties()
    friction = CoulombFriction(0.5, 0.5)
    AddContactMaterial(1.0, 1e5, friction, material)
    world, at_rest = plant.world_body(), RigidTransform(3.0 * DOWN)
    plant.RegisterCollisionGeometry(world, RigidTransform(), HalfSpace(), "ground", material)
    ball = UnitInertia.SolidSphere(0.16)
    # What is left for the bus: the head's own share of the whole is that of a ball 3 m away.
    own = ball.get_moments() + [9.0, 9.0, 0.0]
    rest = UnitInertia(*(([1200.0, 1250.0, 1300.0] - 15.0 * own) / 1000.0))
    bus = plant.AddRigidBody("bus", SpatialInertia(1000.0, -0.015 * 3.0 * DOWN, rest))
    head = plant.AddRigidBody("head", SpatialInertia(15.0, np.zeros(3), ball))
    root = plant.AddFrame(FixedOffsetFrame("root", bus.body_frame(), at_rest))
    arm = plant.AddJoint(PrismaticJoint("arm", root, head.body_frame(), -DOWN, damping=200.0))
    plant.AddForceElement(PrismaticSpring(arm, 0.0, 1100.0))
    plant.RegisterCollisionGeometry(head, RigidTransform(), Sphere(0.16), "head", material)
    plant.Finalize()
    simulator = Simulator(builder.Build())
    inside = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    start = np.array([0.0, 0.0, 3.18, 0.02, 0.0, -0.1])
    plant.SetFreeBodyPose(inside, bus, RigidTransform(start[:3]))
    plant.SetFreeBodySpatialVelocity(inside, bus, SpatialVelocity(STILL, start[3:]))
    strokes = []
    for time in np.arange(1, 401) * 0.01:
        simulator.AdvanceTo(time)
        strokes.append(arm.get_translation(inside))
    motion = plant.EvalBodySpatialVelocityInWorld(inside, bus)
    diagram = make_contact_plant(flat(), EvenField(), 0.0, craft(False), Ground(modulus_pa=1e7))
    own_simulator, _ = started(diagram, start)
    state, rate, stroke = rows(diagram, own_simulator, 4.0, "state", "angular_velocity", "arm")
    np.testing.assert_allclose(stroke[:, 0], strokes, atol=1.5e-3)
    np.testing.assert_allclose(state[-1, 3:], motion.translational(), rtol=0.01, atol=1e-5)
    np.testing.assert_allclose(rate[-1], motion.rotational(), rtol=0.01, atol=1e-5)


@pytest.mark.parametrize(("tilt", "rolls"), [(20.0, True), (75.0, False)])
def test_a_sphere_on_a_ramp(tilt: float, rolls: bool) -> None:
    """The head alone, with a hard arm in the middle of the craft: it rolls, or slides and turns."""
    radius, inertia, mass, friction, pull = 1.0, 4.0, 10.0, 0.5, 1.0
    arm = Arm(STILL, DOWN, head_mass=1.0, head_radius=radius, stiffness=2e3, damping=200.0)
    ball = TouchCraft(mass, inertia * np.eye(3), arm)
    angle = np.radians(tilt)
    field = EvenField([pull * np.sin(angle), 0.0, -pull * np.cos(angle)])
    ground = Ground(friction=friction, modulus_pa=1e5)
    diagram = make_contact_plant(flat(), field, 0.0, ball, ground)
    simulator, context = started(diagram, [0, 0, radius - 1e-4, 0, 0, 0])
    found = []
    for time in (1.5, 4.0):  # It settles first: the polyhedron is a little within the ball.
        simulator.AdvanceTo(time)
        state, turn = (diagram.GetOutputPort(p) for p in ("state", "angular_velocity"))
        found.append([state.Eval(context)[3], turn.Eval(context)[1]])
    speed, rate = np.array(found[1]) - found[0]
    ratio = inertia / (mass * radius**2)
    along = pull * np.sin(angle) / (1.0 + ratio)
    if rolls:
        assert rate * radius == pytest.approx(speed, rel=0.01)
    else:
        along = pull * (np.sin(angle) - friction * np.cos(angle))
        turned = friction * mass * pull * np.cos(angle) * radius / inertia
        # It slides over the facets of a polyhedron.
        assert rate == pytest.approx(2.5 * turned, rel=0.04)
        assert rate * radius < 0.9 * speed
    assert speed == pytest.approx(2.5 * along, rel=0.03)


def test_parts_that_touch_are_named() -> None:
    """The bus comes down beside its arm, turned over."""
    diagram = make_contact_plant(flat(), EvenField(), 0.0, craft())
    simulator, context = started(diagram, [0, 0, 1.2, 0, 0, -0.1])
    place_craft(
        diagram, context, np.array([0, 0, 1.2, 0, 0, -0.1]), (0.0, 1.0, 0.0, 0.0), STILL, 0.0
    )
    parts, head = rows(diagram, simulator, 1.0, "parts_force", "contact_force")
    assert parts.max() > 10.0
    assert not head.any()


@pytest.mark.slow
def test_free_flight_is_that_of_the_own_plant() -> None:
    """60 s above Bennu, turning, with thrust: `RigidSpacecraft` in small steps."""
    body = load_body("bennu")
    start = np.array([250.0, 120.0, 80.0, 0.05, -0.02, -0.1])
    rate, force = np.array([0.002, -0.001, 0.003]), np.array([1.0, -2.0, 0.5])
    torque = np.array([0.3, -0.2, 0.1])
    ship = craft(parts=False, stiffness=1e5, damping=2e3)
    far = patch_of(body.shape, body.shape.vertices[0], 30.0)
    diagram = make_contact_plant(far, body.exact_field, body.spin, ship)
    simulator, context = started(diagram, start, rate, body.spin)
    diagram.GetInputPort("force").FixValue(context, force)
    diagram.GetInputPort("torque").FixValue(context, torque)
    simulator.AdvanceTo(60.0)

    own = RigidSpacecraft(
        ship.mass, ship.inertia, body.spin.rate, RigidBodyStart(start, UPRIGHT, tuple(rate))
    )
    flown = Simulator(own)
    at = flown.get_mutable_context()
    ResetIntegratorFromFlags(flown, "runge_kutta3", 0.5)
    flown.get_mutable_integrator().set_fixed_step_mode(True)
    for name, value in (("force", force), ("torque", torque), ("mass_flow", [0.0])):
        own.GetInputPort(name).FixValue(at, value)
    own.GetInputPort("gravity_gradient").FixValue(at, np.zeros(9))
    for k in range(60):
        place = own.GetOutputPort("position").Eval(at)
        pull = body.exact_field.evaluate(place[None]).acceleration[0]
        own.GetInputPort("gravity").FixValue(at, pull)
        flown.AdvanceTo(k + 1.0)
    there, expected = (system.GetOutputPort("state").Eval(ctx) for system, ctx in (
        (diagram, context), (own, at)
    ))  # fmt: skip
    assert np.linalg.norm(expected[:3] - start[:3]) > 4.0
    np.testing.assert_allclose(there[:3], expected[:3], atol=2e-3)
    np.testing.assert_allclose(there[3:], expected[3:], atol=1e-4)
    turned, wanted = (system.GetOutputPort("attitude").Eval(ctx) for system, ctx in (
        (diagram, context), (own, at)
    ))  # fmt: skip
    assert 2.0 * np.arccos(min(1.0, abs(turned @ wanted))) < 1e-3


def test_forces_of_the_frame_that_turns() -> None:
    """A body that floats still in N, seen from a frame that turns ever faster."""
    spin, change = np.array([0.1, -0.2, 0.3]), np.array([0.01, 0.02, -0.01])
    inertia, place = np.diag([3.0, 4.0, 5.0]), np.array([1.0, 2.0, -1.0])
    # In the frame: w = -W, r' = -W x r; w' = -W' and r'' = W x (W x r) - W' x r.
    velocity = -np.cross(spin, place)
    torque, force = frame_wrench(2.0, inertia, place, velocity, -spin, spin, change)
    acceleration = np.cross(spin, np.cross(spin, place)) - np.cross(change, place)
    np.testing.assert_allclose(force, 2.0 * acceleration, atol=1e-14)
    momentum_change = inertia @ -change + np.cross(-spin, inertia @ -spin)
    np.testing.assert_allclose(torque, momentum_change, atol=1e-14)


def test_a_patch_of_a_map() -> None:
    shape = load_body("bennu").shape
    place = shape.vertices[shape.facets[700]].mean(axis=0)
    patch = patch_of(shape, place, 15.0)
    corners = shape.vertices[shape.facets]
    near = np.linalg.norm(corners - place, axis=2).min(axis=1) <= 15.0
    assert near.sum() <= len(patch.facets) < 40
    assert np.linalg.norm(patch.vertices - place, axis=1).max() < 60.0


def test_a_craft_too_light_for_its_arm_is_told_what_to_do() -> None:
    light = craft()._replace(inertia=np.diag([100.0, 110.0, 120.0]))
    with pytest.raises(InputError, match=r"set task\.arm_m lower: a head of 15 kg at 3 m"):
        make_contact_plant(flat(), EvenField(), 0.0, light)
