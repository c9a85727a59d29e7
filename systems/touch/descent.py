"""The way down to a site and away again: legs between named heights, each a convex program.

In K the ground is at rest, so that a velocity that matches the ground's is none in K. Heights are
along the site's normal n, from where the spacecraft's centre of mass is at contact. Each leg has an
end, (height, speed of descent), and a time at which it is there. At each step the program finds the
force to the leg's end that takes the least effort::

    minimise    mean of |u|^2
    subject to  the motion in K, linearised about the straight line (`condensed_motion`)
                |u_i| <= thrust limit                                       along each axis of K
                p, v at the last knot = the leg's end
                |p across n| <= tan(cone) h + room           at each knot (an octagon)
                -n.v <= speed + h / slowing                at each knot

Below `DescentConfig.terminal_m` there is no plan: the velocity is held at the speed of contact.
`mission` says which leg is flown, and what comes after the touch.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from pydrake.solvers import ClarabelSolver, MathematicalProgram, SolverOptions

from proxops.systems.common import (
    InputError,
    Matrix3,
    SolverFailure,
    State,
    Vector3,
    config,
    number,
)
from proxops.systems.expert import Reference, condensed_motion
from proxops.systems.gravity import Field
from proxops.systems.rotation import SpinModel
from proxops.systems.touch.sites import tangents
from proxops.systems.vehicle import believed_acceleration

INTERVALS = 10
"""Of a leg's plan."""
# What a metre and a centimetre a second off the end cost, and off a limit along the way, where
# there is no plan without.
_END_PRICE, _WAY_PRICE = 100.0, 1000.0
_SPEED_UNIT = 0.01
# The program is solved again with the limits that its plan breaks by more than this, in m and cm/s.
_BROKEN = 1e-6
_SIDES = 8
# The shortest plan, over the time in which the speed of contact is approached.
_SHORTEST = 4.0
_ZERO = np.zeros(3)


class TouchPhase(IntEnum):
    """Where in a touch-and-go the spacecraft is."""

    TRANSIT = -1
    """On the way home for the first time, as another controller flies it."""
    HOME = 0
    """On the way home, or there."""
    CHECKPOINT = 1
    """On the way to the checkpoint."""
    MATCHPOINT = 2
    """On the way to the matchpoint."""
    GROUND = 3
    """From there to where the speed of contact is held."""
    TERMINAL = 4
    """The speed of contact is held."""
    CONTACT = 5
    """The head has touched."""
    AWAY = 6
    """Away from the ground, after a touch or to abort."""
    PARK = 7
    """On the way to an orbit, or in it."""


@config
class DescentConfig:
    """The phases of a descent. Judgement, but for heights and speed, which are as OSIRIS-REx's."""

    home_m: float = number(125.0, above=0.0, at_most=1e6, unit="m")
    checkpoint_m: float = number(90.0, above=0.0, at_most=1e6, unit="m")
    matchpoint_m: float = number(55.0, above=0.0, at_most=1e6, unit="m")
    terminal_m: float = number(5.0, above=0.0, at_most=1e6, unit="m")
    # Speeds of descent at checkpoint, matchpoint and contact.
    speed_m_s: float = number(0.1, above=0.0, at_most=1e3, unit="m/s")
    # Times from home to the checkpoint, to the matchpoint, and to contact.
    checkpoint_s: float = number(500.0, above=0.0, at_most=1e7, unit="s")
    matchpoint_s: float = number(350.0, above=0.0, at_most=1e7, unit="s")
    contact_s: float = number(550.0, above=0.0, at_most=1e7, unit="s")
    # The corridor: half-angle of a cone about the normal, and its half-width at the ground.
    cone_deg: float = number(20.0, above=0.0, below=90.0, unit="degrees")
    room_m: float = number(2.0, above=0.0, at_most=1e6, unit="m")
    # The greatest speed of descent is 1.3 times the speed of contact, and more by h over this time.
    slowing_s: float = number(120.0, above=0.0, at_most=1e7, unit="s")
    # Time in which the speed of contact is approached, below `terminal_m`.
    settling_s: float = number(10.0, above=0.0, at_most=1e5, unit="s")


class Site(NamedTuple):
    """A place, and how the spacecraft comes to it."""

    position: Vector3
    """(3,) in m in K: of the centre of mass at contact."""
    normal: Vector3
    """(3,) unit vector in K."""


class DescentGuidance:
    """The force of a descent, from time and state alone; only the solver's memory persists."""

    def __init__(
        self,
        field: Field,
        spin: SpinModel,
        mass: float,
        thrust: float,
        site: Site,
        descent: DescentConfig | None = None,
    ):
        """Builds the program.

        Args:
          field: the assumed gravity. spin: of the body, as assumed.
          mass: of the spacecraft in kg. thrust: the limit in N along each axis of K.
          site: where to go. descent: None: the defaults.

        Raises:
          InputError: the heights do not fall from home to the end.
        """
        self.descent = descent = descent or DescentConfig()
        heights = [descent.home_m, descent.checkpoint_m, descent.matchpoint_m, descent.terminal_m]
        if sorted(heights, reverse=True) != heights:
            raise InputError(f"the heights of a descent must fall, got {heights}")
        self.field, self.spin, self.mass, self.thrust = field, spin, mass, thrust
        self.site = site
        self.axes = np.vstack([*tangents(site.normal[None]), site.normal])
        """Rows (3, 3): two directions across the normal, and the normal, in K."""
        # Of the controls, so that they are numbers of order one.
        weight = float(np.abs(self.apparent_gravity(site.position, 0.0)).max())
        self.unit = max(weight, descent.speed_m_s / descent.contact_s)
        self._ends = np.cumsum([descent.checkpoint_s, descent.matchpoint_s, descent.contact_s])
        self._limits = _corridor(site, self.axes, descent)
        self._options = SolverOptions()
        self._options.SetOption(ClarabelSolver.id(), "presolve_enable", False)
        self._solver = ClarabelSolver()

    @property
    def home(self) -> Vector3:
        """The position (3,) in m from which it begins."""
        return self.site.position + self.descent.home_m * self.site.normal

    @property
    def duration(self) -> float:
        """Time in s from home to contact, as planned."""
        return float(self._ends[-1])

    def height(self, state: State) -> float:
        """Height in m of a state (6,) over that of contact, along the normal."""
        return float((state[:3] - self.site.position) @ self.site.normal)

    def leg(self, elapsed: float, state: State) -> TouchPhase:
        """The leg at a time in s since the descent began, for a state (6,)."""
        if self.height(state) < self.descent.terminal_m or elapsed >= self._ends[-1]:
            return TouchPhase.TERMINAL
        return TouchPhase(
            TouchPhase.CHECKPOINT + np.searchsorted(self._ends, elapsed, side="right")
        )

    def times(self, leg: TouchPhase) -> tuple[float, float]:
        """When one of the three legs with a plan begins and ends, in s since the descent began."""
        k = leg - TouchPhase.CHECKPOINT
        return float(np.r_[0.0, self._ends][k]), float(self._ends[k])

    def target(self, leg: TouchPhase) -> State:
        """The state (6,) in m and m/s at the end of a leg, or at rest at home."""
        descent, normal = self.descent, self.site.normal
        if leg <= TouchPhase.HOME:
            return np.concatenate([self.home, np.zeros(3)])
        heights = {
            TouchPhase.CHECKPOINT: descent.checkpoint_m,
            TouchPhase.MATCHPOINT: descent.matchpoint_m,
        }
        place = self.site.position + heights.get(leg, 0.0) * normal
        return np.concatenate([place, -descent.speed_m_s * normal])

    def force(self, elapsed: float, state: State, begun: float = 0.0) -> Vector3:
        """The force (3,) in N in K on the way down.

        Args:
          elapsed: time in s since the descent began. state: (6,) in K.
          begun: when it did, in s: `spin` is a function of time.

        Raises:
          SolverFailure: the solver fails.
        """
        leg, time = self.leg(elapsed, state), begun + elapsed
        if leg is TouchPhase.TERMINAL:
            return self.terminal_force(time, state)
        return self.plan(state, *self.aim(leg, elapsed), time)[0]

    def aim(self, leg: TouchPhase, elapsed: float) -> tuple[State, float]:
        """Where a leg's plan leads, (6,) in m and m/s, and in which time in s.

        Args:
          leg: one of the three with a plan. elapsed: time in s since the descent began.
        """
        left = self.times(leg)[1] - elapsed
        target = self.target(leg)
        # Shortly before the end the plan goes on beyond it: else centimetres would be mended by
        # velocities that are too great for the gate.
        beyond = max(_SHORTEST * self.descent.settling_s - left, 0.0)
        target[:3] += beyond * target[3:]
        return target, left + beyond

    def terminal_force(self, time: float, state: State) -> Vector3:
        """The force (3,) in N that takes on the velocity of contact."""
        return self.steady_force(time, state, -self.descent.speed_m_s * self.site.normal)

    def steady_force(self, time: float, state: State, velocity: Vector3) -> Vector3:
        """The force (3,) in N that takes on a velocity (3,) in m/s.

        What exceeds the thrust limit is reduced along its direction, not axis by axis: away from
        the ground it must not push aside.
        """
        push = (velocity - state[3:]) / self.descent.settling_s
        force = self.mass * (push - self.natural_acceleration(state, time))
        return force * self.thrust / max(self.thrust, float(np.abs(force).max()))

    def apparent_gravity(self, position: Vector3, time: float) -> Vector3:
        """Gravity and the turning frame's acceleration at rest (3,) in m/s^2, as assumed."""
        return self.natural_acceleration(np.concatenate([position, _ZERO]), time)

    def natural_acceleration(self, state: State, time: float) -> Vector3:
        """The acceleration (3,) in m/s^2 without thrust, as assumed."""
        pull = self.field.evaluate(state[None, :3]).acceleration[0]
        return believed_acceleration(state, pull, _ZERO, self.mass, self.spin, time)

    def plan(
        self, state: State, target: State, duration: float, time: float
    ) -> tuple[Vector3, np.ndarray]:
        """The plan of the least effort to a target.

        Args:
          state, target: (6,) in m and m/s in K. duration: in s. time: of the state in s.

        Returns:
          The force (3,) of its first interval in N, and its states (N, 6) at the knots after it.

        Raises:
          SolverFailure: the solver fails.
        """
        n = INTERVALS
        shares = np.linspace(0.0, 1.0, n + 1)[:, None]
        places = (1.0 - shares) * state[:3] + shares * target[:3]
        speeds = np.broadcast_to((target[:3] - state[:3]) / duration, places.shape)
        lengths = np.full(n, duration / n)
        reference = Reference(np.hstack([places, speeds]), np.zeros((n, 3)), lengths)
        motion = condensed_motion(
            self.field, self.spin, state, reference, self.unit, np.zeros(3), time
        )
        moved, fixed = motion[:, :, : 3 * n], motion[:, :, -1]
        rows, bounds = self._limits
        way = np.einsum("li,kim->klm", rows, moved).reshape(-1, 3 * n)
        least = (bounds - fixed @ rows.T).reshape(-1)
        end = (moved[-1] / _SCALES[:, None], (target - fixed[-1]) / _SCALES)
        included = np.zeros(len(least), dtype=bool)
        while True:
            solution = self._solved(end, way[included], least[included])
            broken = (way @ solution < least - _BROKEN) & ~included
            if not broken.any():
                break
            included |= broken
        return self.mass * self.unit * solution[:3], fixed + moved @ solution

    def _solved(
        self, end: tuple[np.ndarray, np.ndarray], way: np.ndarray, least: np.ndarray
    ) -> np.ndarray:
        """The controls (3 N,) in units: exactly to the end, or as near to all limits as can be."""
        size, most = 3 * INTERVALS, self.thrust / (self.mass * self.unit)
        for slack in (False, True):
            program = MathematicalProgram()
            u = program.NewContinuousVariables(size, "u")
            program.AddBoundingBoxConstraint(-most, most, u)
            program.AddQuadraticCost(
                np.eye(size) * 2.0 / INTERVALS, np.zeros(size), u, is_convex=True
            )
            ends, ways, count = u, u, len(least)
            (matrix, wanted), rows = end, way
            if slack:
                off = program.NewContinuousVariables(12 + count, "s")
                program.AddBoundingBoxConstraint(0.0, np.inf, off)
                price = np.repeat([_END_PRICE, _WAY_PRICE], [12, count])
                program.AddLinearCost(price, 0.0, off)
                matrix = np.hstack([matrix, np.eye(6), -np.eye(6)])
                rows = np.hstack([way, np.eye(count)])
                ends, ways = np.r_[u, off[:12]], np.r_[u, off[12:]]
            program.AddLinearEqualityConstraint(matrix, wanted, ends)
            if count:
                program.AddLinearConstraint(rows, least, np.full(count, np.inf), ways)
            result = self._solver.Solve(program, None, self._options)
            if result.is_success():
                return result.GetSolution(u)
        raise SolverFailure(result.get_solution_result())


_SCALES = np.repeat([1.0, _SPEED_UNIT], 3)


def _corridor(site: Site, axes: Matrix3, descent: DescentConfig) -> tuple[np.ndarray, np.ndarray]:
    """The limits rows (L, 6) @ state >= bounds (L,) of corridor and speed, in m and cm/s."""
    first, second, _ = axes
    angles = 2.0 * np.pi * np.arange(_SIDES) / _SIDES
    across = np.cos(angles)[:, None] * first + np.sin(angles)[:, None] * second
    # Inside the round cone.
    inside, steep = np.cos(np.pi / _SIDES), np.tan(np.radians(descent.cone_deg))
    rows = np.zeros((_SIDES + 1, 6))
    rows[:_SIDES, :3] = inside * steep * site.normal - across
    bounds = rows[:, :3] @ site.position
    bounds[:_SIDES] -= inside * descent.room_m
    rows[_SIDES, :3] = site.normal / descent.slowing_s / _SPEED_UNIT
    rows[_SIDES, 3:] = site.normal / _SPEED_UNIT
    fastest = 1.3 * descent.speed_m_s
    bounds[_SIDES] = (site.normal @ site.position / descent.slowing_s - fastest) / _SPEED_UNIT
    return rows, bounds
