"""The rigid spacecraft: its configuration in a scenario, and the model that it names."""

from __future__ import annotations

import dataclasses as dc
import functools
import logging
import math
from pathlib import Path

import numpy as np

from proxops.assets import ASSETS
from proxops.diagrams.yaml_files import file_of, load_typed, read_mapping
from proxops.systems.attitude import (
    AttitudeGuidanceConfig,
    AttitudeNoise,
    GyroConfig,
    StarTrackerConfig,
    ThrusterLayout,
    WheelArray,
)
from proxops.systems.common import (
    InputError,
    Matrix3,
    Vector3,
    check_inertia,
    check_limits,
    config,
    html_table,
    last_change,
    number,
)

_SHIPPED = {
    path.parent.name: path for path in sorted((ASSETS / "spacecraft").glob("*/spacecraft.yaml"))
}
_MOST_THRUSTERS = 100
# Radii of gyration in m of anything from a cube of 10 cm to a space station.
_GYRATION = (0.03, 100.0)


@config
class SpacecraftModelConfig:
    """The keys of a spacecraft's YAML file. `thrusters` and `bus` are required."""

    # File in URDF or SDF with mass, inertia, solids and wheels; its path is relative to this file.
    bus: str = ""
    thrust_limit_n: float = number(7.0, at_least=1e-6, at_most=1e7, unit="N")
    specific_impulse_s: float = number(220.0, at_least=1e-3, at_most=1e9, unit="s")
    least_on_time_s: float = number(0.0, at_least=0.0, at_most=60.0, unit="s")
    # Of each: place (m) in the bus's frame, direction of the force on the spacecraft, force (N).
    thrusters: list[list[float]] = dc.field(default_factory=list)
    # Names of the joints that are reaction wheels, and the limits of each.
    wheels: list[str] = dc.field(default_factory=list)
    wheel_torque_n_m: float = number(0.1, at_least=1e-9, at_most=1e6, unit="N m")
    wheel_momentum_n_m_s: float = number(4.0, at_least=1e-9, at_most=1e9, unit="N m s")
    # Shares of the light that the outside throws back: as a mirror, and to all sides. The rest is
    # absorbed.
    specular: float = number(0.2, at_least=0.0, at_most=1.0)
    diffuse: float = number(0.1, at_least=0.0, at_most=1.0)
    gyro: GyroConfig = dc.field(default_factory=GyroConfig)
    star_tracker: StarTrackerConfig = dc.field(default_factory=StarTrackerConfig)


@dc.dataclass(frozen=True)
class SpacecraftModel:
    """A rigid spacecraft as its data sheet has it. S has the axes of the bus's frame."""

    config: SpacecraftModelConfig
    path: Path
    mass: float
    """kg, with wheels."""
    inertia: Matrix3
    """(3, 3) in kg m^2 of all of it about its centre of mass, in S."""
    centre_of_mass: Vector3
    """(3,) in m in the bus's frame: the origin of S."""
    thrusters: ThrusterLayout
    wheels: WheelArray | None

    def _repr_html_(self) -> str:
        rows = {
            "mass (kg)": f"{self.mass:.4g}",
            "moments of inertia (kg m²)": " × ".join(
                f"{moment:.4g}" for moment in np.linalg.eigvalsh(self.inertia)
            ),
            "thrusters": f"{self.thrusters.count}, of {self.thrusters.forces.max():g} N at most",
            "thrust limit along each axis (N)": f"{self.config.thrust_limit_n:g}",
            "reaction wheels": 0 if self.wheels is None else len(self.wheels.axes),
        }
        return html_table(self.path.parent.name, rows)

    @property
    def noise(self) -> AttitudeNoise:
        """The noise of gyro and star tracker."""
        return AttitudeNoise.of(self.config.star_tracker, self.config.gyro)

    @property
    def bus_inertia(self) -> Matrix3:
        """The inertia (3, 3) without that of the wheels about their axes."""
        if self.wheels is None:
            return self.inertia
        return self.inertia - self.wheels.inertia * self.wheels.axes.T @ self.wheels.axes


@config
class RigidBodyConfig:
    """The spacecraft: a rigid body with thrusters, wheels, gyro and star tracker.

    A scenario chooses it with `spacecraft: !RigidBody {model: ...}`.
    """

    # Name of a model that ships with proxops, or path of its YAML file; a path in a scenario file
    # is relative to that file.
    model: str = "smallsat"
    # The mass over that of the model: 1 is the model's own.
    mass: float = number(1.0, at_least=1e-3, at_most=10.0)
    # Greatest speed per axis in the body-fixed frame. The MPC respects it; the plant does not
    # enforce it.
    speed_limit_m_s: float = number(40.0, at_least=1e-6, at_most=1e5, unit="m/s")
    # Greatest time from one measurement of the attitude to the next; thrusters and wheels are set
    # as often. The control period is divided into equal parts.
    attitude_period_s: float = number(1.0, at_least=1e-3, at_most=3600.0, unit="s")
    pointing: AttitudeGuidanceConfig = dc.field(default_factory=AttitudeGuidanceConfig)

    @property
    def mass_kg(self) -> float:
        """Mass in kg, as believed."""
        return self.mass * load_spacecraft(self.model).mass

    @mass_kg.setter
    def mass_kg(self, value: float) -> None:
        self.mass = value / load_spacecraft(self.model).mass

    @property
    def thrust_limit_n(self) -> float:
        """Greatest force in N that controllers may ask for along each axis."""
        return load_spacecraft(self.model).config.thrust_limit_n

    @property
    def specific_impulse_s(self) -> float:
        """Specific impulse in s of the data sheet."""
        return load_spacecraft(self.model).config.specific_impulse_s


def load_spacecraft(name_or_path: str) -> SpacecraftModel:
    """Loads the model that ships under a name ("smallsat") or that a YAML file describes.

    Raises:
      InputError: there is no such model; a file cannot be read; the bus has no mass, or an inertia
        that no body has; a wheel is no joint that turns; or the thrusters cannot give a force along
        an axis, or a torque about one.
    """
    path = file_of(name_or_path, _SHIPPED, "spacecraft.model")
    settings = _settings(path, last_change(path))
    return _made(path, last_change(path), last_change(path.parent / settings.bus))


@functools.lru_cache(maxsize=8)
def _settings(path: Path, changed: int) -> SpacecraftModelConfig:
    settings = load_typed(SpacecraftModelConfig, read_mapping(path), str(path))
    check_limits(settings, str(path))
    if settings.specular + settings.diffuse > 1.0:
        raise InputError(f"{path}: specular and diffuse must sum to at most 1")
    return settings


@functools.lru_cache(maxsize=8)
def _made(path: Path, changed: int, bus_changed: int) -> SpacecraftModel:
    """The model of a YAML file and its bus, both as they were when they were last changed."""
    settings = _settings(path, changed)
    rows = _thruster_rows(settings, path)
    if not settings.bus:
        raise InputError(f"{path}: bus must name a URDF or SDF file with mass and inertia")
    mass, centre, inertia, wheels = _read_bus(path.parent / settings.bus, settings.wheels)
    directions = rows[:, 3:6] / np.linalg.norm(rows[:, 3:6], axis=1)[:, None]
    try:
        layout = ThrusterLayout(
            rows[:, :3] - centre, directions, rows[:, 6], settings.least_on_time_s
        )
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    array = None
    if settings.wheels:
        axes, spin_inertia = wheels
        if np.linalg.matrix_rank(axes, tol=1e-6) < 3:
            raise InputError(f"{path}: the wheels' axes must span space, or leave out the wheels")
        array = WheelArray(
            axes, settings.wheel_torque_n_m, settings.wheel_momentum_n_m_s, spin_inertia
        )
    return SpacecraftModel(settings, path, mass, inertia, centre, layout, array)


def _thruster_rows(settings: SpacecraftModelConfig, path: Path) -> np.ndarray:
    """The thrusters (n, 7) of a file."""
    rows = settings.thrusters
    if not 0 < len(rows) <= _MOST_THRUSTERS:
        raise InputError(f"{path}: thrusters must be 1 to {_MOST_THRUSTERS} rows, got {len(rows)}")
    for k, row in enumerate(rows):
        good = len(row) == 7 and all(map(math.isfinite, row))
        if not good or not any(row[3:6]) or row[6] <= 0.0:
            raise InputError(
                f"{path}: thruster {k} needs seven numbers: place x, y, z in m, direction x, y, z, "
                f"and a force above 0 in N; got {row}"
            )
    return np.array(rows, dtype=np.float64)


class _Complaints(logging.Handler):
    """Keeps the first lines of what Drake's parser complains about."""

    def __init__(self):
        super().__init__(logging.WARNING)
        self.found: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Keeps a record."""
        self.found.append(record.getMessage().splitlines()[0])


def _read_bus(
    path: Path, joints: list[str]
) -> tuple[float, Vector3, Matrix3, tuple[np.ndarray, float]]:
    """Mass, centre of mass, inertia about it, and the wheels' axes (n, 3) and axial inertia."""
    # Slow to import, and only a rigid spacecraft needs it.
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import MultibodyPlant

    if not path.is_file():
        raise InputError(f"{path}, the bus of a spacecraft, does not exist")
    plant, complaints = MultibodyPlant(0.0), _Complaints()
    log = logging.getLogger("drake")
    log.addHandler(complaints)
    try:
        (model,) = Parser(plant).AddModels(str(path))
        plant.Finalize()
    except (RuntimeError, ValueError) as error:
        raise InputError(f"{path} cannot be read: {str(error).splitlines()[0]}") from error
    finally:
        log.removeHandler(complaints)
    if complaints.found:
        # Drake would go on with a mass and an inertia of its own.
        raise InputError(f"a mass or inertia that no body has: {complaints.found[0]}")
    context, bodies = plant.CreateDefaultContext(), plant.GetBodyIndices(model)
    root = plant.get_body(bodies[0])
    whole = plant.CalcSpatialInertia(context, root.body_frame(), bodies)
    mass = whole.get_mass()
    centre = whole.get_com()
    inertia = whole.Shift(centre).CalcRotationalInertia().CopyToFullMatrix3()
    axes, moments = [], []
    for name in joints:
        axis, moment = _wheel(plant, context, model, root, name, path)
        axes.append(axis)
        moments.append(moment)
    if moments and max(moments) > (1.0 + 1e-6) * min(moments):
        raise InputError(f"{path}: the wheels must have equal inertias about their axes")
    inertia = check_inertia(str(path), inertia)
    gyration = math.sqrt(float(np.linalg.eigvalsh(inertia)[2]) / mass)
    low, high = _GYRATION
    if not low < gyration < high:
        raise InputError(
            f"{path}: {mass:.4g} kg with these inertias lie {gyration:.3g} m about the centre in "
            "the mean: are they in kg, m and kg m^2?"
        )
    return mass, centre, inertia, (np.array(axes), moments[0] if moments else 0.0)


def _wheel(plant, context, model, root, name: str, path: Path) -> tuple[Vector3, float]:
    """Axis (3,) in the bus's frame and inertia about it of the wheel on a joint."""
    if not plant.HasJointNamed(name, model):
        raise InputError(f"{path} has no joint {name!r}, which the spacecraft has as a wheel")
    joint = plant.GetJointByName(name, model)
    if joint.type_name() != "revolute":
        raise InputError(f"{path}: joint {name!r} is {joint.type_name()}: a wheel turns freely")
    turn = joint.frame_on_parent().CalcRotationMatrix(context, root.body_frame())
    axis = turn.matrix() @ joint.revolute_axis()
    child = joint.child_body()
    inertia = child.default_spatial_inertia()
    central = inertia.Shift(inertia.get_com()).CalcRotationalInertia().CopyToFullMatrix3()
    own = joint.frame_on_child().CalcRotationMatrix(context, child.body_frame()).matrix()
    along = own @ joint.revolute_axis()
    return axis, float(along @ central @ along)
