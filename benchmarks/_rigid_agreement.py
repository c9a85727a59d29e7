"""The same hour of a rigid spacecraft by proxops and by Basilisk, on the same commands.

| | proxops | Basilisk |
|---|---|---|
| attitude | R_KS, a quaternion, from S to K | MRP sigma_BN; [BN] turns from N to B = S |
| angular velocity | w_NS, along S | omega_BN_B, the same |
| wheel | momentum h = Js (a . w + Omega), with the bus | speed Omega against the bus |
| torque of a motor | on the wheel | on the wheel; the bus gets the opposite |
| inertia | of all, with the wheels | `IHubPntBc_B`: of all, with balanced wheels |
"""

from typing import NamedTuple

import numpy as np
from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import TrajectorySource, ZeroOrderHold
from pydrake.trajectories import PiecewisePolynomial
from scipy.spatial.transform import Rotation

from proxops.diagrams.scenario import SpacecraftModel
from proxops.systems import PolyhedralGravity, RigidSpacecraft
from proxops.systems.attitude import ThrusterCluster, ThrusterLayout, WheelArray
from proxops.systems.common import generator
from proxops.systems.gravity import GRAVITATIONAL_CONSTANT, PointMassField
from proxops.systems.vehicle import RigidBodyStart

MASS, SPIN = 2.97e18, np.array([0.0, 0.0, 3.24e-4])
"""Of the body, in kg and rad/s: a point mass, since Basilisk's gravity gradient is of one."""
START = np.array([150e3, 0.0, 20e3]), np.array([0.0, 12.0, 3.0])
RATE = np.array([1e-3, -2e-3, 3e-3])
PERIOD, STEP = 1.0, 0.1
"""Of commands and of both integrations, in s."""


class End(NamedTuple):
    """Where the spacecraft is at the end."""

    position: np.ndarray
    """(3,) in m in N."""
    attitude: Rotation
    """R_NS."""
    rate: np.ndarray
    """w_NS (3,) in rad/s in S."""
    wheels: np.ndarray
    """(m,) momenta in N m s."""


def commands(model: SpacecraftModel, seconds: int) -> tuple[np.ndarray, np.ndarray]:
    """On-times (N, n) in s, whole periods, and torques (N, m) in N m, of each period.

    The two thrusters of a face push together, or one after the other; so do the motors of wheels,
    one way and the other: rates stay small.
    """
    assert model.wheels is not None
    draw, count = generator(7, 0), seconds // 2
    on = np.zeros((count, 2, model.thrusters.count // 2, 2))
    both = draw.random((count, 1, model.thrusters.count // 2, 1)) < 0.05
    on[:] = both
    for k, face in np.argwhere(draw.random((count, model.thrusters.count // 2)) < 0.01):
        on[k, :, face] = np.eye(2)
    motors = draw.uniform(-0.02, 0.02, (count, len(model.wheels.axes)))
    return PERIOD * on.reshape(seconds, -1), np.stack([motors, -motors], 1).reshape(seconds, -1)


def by_proxops(model: SpacecraftModel, on: np.ndarray, motors: np.ndarray) -> End:
    """The end by the spacecraft of proxops, in steps of Runge-Kutta of fifth order."""
    assert model.wheels is not None
    builder, times = DiagramBuilder(), np.arange(len(on) + 1) * PERIOD
    start = RigidBodyStart(np.concatenate(START), (1.0, 0.0, 0.0, 0.0), tuple(RATE))
    wheels = model.wheels
    craft = builder.AddSystem(
        RigidSpacecraft(
            model.mass, model.inertia, SPIN, start, np.zeros(3), wheels.axes, wheels.inertia
        )
    )
    gravity = builder.AddSystem(PolyhedralGravity(PointMassField(MASS)))
    builder.Connect(craft.GetOutputPort("position"), gravity.get_input_port())
    for name, port in (("acceleration", "gravity"), ("gradient", "gravity_gradient")):
        builder.Connect(gravity.GetOutputPort(name), craft.GetInputPort(port))
    # Basilisk's mass does not fall here: there is no tank.
    cluster = builder.AddSystem(ThrusterCluster(model.thrusters, PERIOD, 1e30))
    for name in ("force", "torque", "mass_flow"):
        builder.Connect(cluster.GetOutputPort(name), craft.GetInputPort(name))
    for values, port in (
        (on, cluster.get_input_port()),
        (motors, craft.GetInputPort("wheel_torque")),
    ):
        path = PiecewisePolynomial.ZeroOrderHold(times, np.vstack([values, values[-1:]]).T)
        source = builder.AddSystem(TrajectorySource(path))
        hold = builder.AddSystem(ZeroOrderHold(PERIOD, values.shape[1]))
        builder.Connect(source.get_output_port(), hold.get_input_port())
        builder.Connect(hold.get_output_port(), port)
    simulator = Simulator(builder.Build())
    ResetIntegratorFromFlags(simulator, "runge_kutta5", STEP).set_fixed_step_mode(True)
    simulator.AdvanceTo(times[-1])
    end = simulator.get_system().GetMyContextFromRoot(simulator.get_context())
    own = craft.GetMyContextFromRoot(end)
    turn = Rotation.from_rotvec(times[-1] * SPIN)
    attitude = Rotation.from_quat(craft.GetOutputPort("attitude").Eval(own), scalar_first=True)
    return End(
        turn.apply(craft.GetOutputPort("position").Eval(own)),
        turn * attitude,
        craft.GetOutputPort("angular_velocity").Eval(own),
        craft.GetOutputPort("wheel_momentum").Eval(own),
    )


def rigid_by_basilisk(model: SpacecraftModel, on: np.ndarray, motors: np.ndarray) -> End:
    """The same by Basilisk, in steps of Runge-Kutta's fourth order."""
    from Basilisk.utilities import SimulationBaseClass, macros

    assert model.wheels is not None
    simulation = SimulationBaseClass.SimBaseClass()
    step = macros.sec2nano(STEP)
    simulation.CreateNewProcess("process").addTask(simulation.CreateNewTask("motion", step))
    craft, gradient = _hub(model)
    wheels, thrusters = _wheels(model.wheels, craft), _thrusters(model.thrusters, craft)
    given = _commands(on, motors)
    thrusters.cmdsInMsg.subscribeTo(given.on)
    wheels.rwMotorCmdInMsg.subscribeTo(given.motors)
    for number, part in enumerate((given, thrusters, wheels, craft, gradient)):
        simulation.AddModelToTask("motion", part, 100 - number)
    simulation.InitializeSimulation()
    simulation.ConfigureStopTime(macros.sec2nano(len(on) * PERIOD))
    simulation.ExecuteSimulation()
    end, axes = craft.scStateOutMsg.read(), model.wheels.axes
    rate = np.array(end.omega_BN_B)
    speeds = np.array(wheels.rwSpeedOutMsg.read().wheelSpeeds[: len(axes)])
    momenta = model.wheels.inertia * (axes @ rate + speeds)
    return End(np.array(end.r_CN_N), Rotation.from_mrp(end.sigma_BN), rate, momenta)


def _hub(model: SpacecraftModel):
    """Basilisk's spacecraft in the gravity of a point mass, and the torque of its gradient."""
    from Basilisk.simulation import GravityGradientEffector, gravityEffector, spacecraft

    craft = spacecraft.Spacecraft()
    craft.hub.mHub, craft.hub.IHubPntBc_B = model.mass, model.inertia.tolist()
    position, velocity = START
    craft.hub.r_CN_NInit = position.reshape(3, 1).tolist()
    craft.hub.v_CN_NInit = (velocity + np.cross(SPIN, position)).reshape(3, 1).tolist()
    craft.hub.omega_BN_BInit = RATE.reshape(3, 1).tolist()
    planet = gravityEffector.GravBodyData()
    planet.planetName, planet.isCentralBody = "body", True
    planet.mu = GRAVITATIONAL_CONSTANT * MASS
    craft.gravField.gravBodies = spacecraft.GravBodyVector([planet])
    gradient = GravityGradientEffector.GravityGradientEffector()
    gradient.addPlanetName("body")
    craft.addDynamicEffector(gradient)
    return craft, gradient


def _wheels(wheels: WheelArray, craft):
    """Balanced wheels without limits or friction."""
    from Basilisk.architecture import messaging
    from Basilisk.simulation import reactionWheelStateEffector
    from Basilisk.utilities import simIncludeRW

    factory = simIncludeRW.rwFactory()
    effector = reactionWheelStateEffector.ReactionWheelStateEffector()
    for axis in wheels.axes:
        factory.create(
            "custom", axis.tolist(), Js=wheels.inertia, Omega=0.0, u_max=1e3, maxMomentum=1e6,
            RWModel=messaging.BalancedWheels, useRWfriction=False, useMinTorque=False,
            useMaxTorque=False,
        )  # fmt: skip
    factory.addToSpacecraft("wheels", effector, craft)
    return effector


def _thrusters(layout: ThrusterLayout, craft):
    """Thrusters that are on or off at once."""
    from Basilisk.simulation import thrusterDynamicEffector
    from Basilisk.utilities import simIncludeThruster

    factory = simIncludeThruster.thrusterFactory()
    effector = thrusterDynamicEffector.ThrusterDynamicEffector()
    each = zip(layout.places, layout.directions, layout.forces, strict=True)
    for place, direction, force in each:
        factory.create("Blank_Thruster", place.tolist(), direction.tolist(), MaxThrust=float(force))
    factory.addToSpacecraft("thrusters", effector, craft)
    return effector


def _commands(on: np.ndarray, motors: np.ndarray):
    """A model of Basilisk that writes the commands of each period at its start."""
    from Basilisk.architecture import messaging, sysModel
    from Basilisk.utilities import macros

    class Commands(sysModel.SysModel):
        """Writes torques at each step, and on-times once a period."""

        def __init__(self):
            super().__init__()
            self.on, self.motors = messaging.THRArrayOnTimeCmdMsg(), messaging.ArrayMotorTorqueMsg()
            self.last = -1

        def UpdateState(self, now):  # noqa: N802
            # The spacecraft's step ends now.
            k = max(int((now * macros.NANO2SEC - 0.5 * STEP) / PERIOD), 0)
            torques = messaging.ArrayMotorTorqueMsgPayload()
            torques.motorTorque = motors[k].tolist()
            self.motors.write(torques, now, self.moduleID)
            if k == self.last:
                return
            self.last = k
            times = messaging.THRArrayOnTimeCmdMsgPayload()
            # A pulse ends with its period, also where the last step begins.
            times.OnTimeRequest = np.maximum(on[k] - 0.5 * STEP, 0.0).tolist()
            self.on.write(times, now, self.moduleID)

    return Commands()
