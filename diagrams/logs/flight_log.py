"""`FlightLog`: one flight as an xarray dataset, stored as NetCDF-4; it suffices to repeat it."""

from __future__ import annotations

import typing
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from functools import cached_property
from pathlib import Path

import h5py
import numpy as np
import xarray as xr
from pydrake.common.yaml import yaml_dump_typed
from scipy.spatial.transform import Rotation

from proxops.diagrams.logs.flight_summary import summarise
from proxops.diagrams.scenario import (
    Body,
    BodyConfig,
    Scenario,
    TrueBody,
    TruthConfig,
    check_constants,
    dump_scenario,
    load_typed,
    make_true_body,
    parse_mapping,
    parse_scenario,
)
from proxops.systems.assurance import InterventionReason
from proxops.systems.common import InputError, interruption_waits, write_whole
from proxops.systems.expert import PlanReason, PlanStatus
from proxops.systems.hybrid import DecisionReason, FlownBy
from proxops.systems.navigation import NavigationPhase, ReturnUse
from proxops.systems.policy import PolicyStatus
from proxops.systems.shapes import Polyhedron

# Each column: its dimensions after time, its units and its long name.
VARIABLES: dict[str, tuple[tuple[str, ...], str, str]] = {
    "state": (("component",), "m; m/s", "position and velocity of the spacecraft in K"),
    "target": (("component",), "m; m/s", "commanded final position and velocity in K"),
    "force": (
        ("axis",),
        "N",
        "force that the thrusters are to give, in S, from force_delay_s after this time on",
    ),
    "mpc_force": (("axis",), "N", "the MPC's force in K; NaN where it was not asked"),
    "policy_force": (("axis",), "N", "the policy's force in K; NaN where there is none"),
    "disturbance": (("axis",), "N", "applied less commanded (or assured) force in S"),
    "intervention": ((), "N", "size of what runtime assurance changed the command by"),
    "intervention_reason": ((), "1", "why it did: see flag_meanings; NaN: the flight was over"),
    "assurance_margin": (
        (),
        "m",
        "least clearance of the command and the backup after it; negative: the command is not safe",
    ),
    "assurance_position": ((), "m", "error of the position that runtime assurance allows for"),
    "assurance_velocity": ((), "m/s", "error of the velocity that it allows for"),
    "thrust": (("axis",), "N", "force that the thrusters truly give, along their own axes"),
    "mass": ((), "kg", "true mass of the spacecraft"),
    "attitude": (("quaternion",), "1", "true rotation of S against K: unit quaternion w, x, y, z"),
    "kick": (("axis",), "m/s^2", "acceleration by a kick from this time on, until the next, in K"),
    "decision": ((), "1", "flown by: 0 the controller named, 1 the MPC, 2 the policy"),
    "decision_reason": ((), "1", "why it is flown so: see flag_meanings; NaN: nothing was decided"),
    "agreement": ((), "1", "1 if the policy's force agrees with the MPC's; NaN: not compared"),
    "force_difference": ((), "N", "size of the difference of both forces; NaN: not compared"),
    "force_angle": ((), "rad", "angle that the gate compares; NaN: not compared, or a zero force"),
    "check_clearance": ((), "m", "distance to the keep-out ellipsoid at a check; NaN: no check"),
    "steps_to_check": ((), "1", "control steps from this one to the next check"),
    "decision_time": ((), "s", "wall time of comparing and deciding"),
    "solve_time": ((), "s", "wall time of the MPC's step; NaN where it was not asked"),
    "solve_status": ((), "1", "0 solved, 1 last plan continued, 2 braking; NaN: not asked"),
    "solve_reason": ((), "1", "why the MPC did so: see flag_meanings; NaN: not asked"),
    "policy_time": ((), "s", "wall time of the policy's network; NaN where it was not asked"),
    "policy_status": ((), "1", "0 answered, 1 not finite: no force; NaN: not asked"),
    "estimate": (("component",), "m; m/s", "the policy's estimate of the state in K; NaN: none"),
    "navigation_state": (
        ("component",),
        "m; m/s",
        "position and velocity in K as the navigation knows them; NaN: it has none",
    ),
    "navigation_attitude": (
        ("quaternion",),
        "1",
        "rotation of S against K as the navigation knows it: unit quaternion w, x, y, z",
    ),
    "navigation_covariance": (
        ("known", "known_with"),
        "m, m/s, rad",
        "covariance of navigation_state and of the rotation vector of S in K, as it is known",
    ),
    "navigation_residual": (
        (),
        "m",
        "rms of what is left of the ranges after a step of navigation",
    ),
    "navigation_returns": ((), "1", "lidar returns that the navigation used"),
    "navigation_rejected": ((), "1", "lidar returns that it rejected"),
    "navigation_innovation": ((), "1", "normalised innovation squared over the returns used"),
    "navigation_phase": ((), "1", "what the navigation does: see flag_meanings"),
    "navigation_return_use": (
        ("plane", "ray"),
        "1",
        "what the navigation made of each return: see flag_meanings",
    ),
    "ranges": (("plane", "ray"), "m", "lidar ranges as received; +inf where nothing returned"),
}
# The codes of a column, written as flag_values and flag_meanings after the CF conventions.
_FLAGS: dict[str, type[IntEnum]] = {
    "solve_status": PlanStatus,
    "solve_reason": PlanReason,
    "policy_status": PolicyStatus,
    "decision_reason": DecisionReason,
    "intervention_reason": InterventionReason,
    "navigation_phase": NavigationPhase,
    "navigation_return_use": ReturnUse,
}
DECISION_VARIABLES = (
    "decision_reason", "agreement", "force_difference", "force_angle", "check_clearance",
    "steps_to_check", "decision_time",
)  # fmt: skip
"""Columns of `HybridSelector`'s record."""
NAVIGATION_VARIABLES = (
    "navigation_residual", "navigation_returns", "navigation_rejected", "navigation_innovation",
    "navigation_phase",
)  # fmt: skip
"""Columns of the navigation's record."""
RECORDS = {
    "mpc_record": ("solve_time", "solve_status", "solve_reason"),
    "policy_record": ("policy_time", "policy_status"),
    "decision_record": DECISION_VARIABLES,
    "intervention_record": ("intervention", "intervention_reason"),
    "assurance_record": ("assurance_margin", "assurance_position", "assurance_velocity"),
    "navigation_record": NAVIGATION_VARIABLES,
}
"""The columns into which a logged record is split, by the name of the record."""
CONTROLLER_COLUMNS = {
    "mpc_force": 3, "mpc_record": 3, "policy_force": 3, "policy_record": 2, "estimate": 6,
    "decision": 1, "decision_record": len(DECISION_VARIABLES),
}  # fmt: skip
"""Sizes of the controllers' ports that the log knows, by the names of their columns."""
# A file without the needed variables is not a log. The optional ones may be missing: frames need
# not be logged, the oldest logs have no reasons, and not every flight has kicks, a policy with an
# estimate, a hybrid's decisions, runtime assurance, a navigation, or a world that differs from what
# is believed.
_POLICY_VARIABLES = ("policy_time", "policy_status", "estimate")
_ASSURANCE_VARIABLES = (
    "intervention", "intervention_reason", "assurance_margin", "assurance_position",
    "assurance_velocity",
)  # fmt: skip
_TRUE_VARIABLES = ("thrust", "mass", "attitude")
NAVIGATION_COLUMNS = (
    "navigation_state", "navigation_attitude", "navigation_covariance", *NAVIGATION_VARIABLES,
)  # fmt: skip
"""Columns of a flight with a navigation: all of them, or none."""
_OPTIONAL_VARIABLES = (
    "ranges", "navigation_return_use", "solve_reason", "kick", *_TRUE_VARIABLES, *_POLICY_VARIABLES,
    *DECISION_VARIABLES, *_ASSURANCE_VARIABLES, *NAVIGATION_COLUMNS,
)  # fmt: skip
_NEEDED_VARIABLES = ["time", *(name for name in VARIABLES if name not in _OPTIONAL_VARIABLES)]
_NEEDED_VARIABLES += ["mesh_vertices", "mesh_facets"]
_NEEDED_ATTRIBUTES = ["scenario", "body", "controller", "shape_sha256", "arrival_time_s"]
_NEEDED_ATTRIBUTES += ["collided", "keep_out_violations", "wall_s", "scenario_sha256"]
# Frames: most of their values are the same.
_PACKED = ("ranges", "navigation_return_use")
# Attributes with the hashes of the networks that flew.
_NETWORKS = ("policy_sha256", "lidar_sha256")
# Attributes that say how a flight ended.
_OUTCOMES = ("arrival_time_s", "collided", "keep_out_violations")
_TEXTS = ("scenario", "body", "controller", "shape_sha256", "scenario_sha256")
_NUMBERS = (*_OUTCOMES, "wall_s", "force_delay_s")
# Variables that are finite in every row, and the greatest size of their values, in SI.
_FINITE = ("time", "state", "target", "force")
_LARGEST = 1e15
# No flight fills so many bytes.
_LARGEST_LOG = 2**34
_WALL_TIMES = {"solve_time", "policy_time", "decision_time"}
RESERVED_COLUMNS = {
    *VARIABLES, *RECORDS, "time", "command", "position_inertial",
    "velocity_inertial", "mesh_vertices", "mesh_facets", "true_vertices", "true_facets",
    "component", "axis", "plane", "ray", "quaternion", "known", "known_with", "vertex", "facet",
    "true_vertex", "true_facet", "corner",
}  # fmt: skip
"""Names that a user's controller cannot give to its columns."""
COORDINATES = {
    "component": ["x", "y", "z", "vx", "vy", "vz"],
    "axis": ["x", "y", "z"],
}
_SIZES = {name: len(labels) for name, labels in COORDINATES.items()}
# Sizes of dimensions that not every log has.
_SIZES_IF_THERE = {"quaternion": 4, "known": 9, "known_with": 9}


@dataclass
class FlightLog:
    """The log of one flight.

    `dataset` has the dimension `time` and the variables of `VARIABLES`; its last row is the end of
    the flight. Vectors are in the body-fixed frame K, but `force` and `disturbance` are along the
    spacecraft's axes S and `thrust` along those of the thrusters. `position_inertial` and
    `velocity_inertial` are the same motion in the inertial frame that coincides with K at time 0.

    The force of row k acts from `force_delay_s` after the time of row k until `force_delay_s` after
    the time of row k + 1. No force acts before the first. This global attribute is the `delay` of
    the controller, as the MPC has one with `mpc.solve_delay_s`, and 0 for one without; it may be
    missing, which means 0.

    The frame of row k is the one that was received then. With `truth.lidar.latency_steps` it was
    measured so many rows earlier.

    Other global attributes hold the scenario, the body's constants, the package version and the
    shape's hash. `mesh_vertices` and `mesh_facets` hold the body's mesh as believed, the map;
    `true_vertices` and `true_facets` hold the true one, if it is another.
    """

    dataset: xr.Dataset
    body: Body = field(repr=False)

    @property
    def scenario(self) -> Scenario:
        """The scenario of the flight."""
        return parse_scenario(self.dataset.attrs["scenario"], "the log's scenario")

    def __getstate__(self) -> dict[str, typing.Any]:
        """Gives what a copy is made from: the fields, without what was computed from them."""
        return {"dataset": self.dataset, "body": self.body}

    @cached_property
    def true_body(self) -> TrueBody:
        """The body as it was in the flight; it is made at the first use."""
        data, shape = self.dataset, self.body.shape
        if "true_vertices" in data:
            shape = Polyhedron(data["true_vertices"].values, data["true_facets"].values, "true")
        return make_true_body(self.body, self.scenario.truth, shape)

    @cached_property
    def differing_body(self) -> TrueBody | None:
        """The body as it was, if its surface or its spin axis is not as believed; else None."""
        truth = self.scenario.truth
        axis_differs = truth.density_contrast != 0.0 or any(truth.pole_deg)
        return self.true_body if "true_vertices" in self.dataset or axis_differs else None

    @property
    def summary(self) -> dict[str, typing.Any]:
        """The figures of merit that `summary.json` holds."""
        return summarise(self.dataset, self.scenario, self.body)

    def to_netcdf(self, path: str | Path) -> None:
        """Writes the log; the file appears under its name only when it is complete.

        Raises:
          InputError: the folder does not exist or cannot be written.
        """
        # Shuffled and deflated, frames take a tenth of the space, because most rays have no return.
        packed = {"zlib": True, "complevel": 1, "shuffle": True}
        encoding = {name: packed for name in _PACKED if name in self.dataset}
        # The file is made in memory, because on a full disk HDF5 ends the process without an error.
        with interruption_waits():
            content = self.dataset.to_netcdf(engine="h5netcdf", encoding=encoding)
            write_whole(Path(path), lambda name: name.write_bytes(content))

    @classmethod
    def load(cls, path: str | Path) -> FlightLog:
        """Reads a log into memory.

        Raises:
          InputError: the file does not exist, is not a flight log, or is damaged.
        """
        if not Path(path).exists():
            raise InputError(f"there is no file {path}")
        if Path(path).is_dir():
            raise InputError(f"{path} is not a flight log: it is a folder; give its flight.nc")
        check_log_file(path)
        try:
            with interruption_waits():
                dataset = xr.load_dataset(path, engine="h5netcdf")
        except Exception as error:  # Damaged files raise errors of many types.
            raise InputError(f"{path} is not a flight log: {error}") from error
        missing = [name for name in _NEEDED_VARIABLES if name not in dataset.variables]
        missing += [name for name in _NEEDED_ATTRIBUTES if name not in dataset.attrs]
        if missing:
            raise InputError(f"{path} is not a flight log: it has no {', '.join(missing)}")
        wrong = _wrong_entries(dataset)
        if wrong:
            raise InputError(f"{path} is not a flight log: it has wrong {', '.join(wrong)}")
        try:
            config = load_typed(
                BodyConfig, parse_mapping(dataset.attrs["body"], str(path)), str(path)
            )
            check_constants(config, "its body")
            with np.errstate(all="ignore"):  # Damaged numbers may overflow before they are refused.
                shape = Polyhedron(
                    dataset["mesh_vertices"].values, dataset["mesh_facets"].values, name=config.mesh
                )
                if "true_vertices" in dataset:
                    Polyhedron(dataset["true_vertices"].values, dataset["true_facets"].values)
        except Exception as error:
            raise InputError(f"{path} is damaged: {error}") from error
        if shape.sha256 != dataset.attrs["shape_sha256"]:
            raise InputError(f"{path}: the mesh does not match its hash; the file is damaged")
        return cls(dataset, Body(config, shape))


def check_log_file(path: str | Path) -> None:
    """Raises `InputError` unless a log holds all its data itself, in a size that fits a flight.

    HDF5 can take data from any other file, and a few bytes of it can stand for an array of any
    size.
    """
    try:
        with interruption_waits(), h5py.File(path, "r") as file:
            fault = _foreign_data(file)
    except Exception as error:  # Damaged files raise errors of many types.
        raise InputError(f"{path} is not a flight log: {error}") from error
    if fault is not None:
        raise InputError(f"{path} is not a flight log: {fault}")


def _foreign_data(file: h5py.File) -> str | None:
    """Says what a file takes from elsewhere, or that it stands for too much; None: neither."""
    size = 0
    for name in file:
        if not isinstance(file.get(name, getlink=True), h5py.HardLink):
            return f"{name} is a link"
        entry = file[name]
        if isinstance(entry, h5py.Dataset):
            if entry.external or entry.is_virtual:
                return f"{name} is in another file"
            size += entry.nbytes
    return f"it holds {size / 1e9:.0f} GB" if size > _LARGEST_LOG else None


def _wrong_entries(data: xr.Dataset) -> list[str]:
    """Lists the variables and attributes whose types, dimensions or values no flight gives."""
    schema = {"time": (), **{name: dimensions for name, (dimensions, _, _) in VARIABLES.items()}}
    wrong = [
        name
        for name, dimensions in schema.items()
        if name in data.variables
        and (data[name].dims != ("time", *dimensions) or data[name].dtype.kind not in "fiub")
    ]
    wrong += [name for name, size in _SIZES.items() if data.sizes.get(name) != size]
    wrong += [name for name, n in _SIZES_IF_THERE.items() if data.sizes.get(name, n) != n]
    there = [name in data.variables for name in NAVIGATION_COLUMNS]
    if any(there):
        pairs = zip(NAVIGATION_COLUMNS, there, strict=True)
        wrong += [name for name, found in pairs if not found]
    wrong += [name for name in _TEXTS if not isinstance(data.attrs[name], str)]
    numbers = [name for name in _NUMBERS if name in data.attrs]
    wrong += [name for name in numbers if not isinstance(data.attrs[name], float | int | np.number)]
    if wrong:
        return wrong
    wrong = [name for name in _FINITE if not (np.abs(data[name].values) <= _LARGEST).all()]
    if "time" not in wrong and not (data.sizes["time"] and _increases(data["time"].values)):
        wrong.append("time")
    if not np.isin(data["decision"].values, list(FlownBy)).all():
        wrong.append("decision")
    for name, codes in _FLAGS.items():
        if name in data:
            values = data[name].values
            if not (np.isnan(values) | np.isin(values, list(codes))).all():
                wrong.append(name)
    wrong += [name for name in ("collided", "keep_out_violations") if not _counts(data.attrs[name])]
    return wrong


def _increases(values: np.ndarray) -> bool:
    return bool((np.diff(values) > 0.0).all())


def _counts(value: typing.Any) -> bool:
    return bool(np.isfinite(value)) and value >= 0


def make_dataset(
    columns: dict[str, np.ndarray],
    times: np.ndarray,
    scenario: Scenario,
    body: Body,
    attributes: dict[str, typing.Any],
    own: Mapping[str, tuple[str, str]] | None = None,
    true_body: TrueBody | None = None,
) -> xr.Dataset:
    """Makes the dataset of a log.

    Args:
      columns: arrays (N, ...) whose first axis is time, by their names.
      times: (N,) in s.
      scenario: the scenario of the flight.
      body: the body of the flight, as believed.
      attributes: attributes of the flight; those of the scenario and the body are added.
      own: units and descriptions of columns that are not in `VARIABLES`, by their names.
      true_body: the body as it was; None: as believed.
    """
    true_body = true_body or make_true_body(body, TruthConfig())
    data: dict[str, typing.Any] = {}
    for name, (dimensions, units, long_name) in VARIABLES.items():
        if name in columns:
            notes: dict[str, typing.Any] = {"units": units, "long_name": long_name}
            if name in _FLAGS:
                notes["flag_values"] = np.array([*_FLAGS[name]], dtype=columns[name].dtype)
                notes["flag_meanings"] = " ".join(flag.name.lower() for flag in _FLAGS[name])
            data[name] = (("time", *dimensions), columns[name], notes)
    for name, (units, description) in (own or {}).items():
        values = columns[name]
        dimensions = ("time",) if values.ndim == 1 else ("time", f"{name}_component")
        data[name] = (dimensions, values, {"units": units, "long_name": description})
    position, velocity = inertial_motion(
        times, columns["state"], true_body.spin, true_body.axis_point
    )
    note = "in the non-turning frame that is K at time 0"
    data["position_inertial"] = (
        ("time", "axis"), position, {"units": "m", "long_name": f"position {note}"},
    )  # fmt: skip
    data["velocity_inertial"] = (
        ("time", "axis"), velocity, {"units": "m/s", "long_name": f"velocity {note}"},
    )  # fmt: skip
    data |= _mesh("mesh", "", body.shape)
    if true_body.shape is not body.shape:
        data |= _mesh("true", "true_", true_body.shape)
    time = ("time", times, {"units": "s", "long_name": "time since the start of the flight"})
    return xr.Dataset(
        data,
        coords={"time": time, **COORDINATES},
        attrs={
            "title": f"proxops flight near {body.config.name}",
            "scenario": dump_scenario(scenario),
            "body": yaml_dump_typed(body.config, schema=BodyConfig),
            "shape_sha256": body.shape.sha256,
            **attributes,
        },
    )


def _mesh(name: str, dimension: str, shape: Polyhedron) -> dict[str, typing.Any]:
    """Gives the variables of a mesh; `dimension` begins the names of their dimensions."""
    return {
        f"{name}_vertices": (
            (f"{dimension}vertex", "axis"), shape.vertices,
            {"units": "m", "long_name": f"vertices of the body's {dimension and 'true '}mesh in K"},
        ),
        f"{name}_facets": (
            (f"{dimension}facet", "corner"), shape.facets.astype(np.int32),
            {"units": "1", "long_name": f"facets as indices into {name}_vertices, wound outwards"},
        ),
    }  # fmt: skip


def commanded_forces(force: np.ndarray, disturbance: np.ndarray, limit: float) -> np.ndarray:
    """The commands (N, 3) in N of logged forces, without what disturbed them.

    The difference is rounded, so it may exceed the thrust limit by a last bit; the commands do not.
    """
    return np.clip(force - disturbance, -limit, limit)


def inertial_motion(
    times: np.ndarray, states: np.ndarray, spin: np.ndarray, axis_point: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Computes the motion in the inertial frame that coincides with K at time 0.

    Args:
      times: (N,) in s.
      states: (N, 6), position in m and velocity in m/s in K.
      spin: angular velocity (3,) in K in rad/s.
      axis_point: (3,) in K in m, a point of the spin axis, which is at rest in the inertial frame.

    Returns:
      Position (N, 3) in m and velocity (N, 3) in m/s.
    """
    arms = states[:, :3] - axis_point
    velocity = states[:, 3:] + np.cross(spin, arms)
    if spin[:2].any() or axis_point.any():
        turn = Rotation.from_rotvec(times[:, None] * spin)
        return axis_point + turn.apply(arms), turn.apply(velocity)
    spin_rate = spin[2]
    cos, sin = np.cos(spin_rate * times), np.sin(spin_rate * times)

    def turned(vector: np.ndarray) -> np.ndarray:
        x, y, z = vector.T
        return np.stack([cos * x - sin * y, sin * x + cos * y, z], axis=1)

    return turned(arms), turned(velocity)


def differences(first: FlightLog, second: FlightLog) -> list[str]:
    """Lists the variables, networks and outcomes in which two logs differ by any bit.

    Wall times are not compared.
    """
    one, other = first.dataset, second.dataset
    names = sorted(({*map(str, one.variables)} | {*map(str, other.variables)}) - _WALL_TIMES)
    changed = [
        name
        for name in names
        if name not in one
        or name not in other
        or one[name].dtype != other[name].dtype
        or not one[name].identical(other[name])
    ]
    changed += [name for name in _NETWORKS if one.attrs.get(name) != other.attrs.get(name)]
    return changed + [
        name
        for name in _OUTCOMES
        if not np.array_equal(one.attrs[name], other.attrs[name], equal_nan=True)
    ]
