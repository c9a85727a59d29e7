"""Compares gravity, the lidar, motion and Kleopatra's field with other packages.

- `gravity`: against ESA's polyhedral-gravity, outside the body and inside it;
- `lidar`: against trimesh, by its own rays and by Embree;
- `field`: the second-degree harmonics of Kleopatra's field, fitted far outside, against the moments
  of its volume, and its equilibria against published ones;
- `motion`: 24 hours about bodies by proxops, by Basilisk, and by an integration of its own;
- `sunlight`: 24 hours in sunlight at Bennu, and light on facets, by proxops and by Basilisk;
- `attitude`: an hour of a rigid spacecraft with wheels and thrusters, by proxops and by Basilisk.

For `motion`, free and under a force that changes at random every ten minutes, from a circular orbit
as wide as three half lengths of the body:

- ours: the transit diagram as `proxops fly` makes it, with exact gravity;
- reference: DOP853 at a tolerance of 1e-13 in the inertial frame, with ESA's polyhedral-gravity;
- Basilisk: its spacecraft, its polyhedral gravity and its Runge-Kutta steps, of 2 s.

Basilisk takes the volume of a mesh for the sum of the absolute volumes of its tetrahedra, which is
too large where a facet turns its back on the origin. So its gravity is too weak there; it flies
a second time with its `muBody` raised by the ratio of the volumes.

ESA's gravity and Basilisk come with the extra `bench`:

    python benchmarks/agreement.py [--only gravity lidar …] [--bodies kleopatra two-ellipsoids …]
        [--points 500] [--hours 24] [--step 2]
"""

import argparse
import dataclasses as dc
from pathlib import Path

import numpy as np
import trimesh
from _bodies import GENERATED, KLEOPATRA, scenario_at
from _peers import basilisk_model, esa_model
from _rigid_agreement import STEP, by_proxops, commands, rigid_by_basilisk
from _sunlight_agreement import day, day_by_basilisk, day_by_dop853, day_by_proxops, facets_apart
from _tables import Shown
from pydrake.systems.framework import LeafSystem
from rich.console import Console
from rich.progress import track
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from trimesh.ray.ray_pyembree import RayMeshIntersector as EmbreeRays
from trimesh.ray.ray_triangle import RayMeshIntersector as TrimeshRays

from proxops.diagrams.flight import fly
from proxops.diagrams.scenario import (
    Body,
    Scenario,
    TrueStateConfig,
    change_scenario,
    load_body,
    load_spacecraft,
)
from proxops.systems import GravityField, Polyhedron, ray_directions
from proxops.systems.common import generator
from proxops.systems.gravity import GRAVITATIONAL_CONSTANT, find_equilibria
from proxops.systems.shapes import ray_caster

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


# X. Wang, Y. Jiang, S. Gong, "Analysis of the potential field and equilibrium points of
# irregular-shaped minor celestial bodies", Astrophys. Space Sci. 353 (2014) 105: the radar model at
# 3,600 kg/m^3 and 5.385 h; E1 to E4, in km.
PUBLISHED = np.array(
    [
        [142.852, 2.441, 1.181],
        [-1.164, 100.740, -0.545],
        [-144.684, 5.188, -0.272],
        [2.230, -102.102, 0.271],
    ]
)
PUBLISHED_DENSITY, PUBLISHED_PERIOD = 3600.0, 5.385 * 3600.0
FRAMES = 20


def some_points(body: Body, count: int) -> dict[str, np.ndarray]:
    """Points (N, 3) in m outside the body, up to three half lengths from it, and inside it."""
    half = 0.5 * body.shape.extents.max()
    points = generator(2, 0).uniform(-3.0 * half, 3.0 * half, (40 * count, 3))
    near = generator(2, 1).uniform(-0.5, 0.5, (40 * count, 3)) * body.shape.extents
    inside = body.exact_field.evaluate(near).inside
    free = ~body.exact_field.evaluate(points[:count]).inside
    return {"outside": points[:count][free], "inside": near[inside][:count]}


def gravity_apart(body: Body, points: np.ndarray) -> list[float]:
    """Greatest differences of potential, acceleration and gradient, each over its size there."""
    model, ours = esa_model(body.exact_field), body.exact_field.evaluate(points)
    values = [model(point, False) for point in points]
    potential = np.array([value[0] for value in values])
    pull = np.array([value[1] for value in values])
    xx, yy, zz, xy, xz, yz = np.array([value[2] for value in values]).T
    gradient = np.stack([xx, xy, xz, xy, yy, yz, xz, yz, zz], axis=1)
    pairs = (
        (ours.potential[:, None], potential[:, None]),
        (ours.acceleration, pull),
        (ours.gradient.reshape(-1, 9), gradient),
    )
    apart = []
    for mine, theirs in pairs:
        size = np.linalg.norm(theirs, axis=1)
        # The other's sign may be the opposite one, but then of all of its values.
        same, opposite = (np.linalg.norm(mine - sign * theirs, axis=1) / size for sign in (1, -1))
        apart.append(float(min(same.max(), opposite.max())))
    return apart


def lidar_apart(body: Body) -> list[str]:
    """Rays on which another cast hits or misses alone, and the greatest difference of the rest."""
    directions, mesh, caster = ray_directions(), body.shape.to_trimesh(), ray_caster(body.shape)
    half = 0.5 * float(body.shape.extents.max())
    axes = generator(3, 0).normal(size=(FRAMES, 3))
    poses = 2.0 * half * axes / np.linalg.norm(axes, axis=1, keepdims=True)
    found: list[str] = []
    for kind in (TrimeshRays, EmbreeRays):
        peer, others, worst, hits = kind(mesh), 0, 0.0, 0
        for pose in poses:
            origins = np.broadcast_to(pose, directions.shape)
            mine = caster.distances(origins, directions)
            points, rays, _ = peer.intersects_location(origins, directions, multiple_hits=False)
            theirs = np.full(len(directions), np.inf)
            theirs[rays] = np.linalg.norm(points - pose, axis=1)
            both = np.isfinite(mine) & np.isfinite(theirs)
            others += int((np.isfinite(mine) ^ np.isfinite(theirs)).sum())
            worst = max(worst, float(np.abs(mine - theirs)[both].max(initial=0.0)))
            hits += int(both.sum())
        found += [f"{hits:,}", str(others), f"{worst / half:.1e}"]
    return [found[0], found[1], found[2], found[4], found[5]]


def second_moments(shape: Polyhedron) -> np.ndarray:
    """Means (3, 3) of x_i x_j over the volume, in m^2, from its tetrahedra to the origin."""
    corners = shape.vertices[shape.facets]
    volumes = np.linalg.det(corners) / 6.0
    sums = corners.sum(axis=1)
    products = np.einsum("n,ni,nj->ij", volumes, sums, sums)
    products += np.einsum("n,nki,nkj->ij", volumes, corners, corners)
    return products / 20.0 / volumes.sum()


def fitted_moments(field: GravityField) -> np.ndarray:
    """C20 and C22 times a squared length in m^2, from the potential on a far sphere.

    The potential times a harmonic is integrated over the sphere by Gauss and by the trapezium rule.
    """
    radius = 10.0 * float(field.shape.extents.max())
    heights, weights = np.polynomial.legendre.leggauss(24)
    angles = np.arange(48) * 2.0 * np.pi / 48
    z, angle = (grid.ravel() for grid in np.meshgrid(heights, angles, indexing="ij"))
    weight = np.repeat(weights, 48) / 48 / 2.0
    flat = np.sqrt(1.0 - z**2)
    points = radius * np.stack([flat * np.cos(angle), flat * np.sin(angle), z], axis=1)
    potential = field.evaluate(points).potential / (GRAVITATIONAL_CONSTANT * field.mass / radius)
    # Squares of these are 1/5 and 12/5 in the mean over the sphere.
    zonal, sectoral = 1.5 * z**2 - 0.5, 3.0 * flat**2 * np.cos(2.0 * angle)
    parts = [5.0 * np.sum(weight * potential * zonal)]
    parts.append(5.0 / 12.0 * np.sum(weight * potential * sectoral))
    return radius**2 * np.array(parts)


def kleopatra_rows() -> list[tuple[str, str]]:
    """Harmonics and equilibria of Kleopatra."""
    shape = load_body(KLEOPATRA).shape
    field = GravityField(shape, density=PUBLISHED_DENSITY)
    means, radius = second_moments(shape), np.cbrt(0.75 * shape.volume / np.pi)
    told = [means[2, 2] - 0.5 * (means[0, 0] + means[1, 1]), 0.25 * (means[0, 0] - means[1, 1])]
    fitted = fitted_moments(field)
    # Those to compare with are of the shape in its principal axes.
    turn = np.linalg.eigh(shape.to_trimesh().moment_inertia)[1]
    turn *= np.sign(np.diag(turn))
    principal = GravityField(
        Polyhedron(shape.vertices @ turn, shape.facets, shape.name), density=PUBLISHED_DENSITY
    )
    points = find_equilibria(principal, 2.0 * np.pi / PUBLISHED_PERIOD)
    outside = np.array([point.position for point in points if not point.inside])
    apart = np.linalg.norm(outside - 1e3 * PUBLISHED, axis=1)
    rows = [
        (f"{name}, reference radius {1e-3 * radius:.2f} km", f"{value / radius**2:.9f}")
        for name, value in zip(("C20", "C22"), fitted, strict=True)
    ]
    rows += [
        ("apart from the moments of the volume", f"{np.abs(fitted / told - 1.0).max():.1e}"),
        ("E1 to E4 from the published (m)", ", ".join(f"{value:.0f}" for value in apart)),
        (
            "published from the centre (km)",
            ", ".join(f"{np.linalg.norm(p):.0f}" for p in PUBLISHED),
        ),
    ]
    return rows


def gravity(arguments: argparse.Namespace) -> None:
    lines = {}
    for name in track(arguments.bodies, "gravity", console=Console(stderr=True)):
        body = load_body(scenario_at(name, arguments.out).body)
        for where, points in some_points(body, arguments.points).items():
            values = [f"{value:.1e}" for value in gravity_apart(body, points)]
            lines[f"{name}, {where}"] = [str(len(points)), *values]
    headings = "points", "potential", "acceleration", "gradient"
    Shown("greatest relative difference from ESA's gravity", headings, lines).show()


def lidar(arguments: argparse.Namespace) -> None:
    lines = {
        name: lidar_apart(load_body(scenario_at(name, arguments.out).body))
        for name in track(arguments.bodies, "lidar", console=Console(stderr=True))
    }
    headings = (
        "hits",
        "hit by one alone",
        "apart (of half length)",
        "alone, Embree",
        "apart, Embree",
    )
    Shown(f"{FRAMES} frames against trimesh", headings, lines).show()


def field(arguments: argparse.Namespace) -> None:
    for name, value in kleopatra_rows():
        Console().print(f"{name}: {value}")


def motion(arguments: argparse.Namespace) -> None:
    lines = {}
    for name in track(arguments.bodies, "motion", console=Console(stderr=True)):
        for share, kind in ((0.0, "free"), (0.005, "thrusted")):
            case = make_case(name, arguments.out, arguments.hours, share)
            right, factor = reference(case), absolute_volumes(case.body)
            found = [ours(case), by_basilisk(case, factor, arguments.step)]
            wrong = factor > 1.0 + 1e-9
            found.append(by_basilisk(case, 1.0, arguments.step) if wrong else found[1])
            apart = [np.linalg.norm(end - right) for end in found]
            way = np.linalg.norm(case.inertial_start[3:]) * case.duration
            lines[f"{name}, {kind}"] = [f"{1e-3 * way:.3g}", *(f"{value:.3g}" for value in apart)]
    headings = "path (km)", "ours", "Basilisk, volume mended", "Basilisk as it is"
    Shown(f"apart after {arguments.hours:g} h (m)", headings, lines).show()


def attitude(arguments: argparse.Namespace) -> None:
    model, lines = load_spacecraft("smallsat"), {}
    on, motors = commands(model, 3600)
    for kind, times in (("wheels", 0.0 * on), ("wheels and thrusters", on)):
        mine, theirs = by_proxops(model, times, motors), rigid_by_basilisk(model, times, motors)
        turned = (mine.attitude.inv() * theirs.attitude).magnitude()
        apart = [np.abs(mine[k] - theirs[k]).max() for k in (0, 2, 3)]
        lines[kind] = [f"{value:.1e}" for value in (apart[0], turned, *apart[1:])]
    headings = "position (m)", "attitude (rad)", "rates (rad/s)", "wheels (N m s)"
    Shown(f"apart after 1 h, in steps of {STEP:g} s", headings, lines).show()


def sunlight(arguments: argparse.Namespace) -> None:
    hours = arguments.hours
    scenario = day(hours)
    right, without = (day_by_dop853(scenario, hours, light) for light in (1.0, 0.0))
    ours, theirs = day_by_proxops(scenario), day_by_basilisk(scenario, hours, arguments.step)
    lines = {
        "moved by the Sun": [f"{np.linalg.norm(right - without):.3g}"],
        "ours from the reference": [f"{np.linalg.norm(ours - right):.2g}"],
        "ours from Basilisk": [f"{np.linalg.norm(ours - theirs):.2g}"],
    }
    Shown(f"at Bennu after {hours:g} h", ("m",), lines).show()
    lines = {
        name: [f"{value:.1e}" for value in facets_apart(name)] for name in ("hayabusa2", "smallsat")
    }
    Shown("light on facets, from Basilisk's over the force", ("force", "torque (m)"), lines).show()


SECTIONS = {each.__name__: each for each in (gravity, lidar, field, motion, sunlight, attitude)}


def main() -> None:
    """Prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="+", choices=SECTIONS, default=list(SECTIONS))
    parser.add_argument("--bodies", nargs="+", default=[KLEOPATRA, *GENERATED], metavar="BODY")
    parser.add_argument("--points", type=int, default=500)
    parser.add_argument("--hours", type=float, default=24.0)
    parser.add_argument("--step", type=float, default=2.0, help="of Basilisk, in s")
    parser.add_argument("--out", type=Path, default=Path("out/agreement"), help="for the bodies")
    arguments = parser.parse_args()
    for section in arguments.only:
        SECTIONS[section](arguments)


if __name__ == "__main__":
    trimesh.util.log.disabled = True
    main()
