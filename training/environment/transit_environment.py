"""`TransitEnvironment`: the transit diagram, one control step at a time, for Gymnasium."""

from __future__ import annotations

import dataclasses as dc
import time
import typing
from pathlib import Path

import gymnasium
import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from proxops.diagrams.flight import (
    Flown,
    diagram_of,
    let_go,
    make_log,
    make_simulator,
)
from proxops.diagrams.logs import FlightLog
from proxops.diagrams.scenario import (
    Scenario,
    World,
    change_scenario,
    load_body,
    load_scenario,
    of_transit,
    parse_scenario,
)
from proxops.systems.vehicle import COLLIDED, FINISHED, VIOLATIONS
from proxops.training.environment.observations import (
    LARGEST_TRANSIT,
    action_space,
    asked_transits,
    check_known_dispersions,
    check_observation,
    observation_space,
    taken_action,
)
from proxops.training.environment.rendering import (
    FRAMES_PER_SECOND,
    RENDER_MODE,
    check_render_mode,
    transit_picture,
)
from proxops.training.environment.reward import step_reward

if typing.TYPE_CHECKING:
    from proxops.diagrams.plots import TransitPicture


class TransitEnvironment(gymnasium.Env):
    """A transit to a goal in the vicinity of a body, flown one control period at a time.

    The observation is a dictionary of `goal` (3), its position in K in m, and

    * with `observation="state"`: `state` (6), position and velocity in K in m and m/s as the
      navigation knows them, and `known` (1), which is 0 while the navigation knows nothing; then
      `state` is 0 as well;
    * with `observation="lidar"`: `ranges` (planes, rays) in m, 0 for no return.

    The action is the force along each axis over the thrust limit, from -1 to 1. As with every
    controller, it is along the axes of K, and command axes turn it where the scenario has a
    navigation and the observation is its state. `step_reward` gives the reward. An episode is
    terminated by arrival or collision, and truncated when the deadline and the dwell after it are
    over. At its end, `info["summary"]`
    is the summary of the flight's log, and the log itself is `log`.
    """

    metadata = {"render_modes": [RENDER_MODE], "render_fps": FRAMES_PER_SECOND}  # noqa: RUF012

    def __init__(
        self,
        scenario: Scenario | str | Path | None = None,
        observation: str = "state",
        dispersions: str | None = None,
        transit_seed: int = 0,
        changes: typing.Mapping[str, typing.Any] | None = None,
        render_mode: str | None = None,
    ):
        """Takes the scenario and what the pilot sees of it.

        Args:
          scenario: a scenario, the path of its YAML file, or the text of a whole one; None: the
            usual one, at Kleopatra.
          observation: `state` or `lidar`.
          dispersions: name or file of those that each episode's world is drawn from.
          transit_seed: draws the transits. Seeds from 10,000 on are for evaluation: learn on none
            of their transits.
          changes: keys and values of the scenario, as `change_scenario` takes them.
          render_mode: `rgb_array`: `render` gives pictures. None: it does not.

        Raises:
          InputError: the observation is none of the two, as is the render mode, there are no such
            dispersions, or the scenario cannot be flown.
        """
        check_observation(observation)
        check_render_mode(render_mode)
        self.render_mode = render_mode
        given = _given(scenario)
        own = {"log_ranges": False} | dict(changes or {})
        own |= {} if dispersions is None else {"dispersions": dispersions}
        self.scenario, self._transit_seed = change_scenario(given, own), transit_seed
        check_known_dispersions(self.scenario)
        self._body = load_body(self.scenario.body).with_gravity(self.scenario.gravity)
        self._observation = observation
        self._frame = (self.scenario.lidar.planes, self.scenario.lidar.rays)
        self.observation_space = observation_space(self.scenario, observation)
        self.action_space = action_space()
        self._episode: _Episode | None = None
        self.log: FlightLog | None = None
        """The log of the last episode that ended."""

    def reset(
        self, *, seed: int | None = None, options: dict[str, typing.Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, typing.Any]]:
        """Begins a transit: number `options["transit"]`, or one that the seed draws.

        Start and goal that the scenario gives are kept; the number then draws noise and world.

        Returns:
          The observation, and `info` with the number of the transit.

        Raises:
          InputError: an option is unknown, or no number of a transit.
          UnflyableWorldError: the transit cannot begin in its world.
        """
        asked = asked_transits(options, ())
        super().reset(seed=seed)
        self.close()
        number = int(self.np_random.integers(LARGEST_TRANSIT) if asked is None else asked)
        scenario = of_transit(self.scenario, self._transit_seed, number)
        given = self.scenario.transit
        if given.start_m is not None or given.goal_m is not None:
            scenario = dc.replace(self.scenario, transit=dc.replace(given, index=number))
        world = World.of(scenario, self._body)
        pilot = _Pilot(self._observation, self._frame[0] * self._frame[1])
        diagram = diagram_of(world, pilot)
        simulator = make_simulator(diagram, world.scenario)
        flown = Flown(diagram, simulator.get_context(), world, pilot, "environment", None)
        self._episode = _Episode(flown, simulator, pilot)
        return self._seen(self._episode), {"transit": number}

    def step(
        self, action: np.ndarray
    ) -> tuple[dict[str, np.ndarray], float, bool, bool, dict[str, typing.Any]]:
        """Holds a force for one control period.

        Args:
          action: (3,) the force over the thrust limit; what lies beyond -1 and 1 is cut off.

        Raises:
          InputError: the action has another shape, or is not a number.
        """
        episode = self._episode
        if episode is None:
            raise gymnasium.error.ResetNeeded("a transit begins with reset()")
        scenario, context = episode.flown.world.scenario, episode.flown.context
        craft, began, was = scenario.spacecraft, context.get_time(), episode.distance
        force = craft.thrust_limit_n * taken_action(action, (3,))
        latest = scenario.arrival.deadline_s + scenario.arrival.dwell_s
        period = scenario.control_period_s
        episode.hold(force, min((round(began / period) + 1) * period, latest))
        outcome = episode.flown.value("monitor", "outcome")
        broken = int(outcome[VIOLATIONS] + outcome[COLLIDED])
        # Each axis has its own thrusters.
        spent = float(np.abs(force).sum()) / craft.mass_kg * (context.get_time() - began)
        reward = step_reward(
            was - episode.distance,
            episode.way,
            spent,
            craft.speed_limit_m_s,
            bool(outcome[FINISHED]),
            broken - episode.broken,
        )
        episode.broken = broken
        terminated = bool(outcome[FINISHED] or outcome[COLLIDED])
        truncated = not terminated and context.get_time() >= latest
        info: dict[str, typing.Any] = {}
        if terminated or truncated:
            self.log = episode.log()
            info["summary"] = self.log.summary
        return self._seen(episode), reward, terminated, truncated, info

    def render(self) -> np.ndarray | None:
        """Draws the transit so far, seen along z and along y; None without a render mode.

        Returns:
          A picture, uint8 (height, width, 3).
        """
        if self.render_mode is None:
            return None
        if self._episode is None:
            raise gymnasium.error.ResetNeeded(
                "a picture is of a transit, which begins with reset()"
            )
        return self._episode.picture()

    def close(self) -> None:
        """Gives the memory of the episode back; Drake would keep it (see `let_go`)."""
        if self._episode is not None:
            let_go(self._episode.flown.diagram, None)
            self._episode = None

    def _seen(self, episode: _Episode) -> dict[str, np.ndarray]:
        """The observation now."""
        pilot = episode.pilot
        seen = pilot.seen(pilot.GetMyContextFromRoot(episode.flown.context))
        found = {"goal": seen["target"][:3]}
        if self._observation == "lidar":
            ranges = seen["ranges"].reshape(self._frame)
            return found | {"ranges": np.where(np.isfinite(ranges), ranges, 0.0)}
        known = np.isfinite(seen["state"]).all()
        state = seen["state"] if known else np.zeros(6)
        return found | {"state": state, "known": np.array([known], dtype=np.int8)}


def _given(scenario: Scenario | str | Path | None) -> Scenario:
    """The scenario that the argument of an environment gives."""
    if isinstance(scenario, Scenario):
        return scenario
    if isinstance(scenario, str) and "\n" in scenario:
        return parse_scenario(scenario)
    return load_scenario(scenario)


class _Episode:
    """A flight in progress."""

    def __init__(self, flown: Flown, simulator: Simulator, pilot: _Pilot):
        self.flown, self.simulator, self.pilot = flown, simulator, pilot
        self.broken = 0
        """Entries of the keep-out ellipsoid and collisions so far."""
        self.way = self.distance
        """Distance in m from the goal at the start."""
        self._path = [self._position]
        self._picture: TransitPicture | None = None
        self._began = time.perf_counter()

    @property
    def distance(self) -> float:
        """Distance in m of the spacecraft from its goal."""
        return float(np.linalg.norm(self._position - self._goal))

    @property
    def _goal(self) -> np.ndarray:
        return self.flown.value("target", "y0")[:3]

    @property
    def _position(self) -> np.ndarray:
        return self.flown.value("spacecraft", "position")

    def hold(self, force: np.ndarray, until: float) -> None:
        """Flies with a force (3,) in N in K until a time in s.

        Raises:
          RuntimeError: an event of the simulation failed.
        """
        context = self.simulator.get_mutable_context()
        self.pilot.command(self.pilot.GetMyMutableContextFromRoot(context), force)
        # Drake sampled this control step for the log before its action was known.
        self.flown.diagram.ForcedPublish(context)
        self.simulator.AdvanceTo(until)
        self._path.append(self._position)

    def picture(self) -> np.ndarray:
        """The picture of the flight so far."""
        world = self.flown.world
        if self._picture is None:
            self._picture = transit_picture(world.scenario, world.body, world.true_body)
        time = self.flown.context.get_time()
        return self._picture.pixels(np.array(self._path), self._goal, time)

    def log(self) -> FlightLog:
        """The log of the flight; its last row repeats the action before."""
        return make_log(self.flown, time.perf_counter() - self._began)


class _Pilot(LeafSystem):
    """A controller whose force (3), in N in K, is what `command` was given."""

    def __init__(self, observation: str, rays: int):
        super().__init__()
        self.DeclareVectorInputPort("target", 6)
        if observation == "state":
            self.DeclareVectorInputPort("state", 6)
        else:
            self.DeclareVectorInputPort("ranges", rays)
        self._force = self.DeclareNumericParameter(BasicVector(np.zeros(3)))
        self.DeclareVectorOutputPort(
            "force", 3, self._calc, prerequisites_of_calc={self.all_parameters_ticket()}
        )

    def command(self, context: Context, force: np.ndarray) -> None:
        """Sets the force (3,) of a Context of this system."""
        context.get_mutable_numeric_parameter(self._force).SetFromVector(force)

    def seen(self, context: Context) -> dict[str, np.ndarray]:
        """The values of the input ports, by name."""
        ports = (self.get_input_port(k) for k in range(self.num_input_ports()))
        return {port.get_name(): port.Eval(context) for port in ports}

    def _calc(self, context, output):
        output.SetFromVector(context.get_numeric_parameter(self._force).value())
