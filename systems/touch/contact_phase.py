"""The last metre, the touch and the way off, flown in the contact plant."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram

from proxops.systems.attitude import attitude_error, control_torque
from proxops.systems.common import Quaternion, State, Vector3, config, number, rotation_matrix
from proxops.systems.touch.contact_plant import TouchCraft, place_craft
from proxops.systems.touch.descent import DescentGuidance

# Time from one look at the sensors to the next, in s.
_PERIOD = 0.1
# Contact is noticed from this force on the head on, in N.
_NOTICED = 1.0


@config
class AwayConfig:
    """What follows the touch. Judgement."""

    # Time from the touch to the thrust that leads away.
    hold_s: float = number(2.0, at_least=0.0, at_most=1e4, unit="s")
    # Thrust along the arm away from the ground, and the speed at which it ends.
    thrust_n: float = number(30.0, above=0.0, at_most=1e7, unit="N")
    speed_m_s: float = number(0.4, above=0.0, at_most=1e3, unit="m/s")
    # Greatest torque about each axis, and the attitude control's natural frequency.
    torque_n_m: float = number(0.3, at_least=0.0, at_most=1e6, unit="N m")
    frequency_rad_s: float = number(0.15, above=0.0, at_most=10.0, unit="rad/s")


class Touch(NamedTuple):
    """What came of a touch. Vectors are in K."""

    state: State
    """(6,) in m and m/s, when the head first touched."""
    tilt: float
    """Angle in rad between the arm and the normal then."""
    peak: float
    """The greatest force on the head in N, at looks 0.1 s apart."""
    stroke: float
    """How far the arm was pressed in, in m."""
    duration: float
    """Time in s from the first to the last force on the head."""
    parts: float
    """The greatest force on anything but the head, in N."""
    touches: int
    """How often the head came back to the ground, more than a second after it had left."""
    speed: float
    """Along the normal at the end, in m/s."""
    rate: float
    """Angular velocity against K in rad/s, 10 s after the touch."""
    impulse: float
    """Of the thrusters, in N s."""


def fly_contact(
    diagram: Diagram,
    guidance: DescentGuidance,
    craft: TouchCraft,
    start: tuple[State, Quaternion, Vector3],
    upright: Quaternion,
    error: State,
    away: AwayConfig | None = None,
    longest: float = 60.0,
) -> Touch | None:
    """Flies the terminal phase, the touch and the way off until it is fast enough.

    The guidance holds the speed of contact; after the touch no thrust is given for a while, then
    that along the arm. The attitude is held all along, by `control_torque`.

    Args:
      diagram: of `make_contact_plant`, of the same craft.
      guidance: of the descent. craft: the spacecraft.
      start: state (6,), attitude R_KS and angular velocity w_NS (3,) in S at the beginning.
      upright: R_KS as wanted. error: (6,), what the navigated state is off by.
      away: None: the defaults. longest: in s; in vain after it.

    Returns:
      What came of it; None: it did not touch, or did not come away.
    """
    away = away or AwayConfig()
    spin, arm = guidance.spin.angular_velocity(0.0), np.asarray(craft.arm.direction)
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    place_craft(diagram, context, *start, guidance.spin)
    simulator.Initialize()
    ports = {name: diagram.GetOutputPort(name) for name in _READ if diagram.HasOutputPort(name)}
    thrust_port, torque_port = (diagram.GetInputPort(name) for name in ("force", "torque"))
    rows: list[dict[str, np.ndarray]] = []
    touched, left, impulse = None, None, 0.0
    for k in range(round(longest / _PERIOD)):
        time = k * _PERIOD
        now = {name: np.array(port.Eval(context)) for name, port in ports.items()}
        rows.append(now)
        turn, state = rotation_matrix(tuple(now["attitude"])), now["state"]
        speed = float(state[3:] @ guidance.site.normal)
        if touched is None and np.linalg.norm(now["contact_force"]) > _NOTICED:
            touched = k
        force = np.zeros(3)
        if touched is None:
            force = turn.T @ guidance.terminal_force(0.0, state + error)
        elif left is None and time >= touched * _PERIOD + away.hold_s:
            force = -away.thrust_n * arm
            if speed >= away.speed_m_s:
                left, force = k, np.zeros(3)
        rate_error = now["angular_velocity"] - turn.T @ spin
        torque = control_torque(
            attitude_error(now["attitude"], np.array(upright)),
            rate_error, craft.inertia, away.frequency_rad_s, 0.9,
        )  # fmt: skip
        thrust_port.FixValue(context, force)
        torque_port.FixValue(context, np.clip(torque, -away.torque_n_m, away.torque_n_m))
        impulse += float(np.linalg.norm(force)) * _PERIOD
        if touched is not None and left is not None and k >= max(left, touched + _LATER):
            return _summary(rows, touched, guidance, arm, spin, impulse)
        simulator.AdvanceTo(time + _PERIOD)
    return None


_READ = ("state", "attitude", "angular_velocity", "arm", "contact_force", "parts_force")
# Looks from the touch to when its rate is told.
_LATER = round(10.0 / _PERIOD)


def _summary(
    rows: list[dict[str, np.ndarray]],
    touched: int,
    guidance: DescentGuidance,
    arm: Vector3,
    spin: Vector3,
    impulse: float,
) -> Touch:
    first, later, last = rows[touched], rows[touched + _LATER], rows[-1]
    forces = np.array([np.linalg.norm(row["contact_force"]) for row in rows])
    on = np.flatnonzero(forces)
    normal = guidance.site.normal
    tilt = np.arccos(np.clip(-normal @ rotation_matrix(tuple(first["attitude"])) @ arm, -1.0, 1.0))
    turn = rotation_matrix(tuple(later["attitude"]))
    return Touch(
        state=first["state"],
        tilt=float(tilt),
        peak=float(forces.max()),
        stroke=float(max(row["arm"][0] for row in rows)),
        duration=float(on[-1] - on[0]) * _PERIOD,
        parts=max(float(row.get("parts_force", np.zeros(1)).max()) for row in rows),
        touches=int((np.diff(on) * _PERIOD > 1.0).sum()),
        speed=float(last["state"][3:] @ normal),
        rate=float(np.linalg.norm(later["angular_velocity"] - turn.T @ spin)),
        impulse=impulse,
    )
