"""`FlightLog`: one flight as an xarray dataset, stored as NetCDF-4; it suffices to repeat it."""

from __future__ import annotations

import hashlib
import typing
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
import xarray as xr
from scipy.spatial.transform import Rotation

from proxops.diagrams.logs.columns import (
    COORDINATES,
    DERIVED,
    OUTCOMES,
    SURVEY,
    VARIABLES,
    WALL_TIMES,
    Column,
)
from proxops.diagrams.logs.flight_summary import summarise
from proxops.diagrams.logs.log_file_checks import (
    check_log_file,
    missing_entries,
    wrong_entries,
)
from proxops.diagrams.scenario import (
    Body,
    BodyConfig,
    Scenario,
    TrueBody,
    TruthConfig,
    check_constants,
    dump_scenario,
    make_true_body,
    parse_scenario,
)
from proxops.diagrams.yaml_files import dump_typed, load_typed, parse_mapping
from proxops.systems.common import (
    InputError,
    States,
    Values,
    Vector3,
    Vectors3,
    html_table,
    write_whole,
)
from proxops.systems.rotation import SpinModel, TorqueFreeSpin
from proxops.systems.shapes import Polyhedron

# Frames: most of their values are the same.
_PACKED = ("ranges", "navigation_return_use", *SURVEY)
# Attributes with the hashes of the networks that flew.
_NETWORKS = ("policy_sha256", "lidar_sha256")


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
    measured that number of rows earlier.

    The log of a mission has its survey too: columns `SURVEY`, over `survey_time`. K is that of the
    map, though the survey did not know it. Only returns are kept, not rays without one.

    Other global attributes hold the scenario, the body's constants, the package version and the
    shape's hash. `mesh_vertices` and `mesh_facets` hold the body's mesh as believed, the map;
    `true_vertices` and `true_facets` hold the true one, if it is another; `moon_0_vertices` and
    `moon_0_facets` that of the first moon, in its own axes, if it has one, and so on.
    """

    dataset: xr.Dataset
    body: Body = field(repr=False)

    @property
    def scenario(self) -> Scenario:
        """The scenario of the flight."""
        return parse_scenario(self.dataset.attrs["scenario"], "the log's scenario")

    def _repr_html_(self) -> str:
        found = self.summary
        rows = {
            "success": found["success"],
            "arrival (s)": found["arrival_time_s"],
            "Δv (m/s)": found["delta_v_m_s"],
            "end error (m)": found["terminal_position_error_m"],
            "least clearance of the keep-out ellipsoid (m)": found["min_clearance_m"],
            "keep-out violations": found["keep_out_violations"],
            "flown by the policy (share)": found["policy_share"],
            "navigation off, median (m)": found.get("navigation_position_error_m_median"),
        }
        texts = {name: f"{value:.4g}" if isinstance(value, float) else value
                 for name, value in rows.items() if value is not None}  # fmt: skip
        title = f"{self.body.config.name}, {found['controller']}, transit {found['transit']}"
        return html_table(f"{title} of seed {found['seed']}", texts)

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
        """The body as it was, if it tumbles or surface or axis are not as believed; else None."""
        truth = self.scenario.truth
        differs = truth.density_contrast != 0.0 or any(truth.pole_deg) or truth.tumbles
        differs = differs or isinstance(self.body.spin, TorqueFreeSpin)
        return self.true_body if "true_vertices" in self.dataset or differs else None

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
            dataset = xr.load_dataset(path, engine="h5netcdf")
        except Exception as error:  # Damaged files raise errors of many types.
            raise InputError(f"{path} is not a flight log: {error}") from error
        missing = missing_entries(dataset)
        if missing:
            raise InputError(f"{path} is not a flight log: it has no {', '.join(missing)}")
        wrong = wrong_entries(dataset)
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
                moons = tuple(
                    Polyhedron(
                        dataset[f"moon_{number}_vertices"].values,
                        dataset[f"moon_{number}_facets"].values,
                        name=moon.mesh,
                    )
                    if moon.mesh
                    else None
                    for number, moon in enumerate(config.moons)
                )
        except Exception as error:
            raise InputError(f"{path} is damaged: {error}") from error
        if shape.sha256 != dataset.attrs["shape_sha256"]:
            raise InputError(f"{path}: the mesh does not match its hash; the file is damaged")
        return cls(dataset, Body(config, shape, moon_shapes=moons))


def make_dataset(
    columns: dict[str, np.ndarray],
    times: Values,
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
    for name, column in VARIABLES.items():
        if name in columns:
            data[name] = _variable(column, columns[name])
    for name, (units, description) in (own or {}).items():
        dimensions = () if columns[name].ndim == 1 else (f"{name}_component",)
        data[name] = _variable(Column(dimensions, units, description), columns[name])
    motion = inertial_motion(times, columns["state"], true_body.spin, true_body.axis_point)
    for (name, column), values in zip(DERIVED.items(), motion, strict=True):
        data[name] = _variable(column, values)
    data |= _mesh("mesh", "", body.shape)
    if true_body.shape is not body.shape:
        data |= _mesh("true", "true_", true_body.shape)
    for number, shape in enumerate(body.moon_shapes):
        if shape is not None:
            data |= _mesh(f"moon_{number}", f"moon_{number}_", shape)
    time = ("time", times, {"units": "s", "long_name": "time since the start of the flight"})
    text = dump_scenario(scenario)
    return xr.Dataset(
        data,
        coords={"time": time, **COORDINATES},
        attrs={
            "title": f"proxops flight near {body.config.name}",
            "scenario": text,
            "scenario_sha256": hashlib.sha256(text.encode()).hexdigest(),
            "body": dump_typed(body.config, BodyConfig()),
            "shape_sha256": body.shape.sha256,
            **attributes,
        },
    )


def with_survey(log: FlightLog, columns: dict[str, np.ndarray]) -> FlightLog:
    """The log of a mission: that of its last flight, and all columns of `SURVEY` beside."""
    data: dict[str, typing.Any] = {}
    for name, column in SURVEY.items():
        _, values, notes = _variable(column, columns[name])
        data[name] = column.dimensions, values, notes
    return FlightLog(log.dataset.assign(data), log.body)


def _variable(
    column: Column, values: np.ndarray
) -> tuple[tuple[str, ...], np.ndarray, dict[str, typing.Any]]:
    """Gives a variable of the dataset: dimensions, values (N, ...) and attributes."""
    # A unit of several parts is none after the CF conventions, so it has a name of its own.
    unit = "units" if ";" not in column.units else "units_of_components"
    notes: dict[str, typing.Any] = {unit: column.units, "long_name": column.long_name}
    if column.codes is not None:
        notes["flag_values"] = np.array([*column.codes], dtype=values.dtype)
        notes["flag_meanings"] = " ".join(code.name.lower() for code in column.codes)
    return ("time", *column.dimensions), values, notes


def _mesh(name: str, dimension: str, shape: Polyhedron) -> dict[str, typing.Any]:
    """Gives the variables of a mesh; `dimension` begins the names of their dimensions."""
    what = f"vertices of the body's {dimension and 'true '}mesh in K"
    if name.startswith("moon"):
        what = "vertices of a moon's mesh in its own axes"
    return {
        f"{name}_vertices": (
            (f"{dimension}vertex", "axis"), shape.vertices, {"units": "m", "long_name": what},
        ),
        f"{name}_facets": (
            (f"{dimension}facet", "corner"), shape.facets.astype(np.int32),
            {"units": "1", "long_name": f"facets as indices into {name}_vertices, wound outwards"},
        ),
    }  # fmt: skip


def commanded_forces(force: np.ndarray, disturbance: np.ndarray, limit: float) -> Vectors3:
    """The commands (N, 3) in N of logged forces, without what disturbed them.

    The difference is rounded, so it may exceed the thrust limit by a last bit; the commands do not.
    """
    return np.clip(force - disturbance, -limit, limit)


def inertial_motion(
    times: Values, states: States, spin: SpinModel, axis_point: Vector3
) -> tuple[np.ndarray, np.ndarray]:
    """Computes the motion in the inertial frame that coincides with K at time 0.

    Args:
      times: (N,) in s.
      states: (N, 6), position in m and velocity in m/s in K.
      spin: of the body. axis_point: (3,) in K in m, a point of its axis, which is at rest.

    Returns:
      Position (N, 3) in m and velocity (N, 3) in m/s.
    """
    arms = states[:, :3] - axis_point
    velocity = states[:, 3:] + np.cross(spin.angular_velocity(times), arms)
    if not spin.about_z or axis_point.any():
        quaternions = np.array([spin.attitude(time) for time in times.tolist()])
        turn = Rotation.from_quat(quaternions, scalar_first=True)
        return axis_point + turn.apply(arms), turn.apply(velocity)
    spin_rate = spin.rate[2]
    cos, sin = np.cos(spin_rate * times), np.sin(spin_rate * times)

    def turned(vector: np.ndarray) -> np.ndarray:
        x, y, z = vector.T
        return np.stack([cos * x - sin * y, sin * x + cos * y, z], axis=1)

    return turned(arms), turned(velocity)


def differences(first: FlightLog, second: FlightLog) -> list[str]:
    """Lists the variables, networks and outcomes in which two logs differ by any bit.

    Wall times are not compared, nor a survey, which is another flight.
    """
    one, other = first.dataset, second.dataset
    names = {*map(str, one.variables)} | {*map(str, other.variables)}
    names = sorted(names - {*WALL_TIMES, *SURVEY})
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
        for name in OUTCOMES
        if not np.array_equal(one.attrs[name], other.attrs[name], equal_nan=True)
    ]
