"""Flies 24 hours about bodies by proxops, by Basilisk, and by an integration of its own.

Free motion, and motion under a force that changes at random every ten minutes, each from a circular
orbit as wide as three half lengths of the body:

- ours: the transit diagram as `proxops fly` makes it, with exact gravity;
- reference: DOP853 at a tolerance of 1e-13 in the inertial frame, with ESA's polyhedral-gravity;
- Basilisk: its spacecraft, its polyhedral gravity and its Runge-Kutta steps, of 2 s.

Basilisk takes the volume of a mesh for the sum of the absolute volumes of its tetrahedra, which is
too large where a facet turns its back on the origin. So its gravity is too weak there; it flies
a second time with its `muBody` raised by the ratio of the volumes.

Both peers come with the extra `bench`:

    python benchmarks/agreement.py [--bodies kleopatra two-ellipsoids …] [--hours 24] [--step 2]
"""

import argparse
import dataclasses as dc
from pathlib import Path

import numpy as np
from _bodies import GENERATED, KLEOPATRA, scenario_at
from _peers import basilisk_model, esa_model
from pydrake.systems.framework import LeafSystem
from rich.console import Console
from rich.progress import track
from rich.table import Table
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from proxops.diagrams.flight import fly
from proxops.diagrams.scenario import Body, Scenario, TrueStateConfig, change_scenario, load_body
from proxops.systems.common import generator
from proxops.systems.gravity import GRAVITATIONAL_CONSTANT

HELD = 60
"""Control steps for which a force is held."""


class Given(LeafSystem):
    """A controller that knows its forces (N, 3) beforehand, each for `HELD` control steps."""

    def __init__(self, forces: np.ndarray, period: float):
        super().__init__()
        self.DeclareVectorInputPort("target", 6)

        def calc(context, output):
            step = round(context.get_time() / period)
            output.SetFromVector(forces[min(step // HELD, len(forces) - 1)])

        self.DeclareVectorOutputPort("force", 3, calc, prerequisites_of_calc={self.time_ticket()})


@dc.dataclass(frozen=True)
class Case:
    """A flight to be flown by all."""

    body: Body
    scenario: Scenario
    start: np.ndarray
    """(6,) in m and m/s in K."""
    forces: np.ndarray
    """(N, 3) in N in K."""
    duration: float

    @property
    def spin(self) -> np.ndarray:
        """Angular velocity (3,) in rad/s."""
        return np.array([0.0, 0.0, self.body.spin_rate])

    @property
    def inertial_start(self) -> np.ndarray:
        """(6,) in the inertial frame that is K at time 0."""
        position, velocity = self.start[:3], self.start[3:]
        return np.concatenate([position, velocity + np.cross(self.spin, position)])

    def turned(self, time: float) -> np.ndarray:
        """R_NK (3, 3) at a time in s."""
        return Rotation.from_rotvec(time * self.spin).as_matrix()

    def force(self, time: float) -> np.ndarray:
        """The force (3,) in N in K that is held from a time in s on."""
        step = HELD * self.scenario.control_period_s
        return self.forces[min(int((time + 1e-6) // step), len(self.forces) - 1)]


def make_case(name: str, folder: Path, hours: float, share: float) -> Case:
    """A circular orbit about a body, with forces up to a share of the thrust limit."""
    scenario = dc.replace(scenario_at(name, folder), navigation=TrueStateConfig())
    body = load_body(scenario.body)
    field, size = body.exact_field, float(body.shape.extents.max())
    radius = 1.5 * size
    pull = field.evaluate(np.array([[radius, 0.0, 0.0]])).acceleration[0]
    # Inclined by 30 degrees.
    speed = np.sqrt(radius * np.linalg.norm(pull))
    inertial = speed * np.array([0.0, np.cos(np.pi / 6.0), np.sin(np.pi / 6.0)])
    position = np.array([radius, 0.0, 0.0])
    velocity = inertial - np.cross([0.0, 0.0, body.spin_rate], position)
    period, duration = scenario.control_period_s, 3600.0 * hours
    count = int(np.ceil(duration / (HELD * period)))
    limit = share * scenario.spacecraft.thrust_limit_n
    forces = limit * generator(1, 0).uniform(-1.0, 1.0, (count, 3))
    dwell = min(scenario.arrival.dwell_s, 0.5 * duration)
    told = {
        "transit.start_m": position.tolist(),
        "transit.goal_m": (-1.2 * position).tolist(),
        "transit.start_velocity_m_s": velocity.tolist(),
        # Seen in K, an orbit so wide is faster than a transit.
        "spacecraft.speed_limit_m_s": 10.0 * float(np.linalg.norm(velocity)),
        "arrival.deadline_s": duration - dwell,
        "arrival.dwell_s": dwell,
    }
    scenario = change_scenario(scenario, told)
    return Case(body, scenario, np.concatenate([position, velocity]), forces, duration)


def ours(case: Case) -> np.ndarray:
    """Position (3,) in m at the end, in the inertial frame."""
    log = fly(case.scenario, Given(case.forces, case.scenario.control_period_s), body=case.body)
    data = log.dataset
    assert abs(float(data["time"][-1]) - case.duration) < 1e-6
    return data["position_inertial"].values[-1]


def reference(case: Case) -> np.ndarray:
    """The same by DOP853 and ESA's gravity."""
    gravity, mass = esa_model(case.body.exact_field), case.scenario.spacecraft.mass_kg

    def rates(time: float, y: np.ndarray, force: np.ndarray) -> np.ndarray:
        turn = case.turned(time)
        pull = np.array(gravity(turn.T @ y[:3], False)[1])
        return np.concatenate([y[3:], turn @ (pull + force / mass)])

    step, state = HELD * case.scenario.control_period_s, case.inertial_start
    for begin in np.arange(0.0, case.duration, step):
        end, force = min(begin + step, case.duration), case.force(begin)
        scale = np.repeat([np.linalg.norm(state[:3]), np.linalg.norm(state[3:])], 3)
        found = solve_ivp(
            rates, (begin, end), state, "DOP853", rtol=1e-13, atol=1e-13 * scale, args=(force,)
        )
        state = found.y[:, -1]
    return state[:3]


def by_basilisk(case: Case, factor: float, seconds: float) -> np.ndarray:
    """The same by Basilisk in steps of some seconds, with its `muBody` times a factor."""
    from Basilisk.architecture import messaging, sysModel
    from Basilisk.simulation import extForceTorque, gravityEffector, spacecraft
    from Basilisk.utilities import SimulationBaseClass, macros

    class World(sysModel.SysModel):
        """Turns the body, and the force with it."""

        def __init__(self):
            super().__init__()
            self.message = messaging.SpicePlanetStateMsg()
            self.thrust = messaging.CmdForceInertialMsg()

        def UpdateState(self, now):  # noqa: N802
            time = now * macros.NANO2SEC
            turn = case.turned(time)
            state = messaging.SpicePlanetStateMsgPayload()
            state.J20002Pfix = turn.T.tolist()
            state.J20002Pfix_dot = (-cross(case.spin) @ turn.T).tolist()
            state.PositionVector = state.VelocityVector = [0.0, 0.0, 0.0]
            state.computeOrient = 1
            self.message.write(state, now, self.moduleID)
            force = messaging.CmdForceInertialMsgPayload()
            # The spacecraft's step ends now.
            middle = case.turned(time - 0.5 * seconds)
            force.forceRequestInertial = (middle @ case.force(time - seconds)).tolist()
            self.thrust.write(force, now, self.moduleID)

    simulation = SimulationBaseClass.SimBaseClass()
    step = macros.sec2nano(seconds)
    simulation.CreateNewProcess("process").addTask(simulation.CreateNewTask("task", step))
    world, craft = World(), spacecraft.Spacecraft()
    planet = gravityEffector.GravBodyData()
    planet.planetName, planet.isCentralBody = "body", True
    model = basilisk_model(case.body.exact_field)
    mu = factor * GRAVITATIONAL_CONSTANT * case.body.exact_field.mass
    model.muBody = planet.mu = mu
    planet.gravityModel = model
    planet.planetBodyInMsg.subscribeTo(world.message)
    craft.gravField.gravBodies = spacecraft.GravBodyVector([planet])
    craft.hub.mHub = case.scenario.spacecraft.mass_kg
    push = extForceTorque.ExtForceTorque()
    push.cmdForceInertialInMsg.subscribeTo(world.thrust)
    craft.addDynamicEffector(push)
    craft.hub.r_CN_NInit = case.inertial_start[:3].reshape(3, 1).tolist()
    craft.hub.v_CN_NInit = case.inertial_start[3:].reshape(3, 1).tolist()
    for number, part in enumerate((world, push, craft)):
        simulation.AddModelToTask("task", part, 100 - number)
    simulation.InitializeSimulation()
    simulation.ConfigureStopTime(macros.sec2nano(case.duration))
    simulation.ExecuteSimulation()
    return np.array(craft.scStateOutMsg.read().r_BN_N)


def cross(v: np.ndarray) -> np.ndarray:
    """The matrix W (3, 3) for which W u is v x u."""
    return np.cross(v, np.eye(3)).T


def absolute_volumes(body: Body) -> float:
    """The sum of the absolute volumes of the tetrahedra from the origin, over the true volume."""
    corners = body.shape.vertices[body.shape.facets]
    volumes = np.abs(np.linalg.det(corners)) / 6.0
    return float(volumes.sum() / body.shape.volume)


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--bodies", nargs="+", default=[KLEOPATRA, *GENERATED], metavar="BODY")
    parser.add_argument("--hours", type=float, default=24.0)
    parser.add_argument("--step", type=float, default=2.0, help="of Basilisk, in s")
    parser.add_argument("--out", type=Path, default=Path("out/agreement"), help="for the bodies")
    arguments = parser.parse_args()
    table = Table(title=f"apart after {arguments.hours:g} h (m)")
    for heading in ("", "path (km)", "ours", "Basilisk, volume mended", "Basilisk as it is"):
        table.add_column(heading, justify="left" if not heading else "right")
    for name in track(arguments.bodies, "flying", console=Console(stderr=True)):
        for share, motion in ((0.0, "free"), (0.005, "thrusted")):
            case = make_case(name, arguments.out, arguments.hours, share)
            right, factor = reference(case), absolute_volumes(case.body)
            found = [ours(case), by_basilisk(case, factor, arguments.step)]
            wrong = factor > 1.0 + 1e-9
            found.append(by_basilisk(case, 1.0, arguments.step) if wrong else found[1])
            apart = [np.linalg.norm(end - right) for end in found]
            way = np.linalg.norm(case.inertial_start[3:]) * case.duration
            cells = [f"{1e-3 * way:.3g}", *(f"{value:.3g}" for value in apart)]
            table.add_row(f"{name}, {motion}", *cells)
    Console().print(table)


if __name__ == "__main__":
    main()
