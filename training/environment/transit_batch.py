"""`TransitBatch`: many transits at once on the plain equations of motion, for Gymnasium."""

from __future__ import annotations

import math
import typing
from pathlib import Path

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from proxops.diagrams.flight import LIDAR_STREAM, make_events, make_lidar
from proxops.diagrams.scenario import (
    Body,
    Scenario,
    change_scenario,
    differing_values,
    load_body,
    load_scenario,
    of_transit,
    scenario_transit,
)
from proxops.systems.common import InputError, check_positive, derived_seed
from proxops.systems.gravity import Field
from proxops.systems.vehicle import (
    COLLIDED,
    ENTERED_GOAL,
    FINISHED,
    NEVER,
    VIOLATIONS,
    FlownPath,
    rotating_frame_acceleration,
    runge_kutta_step,
)
from proxops.training.environment.observations import (
    LARGEST_TRANSIT,
    action_space,
    asked_transits,
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

# In one step of the integration a spacecraft low above the body moves round it by less than this
# (rad), and the body turns by less.
_TURN = 0.02


class TransitBatch(gymnasium.vector.VectorEnv):
    """Many transits at once, in the world as believed, on the equations of motion alone.

    Observations, actions, rewards and ends are those of `TransitEnvironment`, but `state` is the
    true state, so `known` is always 1. A transit that has ended begins anew, as another one, in the
    next step, which ignores its action (`AutoresetMode.NEXT_STEP`). Then `info` has, by transit,
    `transit`, its number, and in the step that ends it `time_s`, `delta_v_m_s` (to the arrival, if
    it arrived), `violations` and `arrived`.

    The motion is integrated by fourth-order Runge-Kutta steps, which end within a centimetre of
    the flight by the diagram as long as nothing is on the edge of an event.
    """

    metadata = {  # noqa: RUF012
        "render_modes": [RENDER_MODE],
        "render_fps": FRAMES_PER_SECOND,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        num_envs: int = 1,
        scenario: Scenario | str | Path | None = None,
        observation: str = "state",
        dispersions: str | None = None,
        transit_seed: int = 0,
        changes: typing.Mapping[str, typing.Any] | None = None,
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
    ):
        """Takes the scenario and what the pilots see of it.

        Args:
          num_envs: how many transits fly at once.
          scenario: a scenario, or the path of its YAML file; None: the usual one, at Kleopatra.
          observation: `state` or `lidar`.
          dispersions: None; there is no other world here than the believed one.
          transit_seed: draws the transits. Seeds from 10,000 on are for evaluation: learn on none
            of their transits.
          changes: keys and values of the scenario, as `change_scenario` takes them. Gravity is that
            of the table if they do not say `gravity: exact`.
          max_episode_steps: a transit is truncated after this many steps; None: at the deadline and
            the dwell after it, as it is in any case.
          render_mode: `rgb_array`: `render` gives pictures. None: it does not.

        Raises:
          InputError: the observation is none of the two, as is the render mode, a number is below
            1, or the scenario has dispersions, disturbances, runtime assurance, or a world that
            differs from the believed one.
        """
        check_observation(observation)
        check_render_mode(render_mode)
        check_positive("TransitBatch", num_envs=num_envs)
        if max_episode_steps is not None:
            check_positive("TransitBatch", max_episode_steps=max_episode_steps)
        self.render_mode, self._most_steps = render_mode, max_episode_steps or math.inf
        given = scenario if isinstance(scenario, Scenario) else load_scenario(scenario)
        own = {"gravity": "table"} | dict(changes or {})
        own |= {} if dispersions is None else {"dispersions": dispersions}
        self.scenario, self._transit_seed = change_scenario(given, own), transit_seed
        _check_plain(self.scenario)
        self._body = load_body(self.scenario.body).with_gravity(self.scenario.gravity)
        self._motion = _Motion(self.scenario, self._body)
        self._events = make_events(self.scenario, self._body, self._body.gravity_field)
        self._with_frames = observation == "lidar"
        self._lidar = make_lidar(self.scenario, self._body.shape, 0)
        self.num_envs = num_envs
        self.single_observation_space = observation_space(self.scenario, observation)
        self.single_action_space = action_space()
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._numbers = np.zeros(num_envs, dtype=np.int64)
        self._states, self._targets = np.zeros((2, num_envs, 6))
        self._way, self._spent, self._spent_to_arrival = np.zeros((3, num_envs))
        self._steps = np.zeros(num_envs, dtype=np.int64)
        self._outcomes = np.zeros((num_envs, 4))
        self._seeds = [0] * num_envs
        self._over = np.ones(num_envs, dtype=bool)
        """Transits that have ended, or have never begun."""
        self._paths: list[list[np.ndarray]] = [[] for _ in range(num_envs)]
        """Positions (3,) of each step, for pictures."""
        self._picture: TransitPicture | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, typing.Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, typing.Any]]:
        """Begins all transits: of the numbers `options["transit"]` (num_envs,), or drawn ones.

        Returns:
          The observations, and `info` with the numbers of the transits.

        Raises:
          InputError: an option is unknown, or not of numbers of transits.
        """
        numbers = asked_transits(options, (self.num_envs,))
        if seed is not None:
            self._np_random, self._np_random_seed = seeding.np_random(seed)
        if numbers is None:
            numbers = self.np_random.integers(LARGEST_TRANSIT, size=self.num_envs)
        for k, number in enumerate(numbers):
            self._begin(k, int(number))
        return self._seen(), self._begun(np.ones(self.num_envs, dtype=bool))

    def step(
        self, actions: np.ndarray
    ) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray, np.ndarray, dict[str, typing.Any]]:
        """Holds forces for one control period.

        Args:
          actions: (num_envs, 3) the forces over the thrust limit; what lies beyond -1 and 1 is cut
            off.

        Raises:
          InputError: the actions have another shape, or one is not a number.
        """
        if not self._way.any():
            raise gymnasium.error.ResetNeeded("transits begin with reset()")
        scenario, fresh = self.scenario, self._over.copy()
        for k in np.flatnonzero(fresh):
            self._begin(int(k), int(self.np_random.integers(LARGEST_TRANSIT)))
        craft, latest = scenario.spacecraft, scenario.arrival.deadline_s + scenario.arrival.dwell_s
        forces = craft.thrust_limit_n * taken_action(actions, (self.num_envs, 3))
        flown = ~fresh
        before, broken = self._distances(), self._broken()
        entered, spent = self._outcomes[:, ENTERED_GOAL].copy(), np.zeros(self.num_envs)
        # The last period may be shorter.
        began = self._steps * scenario.control_period_s
        spans = np.minimum(scenario.control_period_s, latest - began)
        for span in np.unique(spans[flown]):
            now = flown & (spans == span)
            self._advance(now, forces[now], began[now], float(span))
            spent[now] = np.abs(forces[now]).sum(axis=1) / craft.mass_kg * span
        entry = self._outcomes[:, ENTERED_GOAL]
        share, new = np.clip((entry - began) / spans, 0.0, 1.0), entry != entered
        self._spent_to_arrival[new] = (self._spent + share * spent)[new]
        self._steps += flown
        self._spent += spent
        finished = (self._outcomes[:, FINISHED] > 0.0) & flown
        terminated = finished | ((self._outcomes[:, COLLIDED] > 0.0) & flown)
        ended = (began + spans >= latest) | (self._steps >= self._most_steps)
        truncated = ended & flown & ~terminated
        rewards = step_reward(
            before - self._distances(),
            self._way,
            spent,
            craft.speed_limit_m_s,
            finished,
            self._broken() - broken,
        )
        self._over = terminated | truncated
        for k in np.flatnonzero(flown) if self.render_mode else ():
            self._paths[k].append(self._states[k, :3].copy())
        info = self._begun(fresh) | self._ended(finished, began + spans)
        return self._seen(), np.where(flown, rewards, 0.0), terminated, truncated, info

    def render(self) -> tuple[np.ndarray, ...] | None:
        """Draws each transit so far, seen along z and along y; None without a render mode.

        Returns:
          A picture of each, uint8 (height, width, 3).
        """
        if self.render_mode is None:
            return None
        if not self._way.any():
            raise gymnasium.error.ResetNeeded("pictures are of transits, which begin with reset()")
        self._picture = self._picture or transit_picture(self.scenario, self._body)
        latest = self.scenario.arrival.deadline_s + self.scenario.arrival.dwell_s
        times = np.minimum(self._steps * self.scenario.control_period_s, latest)
        return tuple(
            self._picture.pixels(np.array(path), target[:3], time)
            for path, target, time in zip(self._paths, self._targets, times, strict=True)
        )

    def _begin(self, index: int, number: int) -> None:
        """Begins transit `number` as the `index`-th of the batch."""
        scenario = of_transit(self.scenario, self._transit_seed, number)
        transit = scenario_transit(scenario, self._body)
        self._numbers[index] = number
        self._states[index, :3], self._states[index, 3:] = transit.start, transit.start_velocity
        self._targets[index, :3] = transit.goal
        self._way[index] = np.linalg.norm(transit.goal - transit.start)
        inside = self._events.is_in_region(self._states[index], self._targets[index])
        self._outcomes[index] = [0.0 if inside else NEVER, 0.0, 0.0, 0.0]
        self._steps[index] = self._spent[index] = 0
        parts = scenario.noise_seed, self._transit_seed, number, LIDAR_STREAM
        self._seeds[index] = derived_seed(*parts)
        self._over[index] = False
        self._paths[index] = [transit.start]

    def _advance(self, which: np.ndarray, forces: np.ndarray, began: np.ndarray, span: float):
        """Flies those of the batch that a mask (num_envs,) names, and follows their outcomes."""
        starts, targets = self._states[which], self._targets[which]
        ends = self._motion.after(starts, forces, span)
        self._states[which] = ends
        calm = self._events.nothing_happens(starts, ends, targets, span)
        calm &= self._outcomes[which, ENTERED_GOAL] == NEVER
        for k in np.flatnonzero(~calm):
            index = np.flatnonzero(which)[k]
            path = FlownPath(
                np.stack([starts[k], ends[k]]),
                np.stack([targets[k], targets[k]]),
                float(began[k]),
                span,
            )
            self._outcomes[index] = self._events.after(self._outcomes[index], path)

    def _distances(self) -> np.ndarray:
        """Distances (num_envs,) in m from the goals."""
        return np.linalg.norm(self._states[:, :3] - self._targets[:, :3], axis=1)

    def _broken(self) -> np.ndarray:
        """Entries of the keep-out ellipsoid and collisions (num_envs,) so far."""
        return self._outcomes[:, VIOLATIONS] + self._outcomes[:, COLLIDED]

    def _seen(self) -> dict[str, np.ndarray]:
        """The observations now."""
        seen = {"goal": self._targets[:, :3].copy()}
        if not self._with_frames:
            known = np.ones((self.num_envs, 1), dtype=np.int8)
            return seen | {"state": self._states.copy(), "known": known}
        geometry = self._lidar.geometry
        ranges = np.empty((self.num_envs, geometry.planes, geometry.rays))
        times = self._steps * self.scenario.control_period_s
        for k in range(self.num_envs):
            at = times[k : k + 1], self._states[k : k + 1, :3]
            ranges[k] = self._lidar.frames(*at, self._seeds[k])[0]
        ranges[np.isinf(ranges)] = 0.0
        return seen | {"ranges": ranges}

    def _begun(self, which: np.ndarray) -> dict[str, typing.Any]:
        """The part of `info` for transits (num_envs,), bool, that begin."""
        return {"transit": self._numbers.copy(), "_transit": which} if which.any() else {}

    def _ended(self, arrived: np.ndarray, times: np.ndarray) -> dict[str, typing.Any]:
        """The part of `info` for the transits that are over; `times` (num_envs,) in s."""
        if not self._over.any():
            return {}
        values = {
            "time_s": times,
            "delta_v_m_s": np.where(arrived, self._spent_to_arrival, self._spent),
            "violations": self._outcomes[:, VIOLATIONS].astype(int),
            "arrived": arrived,
        }
        return values | {f"_{name}": self._over.copy() for name in values}


class _Motion:
    """The equations of motion as believed, for many spacecraft."""

    def __init__(self, scenario: Scenario, body: Body):
        self._field: Field = body.gravity_field
        self._mass, self._spin = scenario.spacecraft.mass_kg, body.spin_rate
        # The rate of a circular orbit as low as can be.
        low = float(np.min(body.keep_out_semi_axes))
        pull = self._field.evaluate(np.array([[low, 0.0, 0.0], [0.0, low, 0.0], [0.0, 0.0, low]]))
        strongest = float(np.linalg.norm(pull.acceleration, axis=1).max())
        self._rate = max(math.sqrt(strongest / low), abs(self._spin))

    def after(self, states: np.ndarray, forces: np.ndarray, span: float) -> np.ndarray:
        """States (N, 6) in m and m/s after `span` s under forces (N, 3) in N, all in K."""
        steps = math.ceil(span * self._rate / _TURN)
        step, now = span / steps, states.T
        for _ in range(steps):
            now = runge_kutta_step(lambda at: self._rates(at, forces.T), now, step)
        return now.T

    def _rates(self, states: np.ndarray, forces: np.ndarray) -> np.ndarray:
        """Derivatives (6, N) of states (6, N)."""
        gravity = self._field.evaluate(np.ascontiguousarray(states[:3].T)).acceleration.T
        rates = rotating_frame_acceleration(
            states[:3], states[3:], gravity, forces, self._mass, self._spin
        )
        return np.concatenate([states[3:], rates])


def _check_plain(scenario: Scenario) -> None:
    """Raises `InputError` if the scenario has what the batch leaves out."""
    parts = ("dispersions", "disturbance", "force_noise", "kicks", "sunlight", "assurance")
    there = [name for name in parts if getattr(scenario, name) is not None]
    if any(key.startswith("truth.") for key in differing_values(scenario)):
        there.append("truth")
    if scenario.transit.start_m is not None or scenario.transit.goal_m is not None:
        there.append("transit.start_m and goal_m")
    if there:
        raise InputError(
            f"a batch of transits flies in the world as believed, so its scenario has no "
            f"{', '.join(there)}; use vectorization_mode='async' for it"
        )
