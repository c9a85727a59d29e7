"""The same day in sunlight at Bennu by proxops, by Basilisk, and by an integration of its own.

| | proxops | Basilisk | reference |
|---|---|---|---|
| gravity | its polyhedron's | its own | ESA's |
| light | `Sunlight`, a ball | `radiationPressure`, a cannonball | by hand |
| the Sun's tide | first term of a series | the Sun as a body that pulls both | both pulls |
| shadow | a ray at each control step | none: the orbit stays out of it | none |
| steps | Runge-Kutta, adaptive | Runge-Kutta, 2 s | DOP853 at 1e-13 |

The orbit is circular, over the terminator. Basilisk's irradiance at 1 au is ours for the
cannonball, as its force shows (2.12), and 1368 W/m^2 for facets.
"""

from __future__ import annotations

import numpy as np
from _peers import basilisk_model, esa_model
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from proxops.diagrams.flight import fly
from proxops.diagrams.scenario import Scenario, facets_of, load_body, load_scenario, load_spacecraft
from proxops.systems.common import spread_directions
from proxops.systems.gravity import GRAVITATIONAL_CONSTANT
from proxops.systems.vehicle import SunlightConfig, light_on_facets, light_pressure

RADIUS, AU, SUN, IRRADIANCE, LIGHT = 850.0, 149597870700.0, 1.3271244e20, 1361.0, 299792458.0
OF_THEIR_FACETS = 1368.0
SUNLIGHT = SunlightConfig(direction=[1.0, 0.0, 0.0], distance_au=0.9, area_m2=20.0)


def day(hours: float) -> Scenario:
    """A circular orbit over the terminator of Bennu, whose Sun stands along x of N."""
    body = load_body("bennu")
    speed = np.sqrt(GRAVITATIONAL_CONSTANT * body.config.mass_kg / RADIUS)
    start, duration = np.array([0.0, RADIUS, 0.0]), 3600.0 * hours
    velocity = np.array([0.0, 0.0, speed]) - np.cross([0.0, 0.0, body.spin_rate], start)
    told = {
        "navigation": "TrueState", "sunlight": SUNLIGHT, "spacecraft.speed_limit_m_s": 5.0,
        "transit.start_m": start.tolist(), "transit.goal_m": (-1.5 * start).tolist(),
        "transit.start_velocity_m_s": velocity.tolist(),
        "arrival.deadline_s": 0.5 * duration, "arrival.dwell_s": 0.5 * duration,
    }  # fmt: skip
    return load_scenario("bennu", told)


def day_by_proxops(scenario: Scenario) -> np.ndarray:
    """Position (3,) in m at the end, in the inertial frame."""
    return fly(scenario, "zero").dataset["position_inertial"].values[-1]


def start_of(scenario: Scenario) -> np.ndarray:
    """The state (6,) in the inertial frame."""
    position = np.array(scenario.transit.start_m)
    velocity = np.array(scenario.transit.start_velocity_m_s)
    spin = load_body("bennu").spin.rate
    return np.concatenate([position, velocity + np.cross(spin, position)])


def day_by_dop853(scenario: Scenario, hours: float, light: float = 1.0) -> np.ndarray:
    """The same at a tolerance of 1e-13; `light` is a factor of the Sun's light and gravity."""
    body = load_body("bennu")
    gravity, spin = esa_model(body.exact_field), body.spin.rate
    sun = SUNLIGHT.distance_au * AU * np.array([1.0, 0.0, 0.0], dtype=np.longdouble)
    share = SUNLIGHT.reflectivity * SUNLIGHT.area_m2 / scenario.spacecraft.mass_kg
    push = -IRRADIANCE / LIGHT / SUNLIGHT.distance_au**2 * share

    def rates(time: float, y: np.ndarray) -> np.ndarray:
        turn = Rotation.from_rotvec(time * spin).as_matrix()
        pull = turn @ np.array(gravity(turn.T @ y[:3], False)[1])
        away = sun - y[:3]
        tide = away / np.sum(away**2) ** 1.5 - sun / np.sum(sun**2) ** 1.5
        pull += light * (SUN * tide.astype(float) + push * np.array([1.0, 0.0, 0.0]))
        return np.concatenate([y[3:], pull])

    start = start_of(scenario)
    scale = np.repeat([RADIUS, np.linalg.norm(start[3:])], 3)
    span = (0.0, 3600.0 * hours)
    return solve_ivp(rates, span, start, "DOP853", rtol=1e-13, atol=1e-13 * scale).y[:3, -1]


def day_by_basilisk(scenario: Scenario, hours: float, seconds: float) -> np.ndarray:
    """The same by Basilisk in steps of some seconds."""
    from Basilisk.architecture import messaging, sysModel
    from Basilisk.simulation import gravityEffector, radiationPressure, spacecraft
    from Basilisk.utilities import SimulationBaseClass, macros

    body = load_body("bennu")
    spin = body.spin.rate
    cross = np.cross(spin, np.eye(3)).T
    sun_state = messaging.SpicePlanetStateMsgPayload()
    sun_state.PositionVector = [SUNLIGHT.distance_au * AU, 0.0, 0.0]
    sun_state.VelocityVector = [0.0, 0.0, 0.0]
    sun_message = messaging.SpicePlanetStateMsg().write(sun_state)

    class Turning(sysModel.SysModel):
        """Turns the body."""

        def __init__(self):
            super().__init__()
            self.message = messaging.SpicePlanetStateMsg()

        def UpdateState(self, now):  # noqa: N802
            turn = Rotation.from_rotvec(now * macros.NANO2SEC * spin).as_matrix()
            state = messaging.SpicePlanetStateMsgPayload()
            state.J20002Pfix = turn.T.tolist()
            state.J20002Pfix_dot = (-cross @ turn.T).tolist()
            state.PositionVector = state.VelocityVector = [0.0, 0.0, 0.0]
            state.computeOrient = 1
            self.message.write(state, now, self.moduleID)

    simulation = SimulationBaseClass.SimBaseClass()
    step = macros.sec2nano(seconds)
    simulation.CreateNewProcess("process").addTask(simulation.CreateNewTask("task", step))
    world, craft = Turning(), spacecraft.Spacecraft()
    planet, sun = gravityEffector.GravBodyData(), gravityEffector.GravBodyData()
    planet.planetName, planet.isCentralBody = "body", True
    model = basilisk_model(body.exact_field)
    corners = body.shape.vertices[body.shape.facets]
    # Basilisk adds absolute volumes up: see `agreement.py`.
    absolute = float(np.abs(np.linalg.det(corners)).sum() / 6.0 / body.shape.volume)
    model.muBody = planet.mu = absolute * GRAVITATIONAL_CONSTANT * body.exact_field.mass
    planet.gravityModel = model
    planet.planetBodyInMsg.subscribeTo(world.message)
    sun.planetName, sun.isCentralBody, sun.mu = "sun", False, SUN
    sun.planetBodyInMsg.subscribeTo(sun_message)
    craft.gravField.gravBodies = spacecraft.GravBodyVector([planet, sun])
    craft.hub.mHub = scenario.spacecraft.mass_kg
    light = radiationPressure.RadiationPressure()
    light.setUseCannonballModel()
    light.area = SUNLIGHT.area_m2
    light.coefficientReflection = SUNLIGHT.reflectivity
    light.sunEphmInMsg.subscribeTo(sun_message)
    craft.addDynamicEffector(light)
    start = start_of(scenario)
    craft.hub.r_CN_NInit = start[:3].reshape(3, 1).tolist()
    craft.hub.v_CN_NInit = start[3:].reshape(3, 1).tolist()
    for number, part in enumerate((world, light, craft)):
        simulation.AddModelToTask("task", part, 100 - number)
    simulation.InitializeSimulation()
    simulation.ConfigureStopTime(macros.sec2nano(3600.0 * hours))
    simulation.ExecuteSimulation()
    return np.array(craft.scStateOutMsg.read().r_BN_N)


def facets_apart(model_name: str, ways: int = 20) -> tuple[float, float]:
    """Greatest differences of force and torque on facets from Basilisk's, over the force (1 and m).

    Basilisk's `facetSRPDynamicEffector` gets one facet after the other, for light along `ways`.
    """
    from Basilisk.architecture import messaging
    from Basilisk.simulation import facetSRPDynamicEffector, spacecraft
    from Basilisk.utilities import SimulationBaseClass, macros

    facets, apart = facets_of(load_spacecraft(model_name)), []
    settings = SunlightConfig(distance_au=1.0)
    for way in spread_directions(ways):
        simulation = SimulationBaseClass.SimBaseClass()
        task = simulation.CreateNewTask("task", macros.sec2nano(1.0))
        simulation.CreateNewProcess("process").addTask(task)
        state = messaging.SpicePlanetStateMsgPayload()
        state.PositionVector = (AU * way).tolist()
        message = messaging.SpicePlanetStateMsg().write(state)
        effector = facetSRPDynamicEffector.FacetSRPDynamicEffector()
        effector.setNumFacets(len(facets.areas))
        effector.setNumArticulatedFacets(0)
        for k, area in enumerate(facets.areas):
            effector.addFacet(
                float(area), np.eye(3), facets.normals[k], np.zeros(3), facets.centres[k],
                float(facets.diffuse[k]), float(facets.specular[k]),
            )  # fmt: skip
        effector.sunInMsg.subscribeTo(message)
        craft = spacecraft.Spacecraft()
        craft.addDynamicEffector(effector)
        simulation.AddModelToTask("task", effector)
        simulation.AddModelToTask("task", craft)
        simulation.InitializeSimulation()
        effector.computeForceTorque(0.0, 1.0)
        scale = OF_THEIR_FACETS / IRRADIANCE * light_pressure(settings)
        ours = light_on_facets(facets, way)
        theirs = effector.forceExternal_B, effector.torqueExternalPntB_B
        found = [np.array(each).ravel() / scale for each in theirs]
        size = np.linalg.norm(ours[0])
        apart.append([np.linalg.norm(a - b) / size for a, b in zip(ours, found, strict=True)])
    return tuple(np.max(apart, axis=0).tolist())
