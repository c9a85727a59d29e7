"""The least Δv of a touch-and-go: between the states that a flight had, in the times it took.

One linear program leads from where the descent began to the velocity of contact, one from where the
thrust away began to the arrival at home. Their variables are the on-times of the spacecraft's own
thrusters, with its attitude at the start of the descent, in many equal intervals. Thrust is limited
as the guidance's is, along each axis of K, and the path stays above the ground's plane; no torque
has to be given, and no corridor kept. The motion is linearised about the path that was found
before; DOP853 flies the result again through the field, which gives the error of the end.
"""

from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import linprog
from scipy.sparse import csr_matrix

from proxops.diagrams.logs import FlightLog
from proxops.diagrams.scenario import Body, load_body, load_spacecraft
from proxops.systems.common import rotation_matrix
from proxops.systems.expert import Reference, condensed_motion
from proxops.systems.touch import TouchPhase
from proxops.systems.vehicle import STANDARD_GRAVITY

# Linear programs, each about the path of the one before.
_ROUNDS = 4
_ROOM = 0.05  # m below the plane of contact.
_SCALES = np.repeat([1.0, 0.01], 3)

HEADINGS = (
    "down s", "flown m/s down", "least down", "back s", "flown m/s back", "least back", "gap",
    "end m",
)  # fmt: skip


class Leg(NamedTuple):
    """A part of a flight, and the least that it could have taken."""

    duration: float  # s
    flown: float  # m/s
    least: float  # m/s
    end_error: float  # m


class _Craft(NamedTuple):
    pushes: np.ndarray  # (3, K) in m/s^2 in K, of each thruster
    costs: np.ndarray  # (K,) in m/s^2
    limit: float  # m/s^2, along each axis of K


def legs(log: FlightLog) -> tuple[Leg, Leg]:
    """The way down and the way back of a flight that touched and came home."""
    scenario, data = log.scenario, log.dataset
    body = load_body(scenario.body)
    layout = load_spacecraft(scenario.spacecraft.model).thrusters
    times, phases = data.time.values, data.touch_phase.values
    states, masses = data.state.values, data.mass.values
    began = int(np.flatnonzero(phases == TouchPhase.CHECKPOINT)[0])
    # The last state before the head feels the ground, and the first under the thrust away.
    contact = int(np.flatnonzero(phases == TouchPhase.CONTACT)[0]) - 1
    away = int(np.flatnonzero(phases == TouchPhase.AWAY)[0])
    arrived = int(np.searchsorted(times, log.summary["arrival_time_s"]))
    axes = rotation_matrix(data.attitude.values[began])
    exhaust = scenario.true_specific_impulse_s * STANDARD_GRAVITY
    normal = -states[contact, 3:] / np.linalg.norm(states[contact, 3:])
    found = []
    for first, last in ((began, contact), (away, arrived)):
        mass = float(masses[first])
        craft = _Craft(
            axes @ layout.directions.T * layout.forces / mass,
            layout.forces / mass,
            scenario.spacecraft.thrust_limit_n / mass,
        )
        floor = min((states[k, :3] - states[contact, :3]) @ normal for k in (first, last))
        ends = states[first], states[last], float(times[first]), float(times[last])
        least, error = _least(body, craft, ends, normal, states[contact, :3] + floor * normal)
        flown = exhaust * float(np.log(masses[first] / masses[last]))
        found.append(Leg(ends[3] - ends[2], flown, least, error))
    return found[0], found[1]


def _least(
    body: Body,
    craft: _Craft,
    ends: tuple[np.ndarray, np.ndarray, float, float],
    normal: np.ndarray,
    ground: np.ndarray,
    n: int = 120,
) -> tuple[float, float]:
    """The least Δv in m/s, and how far from the end DOP853 finds it to lead in m."""
    start, end, begun, over = ends
    lengths, thrusters = np.full(n, (over - begun) / n), craft.costs.size
    shares = np.linspace(0.0, 1.0, n + 1)[:, None]
    path = (1.0 - shares) * start + shares * end
    pushes = np.kron(np.eye(n), craft.pushes)
    for _ in range(_ROUNDS):
        reference = Reference(path, np.zeros((n, 3)), lengths)
        motion = condensed_motion(
            body.gravity_field, body.spin, start, reference, 1.0, np.zeros(3), begun
        )
        moved = motion[:, :, : 3 * n].reshape(n, 6, n, 3) @ craft.pushes
        moved, fixed = moved.reshape(n, 6, n * thrusters), motion[:, :, -1]
        heights = np.einsum("i,lik->lk", normal, moved[:, :3])
        solution = linprog(
            np.tile(craft.costs, n) * lengths[0],
            A_ub=csr_matrix(np.vstack([-heights, pushes, -pushes])),
            b_ub=np.append((fixed[:, :3] - ground) @ normal + _ROOM, np.full(6 * n, craft.limit)),
            A_eq=moved[-1] / _SCALES[:, None],
            b_eq=(end - fixed[-1]) / _SCALES,
            bounds=(0.0, 1.0),
            method="highs-ds",
        )
        assert solution.status == 0, solution.message
        path = np.vstack([start, fixed + moved @ solution.x])
    given = (pushes @ solution.x).reshape(n, 3)
    return float(solution.fun), float(np.linalg.norm(_flown(body, given, ends) - end[:3]))


def _flown(
    body: Body, pushes: np.ndarray, ends: tuple[np.ndarray, np.ndarray, float, float]
) -> np.ndarray:
    """Where pushes (N, 3) in m/s^2 lead (3,), by another integrator."""
    state, _, begun, over = ends
    step = (over - begun) / len(pushes)

    def rates(time: float, y: np.ndarray, push: np.ndarray) -> np.ndarray:
        spin, change = body.spin.angular_velocity(time), body.spin.angular_acceleration(time)
        pull = body.gravity_field.evaluate(y[None, :3]).acceleration[0] + push
        pull -= 2.0 * np.cross(spin, y[3:]) + np.cross(spin, np.cross(spin, y[:3]))
        return np.append(y[3:], pull - np.cross(change, y[:3]))

    for k, push in enumerate(pushes):
        span = begun + k * step, begun + (k + 1) * step
        state = solve_ivp(rates, span, state, "DOP853", args=(push,), rtol=1e-9, atol=1e-9).y[:, -1]
    return state[:3]


def table_line(log: FlightLog) -> tuple[list[str], float | None]:
    """The line of a flight, and its Δv over the least; None: it did not touch and come home."""
    if not log.summary["success"]:
        return ["no touch and home"], None
    down, back = legs(log)
    gap = (down.flown + back.flown) / (down.least + back.least)
    parts = [f"{value:.{digits}f}" for leg in (down, back)
             for value, digits in ((leg.duration, 0), (leg.flown, 3), (leg.least, 3))]  # fmt: skip
    return [*parts, f"{gap:.3f}", f"{max(down.end_error, back.end_error):.3f}"], gap
