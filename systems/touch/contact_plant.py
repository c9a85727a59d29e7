"""Contact: a MultibodyPlant of the spacecraft, its arm and the ground, whose world frame is K.

The ground is a rigid hydroelastic mesh that is anchored in the world. So it does not move, and
every body of the spacecraft gets the forces that appear in a frame that turns. If the asteroid
were a body that moves, it would spoil the solver's tolerance, which is relative to the momentum of
the whole plant; and point contact would take the convex hull of the mesh.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from pydrake.common import MemoryFile
from pydrake.common.value import AbstractValue
from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    AddContactMaterial,
    AddRigidHydroelasticProperties,
    Box,
    InMemoryMesh,
    Mesh,
    ProximityProperties,
    SceneGraph,
    Shape,
    Sphere,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.math import SpatialForce, SpatialVelocity
from pydrake.multibody.plant import (
    AddMultibodyPlantSceneGraph,
    ContactModel,
    CoulombFriction,
    DiscreteContactApproximation,
    ExternallyAppliedSpatialForce,
    MultibodyPlant,
)
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    PrismaticJoint,
    PrismaticSpring,
    RigidBody,
    RotationalInertia,
    SpatialInertia,
    UnitInertia,
)
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, LeafSystem

from proxops.systems.common import (
    InputError,
    Matrix3,
    Quaternion,
    State,
    Vector3,
    check_inertia,
    check_positive,
    config,
    cross_matrix,
    kernel,
    number,
    rotation_matrix,
)
from proxops.systems.gravity import Field
from proxops.systems.rotation import Spin, spin_model
from proxops.systems.shapes import Surface
from proxops.systems.touch.sites import nearest_points

# Edges of the polyhedron that stands for a ball, in radii.
_RESOLUTION = 0.15


class Arm(NamedTuple):
    """A head on a sprung and damped joint that is pressed in along one axis. Judgement."""

    place: Vector3
    """(3,) in m in S: the middle of the head at rest."""
    direction: Vector3
    """(3,) unit vector in S from the bus out along the arm."""
    head_mass: float = 15.0
    """kg, included in the spacecraft's mass."""
    head_radius: float = 0.16
    """m."""
    stiffness: float = 1100.0
    """N/m."""
    damping: float = 200.0
    """N s/m."""


class TouchCraft(NamedTuple):
    """The spacecraft in contact. S has its origin in the centre of mass of all of it at rest."""

    mass: float
    """kg."""
    inertia: Matrix3
    """(3, 3) in kg m^2 of all of it, in S."""
    arm: Arm
    parts: Mapping[str, tuple[Vector3, Vector3]] = MappingProxyType({})
    """Boxes along S's axes that may touch, by name: middle and edges (3,) in m."""


@config
class Ground:
    """How the ground and the head give way and rub. Judgement.

    In contact the ground is rigid, and what gives way is a layer about head and parts: so it stands
    for soft ground, too, as far as the head sinks in by less than its radius.
    """

    # Coulomb's coefficient.
    friction: float = number(0.5, at_least=0.0, at_most=10.0)
    # Hydroelastic modulus. A head of 16 cm at 10 cm/s with 1,300 kg sinks in by 2 cm at 1e5 Pa, and
    # by 12 cm at 2e3 Pa.
    modulus_pa: float = number(1e5, at_least=2e3, at_most=1e9, unit="Pa")
    # Dissipation of Hunt and Crossley.
    dissipation_s_m: float = number(1.0, at_least=0.0, at_most=1e3, unit="s/m")


def inertia_without_head(craft: TouchCraft) -> Matrix3:
    """The inertia (3, 3) in kg m^2 in S of a spacecraft without its arm's head.

    Raises:
      InputError: there is none left, or one that no body has.
    """
    arm = craft.arm
    place = np.array(arm.place, dtype=float)
    ball = UnitInertia.SolidSphere(arm.head_radius)
    own = arm.head_mass * (
        ball.CopyToFullMatrix3() + (place @ place) * np.eye(3) - np.outer(place, place)
    )
    try:
        return check_inertia("the bus without its head", np.asarray(craft.inertia) - own)
    except InputError as error:
        raise InputError(
            f"set task.arm_m lower: a head of {arm.head_mass:g} kg at "
            f"{np.linalg.norm(place):.3g} m has more inertia than the spacecraft ({error})"
        ) from error


def patch_of(shape: Surface, position: Vector3, radius: float) -> Surface:
    """The facets of a surface that come within a radius in m of a position (3,) in m."""
    away = np.linalg.norm(nearest_points(shape.vertices[shape.facets], position) - position, axis=1)
    chosen = shape.facets[away <= radius]
    used, numbers = np.unique(chosen, return_inverse=True)
    return Surface(shape.vertices[used], numbers.reshape(-1, 3), shape.name)


def make_contact_plant(
    surface: Surface,
    field: Field,
    spin: Spin,
    craft: TouchCraft,
    ground: Ground | None = None,
    step: float = 0.01,
) -> Diagram:
    """The diagram of a spacecraft in contact; `place_craft` sets its state.

    ```
    force (3), N, S ────►┌──────────────┐─► state (6), m and m/s: p_KS, v_KS
    torque (3), N m, S ─►│              │─► attitude (4): R_KS, w, x, y, z
                         │ ContactPlant │─► angular_velocity (3), rad/s: w_NS, S
                         │              │─► arm (2), m and m/s: how far it is pressed in
                         │              │─► contact_force (3), N, K: of the ground on the head
                         └──────────────┘─► parts_force (n), N: of the ground on each part
    ```

    The ports are those of `RigidSpacecraft`, with `contact_force` and `arm` besides. Force and
    torque act in the bus's S and may be left open. The mass stays as it is, wheels are part of the
    inertia, and gravity acts in the bodies' centres of mass, without its gradient's torque.

    Args:
      surface: the ground near the place, in K. A patch of a map is enough, and quicker.
      field: gravity. spin: of the body; a number is in rad/s about z.
      craft: the spacecraft. ground: None: the defaults.
      step: in s.

    Raises:
      InputError: the arm's spring is too hard for the step.
    """
    check_positive("make_contact_plant", step=step, mass=craft.mass - craft.arm.head_mass)
    ground, arm = ground or Ground(), craft.arm
    if arm.stiffness * step**2 > arm.head_mass:
        raise InputError(
            f"the arm's spring, {arm.stiffness:g} N/m, is too hard for a head of "
            f"{arm.head_mass:g} kg in steps of {step:g} s: Drake adds its force explicitly"
        )
    builder = DiagramBuilder()
    plant, graph = AddMultibodyPlantSceneGraph(builder, step)
    plant.set_contact_model(ContactModel.kHydroelastic)
    plant.set_discrete_contact_approximation(DiscreteContactApproximation.kLagged)
    plant.mutable_gravity_field().set_gravity_vector(np.zeros(3))
    _add_ground(plant, surface, ground)
    bus, head = _add_craft(plant, craft, ground)
    plant.Finalize()
    forces = builder.AddNamedSystem("forces", _FrameForces(bus, head, field, spin))
    readings = builder.AddNamedSystem("readings", _Readings(plant, graph, bus, spin, craft))
    for reader in (forces, readings):
        builder.Connect(plant.get_body_poses_output_port(), reader.GetInputPort("poses"))
        builder.Connect(
            plant.get_body_spatial_velocities_output_port(), reader.GetInputPort("velocities")
        )
    builder.Connect(plant.get_contact_results_output_port(), readings.GetInputPort("contact"))
    builder.Connect(plant.get_state_output_port(), readings.GetInputPort("plant_state"))
    builder.Connect(
        forces.GetOutputPort("spatial_forces"), plant.get_applied_spatial_force_input_port()
    )
    for name in ("force", "torque"):
        builder.ExportInput(forces.GetInputPort(name), name)
    for k in range(readings.num_output_ports()):
        port = readings.get_output_port(k)
        builder.ExportOutput(port, port.get_name())
    diagram = builder.Build()
    diagram.set_name("ContactPlant")
    return diagram


def place_craft(
    diagram: Diagram,
    context: Context,
    state: State,
    attitude: Quaternion | np.ndarray,
    angular_velocity: Vector3,
    spin: Spin,
) -> None:
    """Sets the spacecraft's state in a contact plant's context; its arm is at rest.

    Args:
      diagram: of `make_contact_plant`. context: of it.
      state: p_KS and v_KS (6,) in m and m/s. attitude: R_KS (w, x, y, z).
      angular_velocity: w_NS (3,) in rad/s in S. spin: of the body.
    """
    plant: MultibodyPlant = diagram.GetSubsystemByName("plant")
    inside = plant.GetMyMutableContextFromRoot(context)
    bus = plant.GetBodyByName("bus")
    turn = RotationMatrix(rotation_matrix(tuple(attitude)))
    rate = spin_model(spin).angular_velocity(context.get_time())
    plant.SetFreeBodyPose(inside, bus, RigidTransform(turn, state[:3]))
    plant.SetFreeBodySpatialVelocity(
        inside, bus, SpatialVelocity(turn @ angular_velocity - rate, state[3:])
    )
    joint = plant.GetJointByName("arm")
    joint.set_translation(inside, 0.0)
    joint.set_translation_rate(inside, 0.0)


def contact_energy(diagram: Diagram, context: Context) -> float:
    """Kinetic energy over the ground, and that of the arm's spring, of a contact plant in J."""
    plant = diagram.GetSubsystemByName("plant")
    inside = plant.GetMyContextFromRoot(context)
    return plant.EvalKineticEnergy(inside) + plant.EvalPotentialEnergy(inside)


def _material(ground: Ground) -> ProximityProperties:
    properties = ProximityProperties()
    friction = CoulombFriction(ground.friction, ground.friction)
    AddContactMaterial(dissipation=ground.dissipation_s_m, friction=friction, properties=properties)
    return properties


def _add_ground(plant: MultibodyPlant, surface: Surface, ground: Ground) -> None:
    text = io.StringIO()
    for x, y, z in surface.vertices.tolist():
        text.write(f"v {x!r} {y!r} {z!r}\n")
    for a, b, c in (surface.facets + 1).tolist():
        text.write(f"f {a} {b} {c}\n")
    mesh = Mesh(InMemoryMesh(mesh_file=MemoryFile(text.getvalue(), ".obj", "ground.obj")))
    properties = _material(ground)
    AddRigidHydroelasticProperties(properties)
    world = plant.world_body()
    plant.RegisterCollisionGeometry(world, RigidTransform(), mesh, "ground", properties)


def _add_craft(
    plant: MultibodyPlant, craft: TouchCraft, ground: Ground
) -> tuple[RigidBody, RigidBody]:
    """Adds bus and head; the bus has what of mass and inertia the head has not."""
    arm, rest = craft.arm, inertia_without_head(craft)
    place = np.array(arm.place, dtype=float)
    ball = UnitInertia.SolidSphere(arm.head_radius)
    mass = craft.mass - arm.head_mass
    unit = UnitInertia(
        RotationalInertia(rest[0, 0], rest[1, 1], rest[2, 2], rest[0, 1], rest[0, 2], rest[1, 2])
        / mass
    )
    inertia = SpatialInertia(mass, -arm.head_mass / mass * place, unit)
    bus = plant.AddRigidBody("bus", inertia)
    head = plant.AddRigidBody("head", SpatialInertia(arm.head_mass, np.zeros(3), ball))
    joint = plant.AddJoint(
        PrismaticJoint(
            "arm",
            plant.AddFrame(FixedOffsetFrame("arm_root", bus.body_frame(), RigidTransform(place))),
            head.body_frame(),
            -np.array(arm.direction, dtype=float),
            damping=arm.damping,
        )
    )
    plant.AddForceElement(PrismaticSpring(joint, 0.0, arm.stiffness))
    _register(plant, head, "head", Sphere(arm.head_radius), np.zeros(3), ground)
    for name, (middle, edges) in craft.parts.items():
        _register(plant, bus, name, Box(*edges), np.array(middle), ground)
    return bus, head


def _register(
    plant: MultibodyPlant, body: RigidBody, name: str, shape: Shape, place: Vector3, ground: Ground
) -> None:
    properties = _material(ground)
    # Drake makes polyhedra of balls: 0.3 % within them at this resolution. Of boxes it needs none.
    size = _RESOLUTION * shape.radius() if isinstance(shape, Sphere) else 1.0
    AddCompliantHydroelasticProperties(size, ground.modulus_pa, properties)
    plant.RegisterCollisionGeometry(body, RigidTransform(place), shape, name, properties)


class _Loaded(NamedTuple):
    """A body that forces act on."""

    number: int
    body: RigidBody
    mass: float
    """kg."""
    centre: Vector3
    """(3,) of its centre of mass in m, along its own axes."""
    inertia: Matrix3
    """(3, 3) in kg m^2 about it."""


class _FrameForces(LeafSystem):
    """The forces on bus and head: gravity, those of the turning frame, and the thrusters'.

    ```
    poses, velocities of the plant ─►┌─────────────┐
    force (3), N, S ────────────────►│ FrameForces ├─► spatial_forces
    torque (3), N m, S ─────────────►└─────────────┘
    ```
    """

    def __init__(self, bus: RigidBody, head: RigidBody, field: Field, spin: Spin):
        super().__init__()
        self._field, self._spin = field, spin_model(spin)
        self._bodies = []
        for body in (bus, head):
            inertia = body.default_spatial_inertia()
            centre = np.array(inertia.get_com())
            central = inertia.Shift(centre).CalcRotationalInertia().CopyToFullMatrix3()
            self._bodies.append(
                _Loaded(int(body.index()), body, inertia.get_mass(), centre, central)
            )
        inputs = [
            self.DeclareAbstractInputPort("poses", AbstractValue.Make([RigidTransform()])),
            self.DeclareAbstractInputPort("velocities", AbstractValue.Make([SpatialVelocity()])),
            self.DeclareVectorInputPort("force", 3),
            self.DeclareVectorInputPort("torque", 3),
        ]
        self.DeclareAbstractOutputPort(
            "spatial_forces",
            lambda: AbstractValue.Make([ExternallyAppliedSpatialForce()]),
            self._calc,
            {port.ticket() for port in inputs} | {self.time_ticket()},
        )

    def _calc(self, context, output):
        poses, velocities = (self.get_input_port(k).Eval(context) for k in range(2))
        time = context.get_time()
        spin, change = self._spin.angular_velocity(time), self._spin.angular_acceleration(time)
        turns = [poses[body.number].rotation().matrix() for body in self._bodies]
        arms = [turn @ body.centre for turn, body in zip(turns, self._bodies, strict=True)]
        places = np.array(
            [
                poses[body.number].translation() + arm
                for body, arm in zip(self._bodies, arms, strict=True)
            ]
        )
        pulls = self._field.evaluate(places).acceleration
        applied = []
        for body, turn, arm, place, pull in zip(
            self._bodies, turns, arms, places, pulls, strict=True
        ):
            motion = velocities[body.number]
            rate = motion.rotational()
            velocity = motion.translational() + cross_matrix(rate) @ arm
            inertia = turn @ body.inertia @ turn.T
            moment, push = frame_wrench(body.mass, inertia, place, velocity, rate, spin, change)
            force = SpatialForce(moment, push + body.mass * pull)
            applied.append(_applied(body.body, body.centre, force))
        thrust, torque = (
            port.Eval(context) if port.HasValue(context) else np.zeros(3)
            for port in (self.get_input_port(2), self.get_input_port(3))
        )
        given = SpatialForce(turns[0] @ torque, turns[0] @ thrust)
        output.set_value([*applied, _applied(self._bodies[0].body, np.zeros(3), given)])


@kernel
def frame_wrench(
    mass: float,
    inertia: Matrix3,
    position: Vector3,
    velocity: Vector3,
    rate: Vector3,
    spin: Vector3,
    change: Vector3,
) -> tuple[Vector3, Vector3]:
    """Torque (3,) and force (3,) on a rigid body about its centre of mass in a frame that turns.

    With W the frame's angular velocity and w the body's in it, H = J (w + W) and dH/dt = T in N
    give J w' + w x J w = T - W x J (w + W) - w x J W + J (w x W) - J W'.

    Args:
      mass: kg. inertia: J (3, 3) in kg m^2, about the centre of mass.
      position, velocity: (3,) of the centre of mass in m and m/s. rate: w (3,) in rad/s.
      spin, change: W (3,) in rad/s and its derivative in rad/s^2. All in the frame's axes.
    """
    force = -mass * (
        2.0 * np.cross(spin, velocity)
        + np.cross(spin, np.cross(spin, position))
        + np.cross(change, position)
    )
    torque = (
        -np.cross(spin, inertia @ (rate + spin))
        - np.cross(rate, inertia @ spin)
        + inertia @ (np.cross(rate, spin) - change)
    )
    return torque, force


def _applied(body: RigidBody, place: Vector3, force: SpatialForce) -> ExternallyAppliedSpatialForce:
    applied = ExternallyAppliedSpatialForce()
    applied.body_index, applied.p_BoBq_B, applied.F_Bq_W = body.index(), place, force
    return applied


class _Readings(LeafSystem):
    """Turns what the plant puts out into the ports of `make_contact_plant`."""

    def __init__(self, plant, graph: SceneGraph, bus, spin: Spin, craft: TouchCraft):
        super().__init__()
        self._bus, self._spin, self._parts = int(bus.index()), spin_model(spin), list(craft.parts)
        inspector = graph.model_inspector()
        self._names = {
            int(identity.get_value()): inspector.GetName(identity).rpartition("::")[2]
            for identity in inspector.GetAllGeometryIds()
        }
        joint = plant.GetJointByName("arm")
        self._arm = [joint.position_start(), plant.num_positions() + joint.velocity_start()]
        declare = self.DeclareAbstractInputPort
        self._poses = declare("poses", AbstractValue.Make([RigidTransform()]))
        self._velocities = declare("velocities", AbstractValue.Make([SpatialVelocity()]))
        results = plant.get_contact_results_output_port().Allocate()
        self._contact = declare("contact", results)
        self._state = self.DeclareVectorInputPort(
            "plant_state", plant.num_positions() + plant.num_velocities()
        )
        moved = {self._poses.ticket(), self._velocities.ticket()}
        output = self.DeclareVectorOutputPort
        output("state", 6, self._calc_state, moved)
        output("attitude", 4, self._calc_attitude, moved)
        output("angular_velocity", 3, self._calc_rate, moved | {self.time_ticket()})
        output(
            "arm",
            2,
            lambda context, out: out.SetFromVector(self._state.Eval(context)[self._arm]),
            {self._state.ticket()},
        )
        contact = {self._contact.ticket()}
        output(
            "contact_force",
            3,
            lambda context, out: out.SetFromVector(self._on(context).get("head", np.zeros(3))),
            contact,
        )
        if self._parts:
            output("parts_force", len(self._parts), self._calc_parts, contact)

    def _calc_state(self, context, output):
        place = self._poses.Eval(context)[self._bus].translation()
        velocity = self._velocities.Eval(context)[self._bus].translational()
        output.SetFromVector(np.concatenate([place, velocity]))

    def _calc_attitude(self, context, output):
        output.SetFromVector(self._poses.Eval(context)[self._bus].rotation().ToQuaternion().wxyz())

    def _calc_rate(self, context, output):
        turn = self._poses.Eval(context)[self._bus].rotation().matrix()
        rate = self._velocities.Eval(context)[self._bus].rotational()
        output.SetFromVector(turn.T @ (rate + self._spin.angular_velocity(context.get_time())))

    def _calc_parts(self, context, output):
        found = self._on(context)
        output.SetFromVector([np.linalg.norm(found.get(n, np.zeros(3))) for n in self._parts])

    def _on(self, context) -> dict[str, Vector3]:
        """The force (3,) of the ground on each geometry that it touches, in N in K."""
        results, found = self._contact.Eval(context), {}
        for k in range(results.num_hydroelastic_contacts()):
            info = results.hydroelastic_contact_info(k)
            # A is the body of geometry M.
            force = info.F_Ac_W().translational()
            first, second = (
                self._names[int(identity.get_value())]
                for identity in (info.contact_surface().id_M(), info.contact_surface().id_N())
            )
            name, force = (second, -force) if first == "ground" else (first, force)
            found[name] = found.get(name, np.zeros(3)) + force
        return found
