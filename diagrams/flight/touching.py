"""The touch of a flight: where the ground is near, Drake's contact moves the spacecraft.

The transit diagram flies all along: sensors, navigation, controller, thrusters and log go on. Near
the ground its spacecraft is moved by a contact plant, one attitude period at a time, with the force
and torque that its thrusters and wheels give: see `TouchMotion`.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from pydrake.systems.analysis import InitializeParams, Simulator
from pydrake.systems.framework import Context, Diagram
from pydrake.systems.primitives import ConstantVectorSource

from proxops.diagrams.flight.wiring import Signals, Wiring
from proxops.diagrams.scenario import (
    Body,
    RigidBodyConfig,
    Scenario,
    TouchAndGoConfig,
    World,
    load_spacecraft,
    touch_arm,
    touch_craft,
    touch_site,
)
from proxops.systems import RigidSpacecraft
from proxops.systems.common import State, Vector3, cross_matrix, rotation_matrix
from proxops.systems.policy import DescentBundle
from proxops.systems.touch import (
    DescentGuidance,
    DescentPilot,
    DescentPolicy,
    Mission,
    TouchController,
    contact_energy,
    make_contact_plant,
    nearest_points,
    patch_of,
    place_craft,
)

# Time in s from one look at the forces of contact to the next, and the plant's step: half of it
# changes peak and stroke by 1 %.
_LOOK, _STEP = 0.1, 0.02
_ROUNDING = 1e-9
# Contact takes over where the ground is nearer than anything of the spacecraft reaches, and this
# far in m; it ends twice as far. The ground is taken along so far about it.
_SPARE, _PATCH = 0.3, 40.0


def make_touch_controller(
    scenario: Scenario, body: Body, bundle: Path | None = None, checked: bool = False
) -> TouchController:
    """Makes the controller of a touch-and-go from what is believed.

    Args:
      scenario: of a touch-and-go whose site is a position. body: as believed.
      bundle: folder of the policy that flies the legs of the descent; None: the program does.
      checked: the policy is a hybrid's, which the program checks.

    Raises:
      InputError: the bundle is damaged, or none of a descent.
    """
    task, craft = scenario.task, scenario.spacecraft
    assert isinstance(task, TouchAndGoConfig)
    assert isinstance(craft, RigidBodyConfig)
    guidance = DescentGuidance(
        body.exact_field,
        body.spin,
        craft.mass_kg,
        craft.thrust_limit_n,
        touch_site(scenario, body),
        task.descent,
    )
    pilot = None
    if bundle is not None:
        policy = DescentPolicy(guidance, DescentBundle.load(bundle).network)
        gate = scenario.hybrid.agreement_gate() if checked else None
        pilot = DescentPilot(policy, gate, scenario.hybrid.check_period)
    period = scenario.control_period_s
    mission = Mission(guidance, period, task.tries, task.checks, task.away, pilot)
    thrusters = load_spacecraft(craft.model).thrusters.count
    return TouchController(mission, scenario.lidar_geometry.size, thrusters, task.transit)


def add_touch(wiring: Wiring) -> Signals:
    """Adds what contact gives, which `TouchMotion` sets; returns what is known of it on board."""
    record = wiring.add("contact_record", ConstantVectorSource(np.zeros(4)))
    wiring.logged["contact_record"] = record.get_output_port()
    head = wiring.add("head_force", ConstantVectorSource(np.zeros(1)))
    return {"head_force": head.get_output_port()}


class Look(NamedTuple):
    """What there is at one time in contact."""

    time: float
    """s."""
    state: State
    """p_KS and v_KS (6,) in m and m/s."""
    attitude: np.ndarray
    """R_KS (4,)."""
    rate: Vector3
    """w_NS (3,) in rad/s in S."""
    record: np.ndarray
    """(4,): the force on the head and the greatest on another part in N, the arm's stroke in m, and
    the energy in J (`contact_energy`)."""


class TouchMotion:
    """Moves the spacecraft of a transit diagram by contact, while the ground is near.

    The wheels' momenta and the mass go on as the transit's plant has them. Of the accelerations of
    the true world there are gravity and what appears in K; what else acts, 1e-6 m/s^2, is left out
    in these tens of seconds.
    """

    def __init__(self, world: World, diagram: Diagram):
        """Takes the world and its transit diagram."""
        scenario = world.scenario
        task, craft = scenario.task, scenario.spacecraft
        assert isinstance(task, TouchAndGoConfig)
        assert isinstance(craft, RigidBodyConfig)
        self._world, self._diagram, true_shape = world, diagram, world.true_body.shape
        spacecraft = diagram.GetSubsystemByName("spacecraft")
        assert isinstance(spacecraft, RigidSpacecraft)
        self.spacecraft, self._period = spacecraft, scenario.attitude_period_s
        touching = touch_craft(load_spacecraft(craft.model), touch_arm(task))
        off = np.array(scenario.truth.rigid_body.centre_of_mass_m)
        arm = touching.arm._replace(place=touching.arm.place - off)
        parts = {name: (middle - off, edges) for name, (middle, edges) in touching.parts.items()}
        # As the plant of the flight: the momentum of its wheels is apart.
        inertia = spacecraft.bus_inertia
        self.craft = touching._replace(arm=arm, parts=parts, inertia=inertia)
        corners = [np.linalg.norm(np.abs(m) + 0.5 * e) for m, e in parts.values()]
        tip = float(np.linalg.norm(arm.place)) + arm.head_radius
        self._reach = max(tip, *corners) + _SPARE
        sides = true_shape.vertices[true_shape.facets]
        self._edge = float(np.linalg.norm(sides - np.roll(sides, 1, axis=1), axis=2).max())
        self.looks: list[Look] = []

    def near(self, context: Context, spare: float = 0.0) -> bool:
        """Whether the ground is within reach, and so much in m more."""
        shape, place = self._world.true_body.shape, self._state(context)[4:7]
        # No point of a facet is farther from a corner than its longest edge.
        close = np.linalg.norm(shape.vertices - place, axis=1) < self._edge + self._reach + spare
        if not close.any():
            return False
        corners = shape.vertices[shape.facets[close[shape.facets].any(axis=1)]]
        away = np.linalg.norm(nearest_points(corners, place) - place, axis=1).min()
        return bool(away < self._reach + spare)

    def fly(self, simulator: Simulator, latest: float) -> None:
        """Moves the spacecraft until the ground is out of reach, or until a time in s.

        The Simulator is left at an attitude step, whose events are pending.
        """
        context = simulator.get_mutable_context()
        true_body = self._world.true_body
        place = self._state(context)[4:7].copy()
        patch = patch_of(true_body.shape, place, _PATCH)
        craft = self.craft._replace(mass=float(self._state(context)[-1]))
        plant = make_contact_plant(
            patch,
            true_body.gravity_field,
            true_body.spin,
            craft,
            self._world.scenario.truth.ground,
            step=_STEP,
        )
        contact = Simulator(plant)
        self._place(plant, contact, context)
        contact.Initialize()
        params = InitializeParams()
        params.suppress_initialization_events = True
        control, since = self._world.scenario.control_period_s, len(self.looks)
        while context.get_time() < latest and self.near(context, _SPARE):
            simulator.AdvancePendingEvents()
            steps = context.get_time() / control
            if abs(steps - round(steps)) < _ROUNDING:
                since = len(self.looks)  # What was before is known on board.
            self.looks += self._moved(plant, contact, context)
            self._tell(context, self.looks[since:])
            simulator.Initialize(params)
        self._tell(context, [])

    def _moved(self, plant: Diagram, contact: Simulator, context: Context) -> list[Look]:
        """Moves plant and spacecraft by a period; gives the looks on the way."""
        own = self.spacecraft.GetMyContextFromRoot(context)

        def given(name: str) -> np.ndarray:
            return self.spacecraft.GetInputPort(name).Eval(own)

        state, axes = self._state(context).copy(), self.spacecraft.wheel_axes
        wheels = slice(13, 13 + len(axes))
        motors = given("wheel_torque") if len(axes) else np.zeros(0)
        inside = contact.get_mutable_context()
        plant.GetInputPort("force").FixValue(inside, given("force"))
        looks, count, begun = [], max(round(self._period / _LOOK), 1), context.get_time()
        momentum, thrust_torque = axes.T @ state[wheels], given("torque")
        for k in range(count):
            rate = plant.GetOutputPort("angular_velocity").Eval(inside)
            torque = thrust_torque - axes.T @ motors - cross_matrix(rate) @ momentum
            plant.GetInputPort("torque").FixValue(inside, torque)
            contact.AdvanceTo(begun + (k + 1) * self._period / count)
            momentum = momentum + axes.T @ motors * self._period / count
            looks.append(_look(plant, inside))
        last = looks[-1]
        state[:4], state[4:7], state[7:10], state[10:13] = (
            last.attitude, last.state[:3], last.rate, last.state[3:]
        )  # fmt: skip
        state[wheels] += self._period * motors
        state[-1] -= self._period * given("mass_flow")[0]
        context.SetTime(begun + self._period)
        mutable = self.spacecraft.GetMyMutableContextFromRoot(context)
        mutable.SetContinuousState(state)
        return looks

    def _place(self, plant: Diagram, contact: Simulator, context: Context) -> None:
        """Sets the plant to where the spacecraft is."""
        state, inside = self._state(context), contact.get_mutable_context()
        inside.SetTime(context.get_time())
        motion = np.concatenate([state[4:7], state[10:13]])
        attitude = state[:4] / np.linalg.norm(state[:4])
        place_craft(plant, inside, motion, attitude, state[7:10], self._world.true_body.spin)

    def _tell(self, context: Context, looks: list[Look]) -> None:
        """Tells the diagram the greatest of what contact gave in some looks."""
        greatest = np.max([look.record for look in looks], axis=0) if looks else np.zeros(4)
        for name, values in (("head_force", greatest[:1]), ("contact_record", greatest)):
            source = self._diagram.GetSubsystemByName(name)
            own = source.GetMyMutableContextFromRoot(context)
            source.get_mutable_source_value(own).SetFromVector(values)

    def _state(self, context: Context) -> np.ndarray:
        """The spacecraft's continuous state: see `RigidSpacecraft`."""
        own = self.spacecraft.GetMyContextFromRoot(context)
        return own.get_continuous_state_vector().CopyToVector()


def _look(plant: Diagram, context: Context) -> Look:
    def read(name: str) -> np.ndarray:
        return plant.GetOutputPort(name).Eval(context).copy()

    parts = read("parts_force").max() if plant.HasOutputPort("parts_force") else 0.0
    force = np.linalg.norm(read("contact_force"))
    record = np.array([force, parts, read("arm")[0], contact_energy(plant, context)])
    return Look(
        context.get_time(), read("state"), read("attitude"), read("angular_velocity"), record
    )


def contact_figures(motion: TouchMotion, world: World) -> dict[str, float]:
    """What came of a touch, as attributes of a log; none if nothing touched.

    Of the first touch: time (s), miss (m, across the normal), speeds down and across (m/s), angle
    between arm and normal (degrees), rate against K (degrees/s). Of all: peak force on the head and
    on another part (N), stroke (m), duration (s), how often it came back to the ground more than a
    second after it had left, and the rate 10 s after the first. Energy (J) is that at the first
    touch, and what is left of it at the end of that.
    """
    looks = motion.looks
    records = np.array([look.record for look in looks]).reshape(-1, 4)
    on = np.flatnonzero(records[:, 0] > 0.0)
    parts = float(records[:, 1].max(initial=0.0))
    if not on.size:
        return {"touch_parts_force_n": parts}
    site, first = touch_site(world.scenario, world.body), looks[on[0]]
    times = np.array([look.time for look in looks])
    later = looks[min(int(np.searchsorted(times, first.time + 10.0)), len(looks) - 1)]
    aside, velocity = first.state[:3] - site.position, first.state[3:]
    along = float(velocity @ site.normal)
    spin = world.true_body.spin.angular_velocity(first.time)
    arm = rotation_matrix(tuple(first.attitude)) @ motion.craft.arm.direction

    def rate(look: Look) -> float:
        turned = look.rate - rotation_matrix(tuple(look.attitude)).T @ spin
        return float(np.degrees(np.linalg.norm(turned)))

    times = times[on]
    left = on[np.argmax(np.append(np.diff(times) > 1.0, True))]
    return {
        "touch_time_s": first.time,
        "touch_miss_m": float(np.linalg.norm(aside - (aside @ site.normal) * site.normal)),
        "touch_down_m_s": -along,
        "touch_across_m_s": float(np.linalg.norm(velocity - along * site.normal)),
        "touch_tilt_deg": float(np.degrees(np.arccos(np.clip(-arm @ site.normal, -1.0, 1.0)))),
        "touch_rate_deg_s": rate(first),
        "touch_later_rate_deg_s": rate(later),
        "touch_force_n": float(records[:, 0].max()),
        "touch_parts_force_n": parts,
        "touch_stroke_m": float(records[:, 2].max()),
        "touch_energy_j": float(records[on[0], 3]),
        "touch_energy_left_j": float(records[left, 3]),
        "touch_duration_s": float(times[-1] - times[0]),
        "touch_again": int((np.diff(times) > 1.0).sum()),
    }
