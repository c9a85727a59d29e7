"""`LidarNavigation`: position, velocity and attitude from raw lidar frames and own commands."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RotationMatrix
from pydrake.systems.framework import LeafSystem, ValueProducer

from proxops.systems.common import (
    InputError,
    LoggedPort,
    Matrix3,
    check_limits,
    check_not_negative,
    check_positive,
    config,
    number,
    one_of,
    rotation_matrix,
)
from proxops.systems.gravity import GRAVITATIONAL_CONSTANT, BodyField
from proxops.systems.lidar import DEFAULT_GEOMETRY, LidarGeometry
from proxops.systems.navigation.estimate import BASE, Estimate
from proxops.systems.navigation.expected_errors import ExpectedErrors
from proxops.systems.navigation.frame_model import FrameModel
from proxops.systems.navigation.map_error import MapError
from proxops.systems.navigation.mended_map import MendedMap, mended_map
from proxops.systems.navigation.motion import PUSH_SIZE, Motion, Push
from proxops.systems.navigation.navigator import Memory, Navigator, Step
from proxops.systems.navigation.step_records import NavigationPhase, ReturnUse
from proxops.systems.rotation import Spin
from proxops.systems.shapes import Polyhedron

# Before the coefficients of the memory's vector: phase, contradictions, whether there is an
# estimate, velocity change spent, and two rotations.
_HEAD = 4 + 9 + 9


@config
class LidarNavigationConfig:
    """The controllers know what the navigation makes of lidar frames and of their own commands.

    See `proxops.systems.LidarNavigation`. A scenario chooses it with `navigation: !LidarNavigation
    {...}`.
    """

    # What it takes its own errors to be. null: what the scenario's dispersions, disturbance, noise
    # of the force and kicks say, and the defaults of ExpectedErrors for all else.
    expected: ExpectedErrors | None = None
    # Mesh file of the map by which it navigates, in K, and the unit of its numbers; null: that of
    # the body. Only the navigation uses it. If `proxops fly --mended-map` wrote it, the errors of
    # surface and size are those beside it, and not those of `expected`. The path in a scenario file
    # is relative to that file.
    map: str | None = None
    map_unit: str = one_of("km", ("km", "m"))
    # It takes the frames to be this many control steps old. The true age is in truth.lidar.
    frame_delay_steps: int = number(0, at_least=0, at_most=1000)


class LidarFrames(NamedTuple):
    """What is known of the frames of a lidar, from its data sheet."""

    noise_std: float
    """Of a range in m; above 0."""
    geometry: LidarGeometry = DEFAULT_GEOMETRY
    """Planes, rays and greatest range."""
    period: float = 10.0
    """Control period in s, in which one frame arrives."""
    delay: int = 0
    """Age of a frame in periods when it arrives."""


class LidarNavigation(LeafSystem):
    """A Kalman filter that compares lidar frames with those that the map predicts.

    ```
                               ┌─────────────────┐
    ranges (planes * rays) ───►│ LidarNavigation ├─► state (6), m and m/s, K; NaN: it has none
    commanded_force (3), N, S ►│                 ├─► attitude (4), R_KS
    commanded_thrust (1), N ──►│                 │
    force_apart (3), N, S ────►│                 │
    force_lead (3), N s^2, S ─►│                 ├─► covariance (81)
    body_attitude (4), R_KS ──►│                 ├─► record (5)
    outside_force (1), N ─────►│                 │
                               └─────────────────┴─► return_use (planes * rays)
    ```

    It needs no training and no start: it acquires its pose from a frame alone, with the attitude
    known to about a degree, and acquires it again when it is lost. It is made from belief: the map,
    gravity and spin as believed, the data sheet of lidar and spacecraft, and how wrong they may be.

    `body_attitude` may remain open: then the spacecraft holds S to what it takes for K. Else it is
    R_KS as measured against the stars, with the spin as believed, at the frame's time; the filter
    estimates what is wrong with that, and `commanded_force` is along K's axes as they are measured.

    `outside_force` may remain open, too: the size of a force of unknown direction that acted for a
    while since the last frame, such as that of the ground on an arm.

    `commanded_force` is the command along the spacecraft's own axes S that was held over the last
    period; `commanded_thrust` is the sum of the forces of all thrusters, which use up propellant.
    It may remain open: then there are thrusters along the axes of S. `force_apart` and
    `force_lead` say how the thrusters share the force, and how early in the period it acted: see
    `GivenForce`. `attitude` is the rotation of
    S against K as a unit quaternion (w, x, y, z). `covariance` is that of position (m), velocity
    (m/s) and of a rotation vector of S in K (rad), row by row. `record` has: root mean square of
    the residuals (m), returns used, returns rejected, normalised innovation squared over the
    returns used (about 1), and `NavigationPhase`. Residuals are NaN where no frame was used.
    `return_use` has the `ReturnUse` of each ray.

    Outputs are computed when they are asked for, then cached. What it remembers is discrete state.
    It holds no time: outputs are those of a frame only at a control step, at whole multiples of the
    period. Between steps they predict as if a whole period had passed.
    """

    def __init__(
        self,
        shape: Polyhedron,
        field: BodyField,
        spin: Spin,
        mass: float,
        frames: LidarFrames,
        expected: ExpectedErrors | None = None,
        map_error: MapError | None = None,
    ):
        """Takes what is believed.

        Args:
          shape: the map. field: gravity in the map's frame K.
          spin: of the body; a number is in rad/s about z. mass: of the spacecraft in kg.
          frames: of the lidar.
          expected: one standard deviation of everything; None: `ExpectedErrors()`.
          map_error: of the map; None: as `expected` says.
        """
        super().__init__()
        check_positive("LidarNavigation", mass=mass)
        _check(frames)
        self.expected = expected or ExpectedErrors()
        check_limits(self.expected, "LidarNavigation: expected")
        self.period, self.frame_delay = frames.period, int(frames.delay)
        geometry = frames.geometry
        said = self.expected
        if map_error is None:
            map_error = MapError(shape, said.surface_rms_m, said.surface_correlation_m)
        map_error = map_error.with_relief(said.relief_rms_m, said.relief_correlation_m)
        self.model = FrameModel(
            shape, geometry, frames.noise_std, map_error, self.expected.half_beam
        )
        low_orbit = math.sqrt(GRAVITATIONAL_CONSTANT * field.mass / shape.extents.max())
        self._navigator = Navigator(
            self.model,
            Motion(field, shape.extents, spin, mass, self.expected),
            self.expected,
            orbit=low_orbit,
            period=self.period,
            frame_delay=self.frame_delay,
        )
        self._least_force = self.expected.least_impulse_n_s / self.period
        self._size = BASE + map_error.coefficients
        self._ranges_port = self.DeclareVectorInputPort("ranges", geometry.size)
        self._force_port = self.DeclareVectorInputPort("commanded_force", 3)
        self._thrust_port = self.DeclareVectorInputPort("commanded_thrust", 1)
        self._apart_port = self.DeclareVectorInputPort("force_apart", 3)
        self._lead_port = self.DeclareVectorInputPort("force_lead", 3)
        self._body_port = self.DeclareVectorInputPort("body_attitude", 4)
        self._outside_port = self.DeclareVectorInputPort("outside_force", 1)
        self._memory = self.DeclareDiscreteState(self._packed(self._navigator.start()))
        self._step = self.DeclareCacheEntry(
            "step",
            ValueProducer(allocate=lambda: AbstractValue.Make(object()), calc=self._calc_step),
            {self.all_input_ports_ticket(), self.xd_ticket(), self.time_ticket()},
        )
        depends = {self._step.ticket()}
        self._ports = {
            name: self.DeclareVectorOutputPort(name, size, calc, depends)
            for name, size, calc in (
                ("state", 6, self._calc_state),
                ("attitude", 4, self._calc_attitude),
                ("covariance", 81, self._calc_covariance),
                ("record", 5, self._calc_record),
                ("return_use", geometry.size, self._calc_return_use),
            )
        }
        # Discrete, not unrestricted: all discrete updates at one time see the state before it, so
        # that what is downstream reads the cached result.
        self.DeclarePeriodicDiscreteUpdateEvent(self.period, 0.0, self._remember)

    def logged_ports(self) -> dict[str, LoggedPort]:
        """The ports whose values a log keeps, by the names of their columns.

        `return_use` is not one of them: it is large, and is kept together with the frames.
        """
        kept = {name: port for name, port in self._ports.items() if name != "return_use"}
        return {f"navigation_{name}": LoggedPort(port) for name, port in kept.items()}

    def estimate(self, context) -> Estimate | None:
        """The whole estimate in a Context of this system, at a control step; None: it has none."""
        self.ValidateContext(context)
        return self._step.Eval(context).now

    def mended_map(self, context) -> MendedMap:
        """Makes the map with what was learned of its surface by the last step of a Context.

        Raises:
          InputError: the navigation has no estimate or is lost, the map is not one of its unknowns,
            or the mended surface is not sound.
        """
        self.ValidateContext(context)
        memory = self._unpacked(context.get_discrete_state(self._memory).value())
        if memory.estimate is None:
            raise InputError("the map is not mended: the navigation never knew where it was")
        if memory.phase == NavigationPhase.LOST:
            raise InputError("the map is not mended: the navigation was lost in the end")
        return mended_map(self.model.shape, self.model.map_error, memory.estimate)

    def _calc_step(self, context, value):
        memory = self._unpacked(context.get_discrete_state(self._memory).value())
        ranges = self._ranges_port.Eval(context)
        navigator = self._navigator
        if self._body_port.HasValue(context):
            navigator = navigator.with_axes(self._body_axes(context))
        outside = 0.0
        if self._outside_port.HasValue(context):
            outside = float(self._outside_port.Eval(context)[0])
        time = context.get_time()
        value.set_value(navigator.step(memory, ranges, self._push(context), time, outside))

    def _push(self, context) -> Push:
        force = self._force_port.Eval(context)
        if not self._thrust_port.HasValue(context):
            return Push.along_axes(force, self._least_force)
        thrust = float(self._thrust_port.Eval(context)[0])
        ports = {"apart": self._apart_port, "lead": self._lead_port}
        told = {name: port.Eval(context) for name, port in ports.items() if port.HasValue(context)}
        return Push(force, thrust, **told)

    def _body_axes(self, context) -> Matrix3:
        return rotation_matrix(self._body_port.Eval(context))

    def _calc_state(self, context, output):
        now = self.estimate(context)
        output.SetFromVector(np.full(6, np.nan) if now is None else now.state)

    def _calc_attitude(self, context, output):
        step = self._step.Eval(context)
        rotation = step.memory.attitude if step.now is None else step.now.rotation
        if self._body_port.HasValue(context):
            rotation = rotation @ self._body_axes(context)
        # A hundred times as fast as scipy's; w is not negative.
        output.SetFromVector(RotationMatrix(rotation).ToQuaternion().wxyz())

    def _calc_covariance(self, context, output):
        now = self.estimate(context)
        nothing = now is None
        output.SetFromVector(np.full(81, np.nan) if nothing else now.covariance[:9, :9].ravel())

    def _calc_record(self, context, output):
        step = self._step.Eval(context)
        done = step.correction
        figures = [np.nan, 0.0, 0.0, np.nan]
        if done is not None:
            figures = [done.rms, done.used, done.rejected, done.nis]
        output.SetFromVector([*figures, step.memory.phase])

    def _calc_return_use(self, context, output):
        step = self._step.Eval(context)
        output.SetFromVector(_return_use(step, output.size()))

    def _remember(self, context, discrete_state):
        packed = self._packed(self._step.Eval(context).memory)
        discrete_state.set_value(self._memory, packed)

    def _packed(self, memory: Memory) -> np.ndarray:
        """A memory as a vector, so that Drake's discrete state can hold it."""
        n, estimate = self._size, memory.estimate
        size = _HEAD + memory.forces.size + n + n * n
        vector = np.zeros(size) if estimate is None else np.empty(size)  # It fills all of it.
        vector[:2] = memory.phase, memory.contradictions
        vector[4:13] = memory.attitude.ravel()
        held, mean, covariance = self._parts(vector)
        held[:] = memory.forces
        if estimate is not None:
            vector[2:4] = 1.0, estimate.spent
            vector[13:_HEAD] = estimate.rotation.ravel()
            mean[:], covariance[:] = estimate.mean, estimate.covariance
        return vector

    def _unpacked(self, vector: np.ndarray) -> Memory:
        """The memory in a vector."""
        vector = vector.copy()  # It may be a view of a Context's state, which changes.
        phase, contradictions, known, spent = vector[:4].tolist()
        attitude, rotation = vector[4:13].reshape(3, 3), vector[13:_HEAD].reshape(3, 3)
        held, mean, covariance = self._parts(vector)
        estimate = Estimate(mean, rotation, covariance, spent) if known else None
        return Memory(estimate, held, int(contradictions), NavigationPhase(int(phase)), attitude)

    def _parts(self, vector: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Views of a vector: forces (D + 1, PUSH_SIZE), mean (n,) and covariance (n, n)."""
        n, mean = self._size, _HEAD + PUSH_SIZE * (self.frame_delay + 1)
        forces = vector[_HEAD:mean].reshape(-1, PUSH_SIZE)
        return forces, vector[mean : mean + n], vector[mean + n :].reshape(n, n)


def _return_use(step: Step, rays: int) -> np.ndarray:
    """The `ReturnUse` (rays,) of a frame after a step."""
    use = np.full(rays, float(ReturnUse.NOT_USED))
    if step.correction is not None:
        use[step.correction.used_rays] = ReturnUse.USED
        use[step.correction.rejected_rays] = ReturnUse.REJECTED
    return use


def _check(frames: LidarFrames) -> None:
    owner, delay = "LidarNavigation", frames.delay
    check_positive(owner, noise_std=frames.noise_std, period=frames.period)
    check_not_negative(owner, delay=delay)
    if delay != int(delay):
        raise InputError(f"{owner} needs a whole delay of frames, got {delay}")
