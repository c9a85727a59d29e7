"""The mission of a touch-and-go: what follows what, the checks between, abort and the way back.

::

               sure, at home                      each passage is checked
    HOME ──────────────────► CHECKPOINT ─► MATCHPOINT ─► GROUND ─► TERMINAL ─► CONTACT
     ▲                            │             │           │         │           │ hold
     │                            ▼             ▼           ▼         ▼           ▼
     └──────────── high ──────────────────────── AWAY ◄─────────────────────────────
                                        a check fails: abort

At home it begins anew if nothing has touched and tries are left. Before it there may be a TRANSIT,
which another controller flies until it is at home; after all of it PARK, which leads to an orbit.
All is a function of what is known on board: the navigated state and its covariance, whether frames
come, the head's switch, and which thrusters are found to have failed.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from proxops.systems.common import FAR, Matrix3, SolverFailure, State, Vector3, config, number
from proxops.systems.hybrid import AgreementGate
from proxops.systems.touch.descent import DescentGuidance, TouchPhase
from proxops.systems.touch.descent_policy import DescentPolicy

_ZERO = np.zeros(3)
# Deviations that the navigated position and velocity are taken to be off by, at most.
_SIGMAS = 4.0
# The share of the thrust limit that an abort is sure of: thrusters of less force, and gravity.
_SURE = 0.9
# Time in s in which the way home is braked; before a descent nothing is gained by being there soon.
_BRAKING, _UNHURRIED = 100.0, 400.0
# The least time in s of a plan to home: with less, noise would be flown.
_LEAST = 50.0
# It is parked where its velocity is off that of a round orbit by this share at most, and its
# distance by this one. A free orbit is then between 0.8 and 1.3 of the radius.
_SPEED_OFF, _DISTANCE_OFF = 0.05, 0.1


class AbortReason(IntEnum):
    """Why a descent was broken off last."""

    NONE = 0
    CORRIDOR = 1
    """Too far from the normal."""
    SPEED = 2
    """Too fast down, or too fast to stop over the ground."""
    GATE = 3
    """Not where, or not as fast as, it should be at the end of a leg."""
    NAVIGATION = 4
    """The navigation has no state, or is not sure enough of it."""
    FRAMES = 5
    """No lidar frame for too long."""
    THRUSTER = 6
    """A thruster was found to have failed."""
    LATE = 7
    """No touch where one should have been."""
    PLAN = 8
    """The program found no plan."""


@config
class TouchChecks:
    """What a descent is checked for at every step, and at the end of each leg. Judgement."""

    # Beyond the corridor's edge, and beyond the greatest speed of descent at a height.
    corridor_m: float = number(3.0, at_least=0.0, at_most=1e6, unit="m")
    speed_m_s: float = number(0.05, at_least=0.0, at_most=1e3, unit="m/s")
    # Off the place and the velocity in which a leg should end. Below the last gate, across.
    gate_m: float = number(5.0, above=0.0, at_most=1e6, unit="m")
    gate_m_s: float = number(0.04, above=0.0, at_most=1e3, unit="m/s")
    # Greatest standard deviation that the navigation may have along any axis.
    position_std_m: float = number(1.0, above=0.0, at_most=1e6, unit="m")
    velocity_std_m_s: float = number(0.02, above=0.0, at_most=1e3, unit="m/s")
    # Longest time without a lidar frame.
    frames_s: float = number(20.0, above=0.0, at_most=1e6, unit="s")
    # Longest time at the speed of contact, over what the height takes.
    late: float = number(2.5, above=1.0, at_most=100.0)
    # A force on the head above this is a touch.
    head_n: float = number(1.0, above=0.0, at_most=1e6, unit="N")


@config
class AwayConfig:
    """What follows the touch, or an abort. Judgement; the speed is as OSIRIS-REx's."""

    # Time from the touch to the thrust that leads away.
    hold_s: float = number(2.0, at_least=0.0, at_most=1e4, unit="s")
    # The speed along the normal, and the height from which the way home begins.
    speed_m_s: float = number(0.4, above=0.0, at_most=1e3, unit="m/s")
    high_m: float = number(40.0, above=0.0, at_most=1e6, unit="m")
    # The least speed of the way home, until it brakes. A faster one is kept: it is paid for.
    home_m_s: float = number(0.25, above=0.0, at_most=1e3, unit="m/s")
    # Radius of an orbit to park in at last, steep to the equator; null: it rests at home.
    park_m: float | None = number(None, above=0.0, at_most=FAR, unit="m")


class Seen(NamedTuple):
    """What is known on board at a step."""

    time: float
    """s."""
    state: State
    """(6,) in m and m/s in K; NaN: the navigation has none."""
    covariance: Matrix3 | None
    """(6, 6) of it; None: the state is exact."""
    frame: bool
    """Whether the lidar had returns."""
    head: float
    """Force in N on the head."""
    failed: bool
    """Whether a thruster was found to have failed."""


class Memory(NamedTuple):
    """What the mission keeps from step to step."""

    phase: TouchPhase = TouchPhase.HOME
    reason: AbortReason = AbortReason.NONE
    tries: int = 0
    """Descents that were begun."""
    touched: bool = False
    begun: float = 0.0
    """When the descent began, or the touch was noticed, or the terminal phase began, in s."""
    frame: float = 0.0
    """Time of the last frame in s."""
    known: bool = False
    """Whether there ever was a state."""
    state: State = np.zeros(6)
    """(6,) as known, or as reckoned from the last that was."""
    since: float = 0.0
    """When the phase began, in s."""
    agreed: bool = False
    """Whether policy and program agreed at the last check."""


class Step(NamedTuple):
    """What is done at a step."""

    memory: Memory
    force: Vector3
    """(3,) in N in K."""
    target: State
    """(6,) in m and m/s in K: where the phase leads."""
    stopping: float
    """Least height in m at which an abort now comes to rest, four deviations included."""
    by_policy: bool
    """Whether the force is the policy's."""


class DescentPilot(NamedTuple):
    """A policy that flies the legs of a descent in place of the program."""

    policy: DescentPolicy
    gate: AgreementGate | None = None
    """The policy flies while it agrees with the program; None: it is never checked."""
    check_steps: int = 1
    """Steps from one check to the next."""


class Mission:
    """A touch-and-go as a pure function of what is seen: see the module."""

    def __init__(
        self,
        guidance: DescentGuidance,
        period: float,
        tries: int = 1,
        checks: TouchChecks | None = None,
        away: AwayConfig | None = None,
        pilot: DescentPilot | None = None,
    ):
        """Takes the guidance, the control period in s, how often to try, and who flies the legs."""
        self.guidance, self.period, self.tries, self.pilot = guidance, period, tries, pilot
        self.checks, self.away = checks or TouchChecks(), away or AwayConfig()

    def step(self, memory: Memory, seen: Seen) -> Step:
        """Decides what is done from now on until the next step."""
        if seen.frame:
            memory = memory._replace(frame=seen.time)
        if np.isfinite(seen.state).all():
            memory = memory._replace(known=True, state=seen.state)
        memory = self._entered(memory, seen)
        stopping, by_policy = self.stopping(memory.state, seen.covariance), False
        try:
            if self.pilot and TouchPhase.HOME < memory.phase < TouchPhase.TERMINAL:
                force, by_policy, agreed = self._piloted(self.pilot, memory, seen.time)
                memory = memory._replace(agreed=agreed)
            else:
                force = self._force(memory, seen.time)
        except SolverFailure:
            if TouchPhase.HOME < memory.phase < TouchPhase.CONTACT:
                memory = self._aborted(memory, AbortReason.PLAN, seen.time)
            force = self._away_force(memory, seen.time)
        target = self._target(memory, force)
        state = self._reckoned(memory.state, force, seen.time)
        return Step(memory._replace(state=state), force, target, stopping, by_policy)

    def stopping(self, state: State, covariance: Matrix3 | None) -> float:
        """The least height in m over that of contact at which an abort comes to rest.

        A step goes by before the thrust acts. From then on the spacecraft brakes along the normal
        with `_SURE` of the thrust limit, which it has along any direction, less gravity.

        Args:
          state: (6,) as known. covariance: (6, 6) of it; None: exact.
        """
        guidance, normal = self.guidance, self.guidance.site.normal
        height, down = guidance.height(state), -float(state[3:] @ normal)
        if covariance is not None:
            spread = [float(normal @ covariance[k : k + 3, k : k + 3] @ normal) for k in (0, 3)]
            height -= _SIGMAS * max(spread[0], 0.0) ** 0.5
            down += _SIGMAS * max(spread[1], 0.0) ** 0.5
        pull = float(np.linalg.norm(guidance.apparent_gravity(state[:3], 0.0)))
        braking = _SURE * guidance.thrust / guidance.mass - pull
        return height - stopping_distance(down, pull, braking, self.period)

    def _entered(self, memory: Memory, seen: Seen) -> Memory:
        """The memory in the phase that this step flies."""
        time = seen.time
        if memory.phase is TouchPhase.TRANSIT:
            if not self._at_home(memory):
                return memory
            memory = memory._replace(phase=TouchPhase.HOME, since=time)
        phase = memory.phase
        if phase is TouchPhase.PARK:
            return memory
        if phase is TouchPhase.HOME:
            if self._is_over(memory, seen) and self.away.park_m and self._at_home(memory):
                return memory._replace(phase=TouchPhase.PARK, since=time)
            return self._begun(memory, seen) if self._may_begin(memory, seen) else memory
        if phase is TouchPhase.CONTACT:
            if time >= memory.begun + self.away.hold_s:
                return memory._replace(phase=TouchPhase.AWAY, since=time)
            return memory
        if phase is TouchPhase.AWAY:
            height = self.guidance.height(memory.state)
            outward = float(memory.state[3:] @ self.guidance.site.normal)
            if height < self.away.high_m or outward < 0.0:
                return memory
            return memory._replace(phase=TouchPhase.HOME, since=time)
        if seen.head > self.checks.head_n:
            return memory._replace(phase=TouchPhase.CONTACT, touched=True, begun=time, since=time)
        leg = max(phase, self.guidance.leg(time - memory.begun, memory.state))
        reason = self._wrong(memory, seen, leg)
        if reason is not AbortReason.NONE:
            return self._aborted(memory, reason, time)
        return memory if leg is phase else memory._replace(phase=TouchPhase(leg), since=time)

    def _may_begin(self, memory: Memory, seen: Seen) -> bool:
        """Whether a descent begins: it is at home, knows it, and there is one left."""
        if self._is_over(memory, seen):
            return False
        return self._at_home(memory) and self._unsure(memory, seen) is AbortReason.NONE

    def _is_over(self, memory: Memory, seen: Seen) -> bool:
        """Whether no descent is left."""
        return memory.touched or memory.tries >= self.tries or seen.failed

    def _at_home(self, memory: Memory) -> bool:
        off = memory.state - self.guidance.target(TouchPhase.HOME)
        there = np.linalg.norm(off[:3]) <= 0.2 * self.guidance.descent.home_m
        slow = np.linalg.norm(off[3:]) <= self.away.home_m_s
        return memory.known and bool(there and slow)

    def _begun(self, memory: Memory, seen: Seen) -> Memory:
        return memory._replace(
            phase=TouchPhase.CHECKPOINT,
            tries=memory.tries + 1,
            begun=seen.time,
            since=seen.time,
        )

    def _aborted(self, memory: Memory, reason: AbortReason, time: float) -> Memory:
        return memory._replace(phase=TouchPhase.AWAY, reason=reason, since=time)

    def _unsure(self, memory: Memory, seen: Seen) -> AbortReason:
        """What of the knowledge on board is not good enough."""
        checks = self.checks
        if seen.time - memory.frame > checks.frames_s:
            return AbortReason.FRAMES
        if not np.isfinite(seen.state).all():
            return AbortReason.NAVIGATION
        if seen.covariance is not None:
            most = np.repeat([checks.position_std_m, checks.velocity_std_m_s], 3)
            if (np.diag(seen.covariance) > most**2).any():
                return AbortReason.NAVIGATION
        return AbortReason.NONE

    def _wrong(self, memory: Memory, seen: Seen, leg: TouchPhase) -> AbortReason:
        """What is wrong with a descent that is about to fly a leg."""
        if seen.failed:
            return AbortReason.THRUSTER
        unsure = self._unsure(memory, seen)
        if unsure is not AbortReason.NONE:
            return unsure
        checks, guidance, descent = self.checks, self.guidance, self.guidance.descent
        state, normal = memory.state, guidance.site.normal
        height, down = guidance.height(state), -float(state[3:] @ normal)
        aside = state[:3] - guidance.site.position - height * normal
        edge = np.tan(np.radians(descent.cone_deg)) * max(height, 0.0) + descent.room_m
        if np.linalg.norm(aside) > edge + checks.corridor_m:
            return AbortReason.CORRIDOR
        fastest = 1.3 * descent.speed_m_s + max(height, 0.0) / descent.slowing_s
        if down > fastest + checks.speed_m_s:
            return AbortReason.SPEED
        if leg is not TouchPhase.TERMINAL and self.stopping(state, seen.covariance) < 0.0:
            return AbortReason.SPEED
        if leg != memory.phase:
            off = state - guidance.target(memory.phase)
            if leg is TouchPhase.TERMINAL:  # It begins by height.
                off[:3] = aside
            if np.linalg.norm(off[:3]) > checks.gate_m or np.linalg.norm(off[3:]) > checks.gate_m_s:
                return AbortReason.GATE
        elif leg is TouchPhase.TERMINAL:
            longest = descent.terminal_m / descent.speed_m_s + descent.settling_s
            if seen.time - memory.since > checks.late * longest:
                return AbortReason.LATE
        return AbortReason.NONE

    def _force(self, memory: Memory, time: float) -> Vector3:
        """The force (3,) in N of a phase."""
        guidance, phase, state = self.guidance, memory.phase, memory.state
        if phase in (TouchPhase.CONTACT, TouchPhase.TRANSIT) or not memory.known:
            return _ZERO
        if phase is TouchPhase.AWAY:
            return self._away_force(memory, time)
        if phase is TouchPhase.HOME:
            return self._home_force(memory, time)
        if phase is TouchPhase.PARK:
            velocity = self._orbit_velocity(memory.state, time)
            return _ZERO if velocity is None else guidance.steady_force(time, state, velocity)
        if phase is TouchPhase.TERMINAL:
            return guidance.terminal_force(time, state)
        return guidance.force(time - memory.begun, state, memory.begun)

    def _away_force(self, memory: Memory, time: float) -> Vector3:
        velocity = self.away.speed_m_s * self.guidance.site.normal
        return self.guidance.steady_force(time, memory.state, velocity)

    def _home_force(self, memory: Memory, time: float) -> Vector3:
        """Coasts towards home, and brakes late and evenly: a plan all the way takes more."""
        guidance, state = self.guidance, memory.state
        way = guidance.home - state[:3]
        far = float(np.linalg.norm(way))
        speed = float(state[3:] @ way) / max(far, 1e-9)
        steady = max(speed, self.away.home_m_s)
        braking = _BRAKING if memory.tries else _UNHURRIED
        if far > 0.5 * braking * steady:
            return guidance.steady_force(time, state, steady / far * way)
        # An even brake takes twice as long as the way at this speed, and it is the least effort.
        left = 2.0 * far / max(speed, 1e-9)
        left = min(max(left, _LEAST), _UNHURRIED)
        return guidance.plan(state, guidance.target(TouchPhase.HOME), left, time)[0]

    def _orbit_velocity(self, state: State, time: float) -> Vector3 | None:
        """The velocity (3,) in m/s in K that leads to the orbit of parking; None: it is there.

        It turns into a round orbit's at once, and rises or falls to its radius.
        """
        from proxops.systems.mapping import orbit_normal  # Slow to import, and few flights park.

        radius, place = self.away.park_m, state[:3]
        assert radius is not None
        distance = float(np.linalg.norm(place))
        turning, up = np.cross(self.guidance.spin.angular_velocity(time), place), place / distance
        inertial = state[3:] + turning  # Along the axes of K.
        pull = self.guidance.field.evaluate(place[None]).acceleration[0]
        speed = float(np.sqrt(np.linalg.norm(pull) * distance))
        round_orbit = speed * np.cross(orbit_normal(up, np.cross(place, inertial)), up)
        off = radius - distance
        near = np.linalg.norm(inertial - round_orbit) < _SPEED_OFF * speed
        if near and abs(off) < _DISTANCE_OFF * radius:
            return None
        rise = min(max(off / _BRAKING, -self.away.home_m_s), self.away.home_m_s)
        return round_orbit + rise * up - turning

    def _target(self, memory: Memory, force: Vector3) -> State:
        """Where the phase leads (6,): home, the end of a leg, or on along the orbit of parking."""
        if memory.phase is not TouchPhase.PARK:
            return self.guidance.target(memory.phase)
        if memory.known and not force.any():  # It is there.
            return memory.state
        return self.guidance.target(TouchPhase.HOME)

    def _piloted(
        self, pilot: DescentPilot, memory: Memory, time: float
    ) -> tuple[Vector3, bool, bool]:
        """The force of a leg, whether it is the policy's, and whether the two agreed last."""
        now = time - memory.begun, memory.state, memory.begun
        is_check = round(now[0] / self.period) % pilot.check_steps == 0
        if pilot.gate is None or (memory.agreed and not is_check):
            return pilot.policy.force(*now), True, memory.agreed
        planned, agreed = self.guidance.force(*now), False
        if is_check:
            agreed = pilot.gate.compare(pilot.policy.force(*now), planned).agrees
        return planned, False, agreed

    def _reckoned(self, state: State, force: Vector3, time: float) -> State:
        """The state (6,) a period later, for steps at which the navigation has none."""
        guidance, step = self.guidance, self.period
        push = guidance.natural_acceleration(state, time) + force / guidance.mass
        place = state[:3] + step * state[3:] + 0.5 * step**2 * push
        return np.concatenate([place, state[3:] + step * push])


def stopping_distance(down: float, pull: float, braking: float, delay: float) -> float:
    """How far in m a spacecraft goes down until it is at rest.

    Args:
      down: speed in m/s. pull: acceleration in m/s^2 downwards in a delay in s, before it brakes.
      braking: in m/s^2, against the speed.
    """
    faster = down + pull * delay
    if faster <= 0.0:
        return 0.0
    return max(0.5 * (down + faster) * delay, 0.0) + faster**2 / (2.0 * braking)
