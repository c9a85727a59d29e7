"""Worlds and state errors within declared bounds, chosen to break runtime assurance.

A *truth* says how gravity, mass, thrust and unexplained acceleration differ from what is believed;
*state errors* say how far the believed state is from the true one. Both are drawn once for each
flight and then act at each step. They are plain classes of numpy; nothing of the assurance's own
prediction is used.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from proxops.systems.assurance import AssuranceBounds
from proxops.systems.common import InputError

# Mean number of steps for which a truth that turns keeps its mood.
_MOOD = 20.0
# Change of a drawn truth from step to step, as a share of the bound.
_WANDER = 0.1


def outward_normal(semi_axes: np.ndarray, position: np.ndarray) -> np.ndarray:
    """The unit normal (3,), at a position (3,) in m, of the ellipsoid's level there."""
    normal = position / semi_axes**2
    return normal / np.linalg.norm(normal)


def _turned(force: np.ndarray, toward: np.ndarray, angle: float) -> np.ndarray:
    """A force (3,) turned by at most an angle in rad towards a direction (3,)."""
    size = np.linalg.norm(force)
    if size == 0.0 or angle == 0.0:
        return force
    along = force / size
    across = toward - (toward @ along) * along
    length = np.linalg.norm(across)
    if length < 1e-9:
        return force
    angle = min(angle, math.atan2(length, float(toward @ along)))
    return size * (math.cos(angle) * along + math.sin(angle) * across / length)


TRUTHS = ("as believed", "corner", "drawn", "hurting", "helping", "turning")
STATE_ERRORS = (
    "none",
    "constant",
    "flattering",
    "drifting",
    "jumping",
    "flipping",
    "sideways",
)


def check_known(what: str, name: str, known: Iterable[str]) -> None:
    """Raises `InputError` unless a name is one of the known ones; `what` says what it names."""
    known = tuple(known)
    if name not in known:
        raise InputError(f"no {what} is called {name!r}: use one of {', '.join(known)}")


@dataclass
class Truth:
    """How one world differs, within its bounds.

    Kinds:
      as believed: it does not.
      corner: everything is at one end of its bounds for the whole flight, drawn at random.
      drawn: everything is somewhere between, and what may vary wanders.
      hurting: what may vary hurts the most outward acceleration at each step.
      helping: the opposite, so that the spacecraft does more than it is asked to.
      turning: hurting and helping in turn, for random times.
    """

    kind: str
    bounds: AssuranceBounds
    semi_axes: np.ndarray
    random: np.random.Generator

    def __post_init__(self):
        """Draws the world.

        Raises:
          InputError: the kind is not one of `TRUTHS`.
        """
        check_known("truth", self.kind, TRUTHS)
        bounds, random = self.bounds, self.random
        size = {"as believed": 0.0, "drawn": 1.0}.get(self.kind)
        ends = random.choice([-1.0, 1.0], 2)
        if size is not None:
            ends = size * random.uniform(-1.0, 1.0, 2)
        elif self.kind != "corner" and random.random() < 0.7:
            # Heavy and strongly attracted, mostly.
            ends = np.ones(2)
        self.gravity = 1.0 + bounds.gravity * float(ends[0])
        self.mass = 1.0 + bounds.mass * float(ends[1])
        self._thrust = random.choice([-1.0, 1.0], 3)
        self._push = random.choice([-1.0, 1.0], 3)
        self._axis = random.normal(size=3)
        if self.kind == "drawn":
            self._thrust, self._push = random.uniform(-1.0, 1.0, (2, 3))
        self._hurts, self._left = bool(random.random() < 0.5), 0

    def act(self, state: np.ndarray, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The force (3,) in N and the other acceleration (3,) in m/s^2 of the next period.

        Args:
          state: (6,) the true state in K.
          force: (3,) the commanded force in N, in K.
        """
        bounds, kind = self.bounds, self.kind
        if kind == "as believed":
            return force, np.zeros(3)
        if kind == "drawn":
            step = self.random.uniform(-_WANDER, _WANDER, (2, 3))
            self._thrust = np.clip(self._thrust + step[0], -1.0, 1.0)
            self._push = np.clip(self._push + step[1], -1.0, 1.0)
        if kind in ("corner", "drawn"):
            scaled = (1.0 + bounds.thrust * self._thrust) * force
            return _turned(scaled, self._axis, bounds.thrust_direction), (
                bounds.acceleration * self._push
            )
        if kind == "turning":
            if self._left <= 0:
                self._hurts = not self._hurts
                self._left = int(self.random.exponential(_MOOD)) + 1
            self._left -= 1
        hurts = self._hurts if kind == "turning" else kind == "hurting"
        normal = outward_normal(self.semi_axes, state[:3]) * (1.0 if hurts else -1.0)
        scaled = force * (1.0 - bounds.thrust * np.sign(force * normal))
        turned = _turned(scaled, -normal, bounds.thrust_direction)
        return turned, -bounds.acceleration * np.sign(normal)


@dataclass
class StateErrors:
    """How far the believed state is from the true one, within its bounds.

    Kinds:
      none: it is not.
      constant: by all that is allowed, in one direction.
      flattering: belief is higher, and moves outwards faster, by all that is allowed.
      drifting: from the opposite of that to that, over half of the flight, and on from there.
      jumping: by all that is allowed, in any direction, at each step.
      flipping: flattering at every other step, the opposite in between.
      sideways: along the surface, turning slowly.
    """

    kind: str
    bounds: AssuranceBounds
    semi_axes: np.ndarray
    random: np.random.Generator
    steps: int

    def __post_init__(self):
        """Draws the directions.

        Raises:
          InputError: the kind is not one of `STATE_ERRORS`.
        """
        check_known("error of the state", self.kind, STATE_ERRORS)
        self._directions = self.random.normal(size=(2, 3))
        self._step = 0

    def __call__(self, state: np.ndarray) -> np.ndarray:
        """The error (6,) of the belief at this step, in m and m/s, at a true state (6,)."""
        normal = outward_normal(self.semi_axes, state[:3])
        step = self._step
        self._step += 1
        if self.kind == "none":
            return np.zeros(6)
        if self.kind == "constant":
            position, velocity = self._directions
        elif self.kind == "jumping":
            position, velocity = self.random.normal(size=(2, 3))
        elif self.kind == "sideways":
            axis, other = np.linalg.qr(np.c_[normal, self._directions[0], self._directions[1]])[
                0
            ].T[1:]
            position = velocity = math.cos(0.05 * step) * axis + math.sin(0.05 * step) * other
        else:
            position = velocity = normal
        position = self.bounds.position * position / np.linalg.norm(position)
        velocity = self.bounds.velocity * velocity / np.linalg.norm(velocity)
        size = 1.0
        if self.kind == "drifting":
            size = min(4.0 * step / self.steps - 1.0, 1.0)
        elif self.kind == "flipping":
            size = 1.0 if step % 2 else -1.0
        return size * np.concatenate([position, velocity])
