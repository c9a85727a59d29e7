"""The record of one flight: an xarray dataset that is enough to repeat it, kept as NetCDF-4."""

from __future__ import annotations

import os
import tempfile
import typing
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import xarray as xr
from pydrake.common.yaml import yaml_dump_typed, yaml_load

from proxops.diagrams.body import Body, BodyConfig
from proxops.diagrams.scenario import Scenario, dump_scenario, load_typed, parse_scenario
from proxops.systems.ellipsoid import clearances
from proxops.systems.errors import InputError
from proxops.systems.polyhedron import Polyhedron

if typing.TYPE_CHECKING:
    from matplotlib.figure import Figure

# name: (dimensions after time, units, long name)
VARIABLES: dict[str, tuple[tuple[str, ...], str, str]] = {
    "state": (("component",), "m; m/s", "position and velocity of the spacecraft in K"),
    "target": (("component",), "m; m/s", "commanded final position and velocity in K"),
    "force": (("axis",), "N", "force applied from this time on, until the next, in K"),
    "mpc_force": (("axis",), "N", "the MPC's force in K; NaN where it was not asked"),
    "policy_force": (("axis",), "N", "the policy's force in K; NaN where there is none"),
    "disturbance": (("axis",), "N", "applied less commanded force in K"),
    "decision": ((), "1", "who flies: 0 the controller named, 1 the MPC, 2 the policy"),
    "solve_time": ((), "s", "wall time of the MPC's step; NaN where it was not asked"),
    "solve_status": ((), "1", "0 solved, 1 last plan flown on, 2 braking; NaN: not asked"),
    "ranges": (("plane", "ray"), "m", "lidar ranges; +inf where nothing returned"),
}
COORDINATES = {
    "component": ["x", "y", "z", "vx", "vy", "vz"],
    "axis": ["x", "y", "z"],
}

# A keep-out violation is deeper than this (m).
KEEP_OUT_TOLERANCE = 1.0
# The pure policy, which sees nothing but lidar, is also judged at this radius (m, m/s).
WIDE_ARRIVAL = (2.0e3, 2.0)
# Samples between two rows when the least clearance is sought.
_SUBSTEPS = 10


@dataclass
class FlightLog:
    """One flight. `dataset` has the dimension `time` and the variables of `VARIABLES`.

    All vectors are in the body-fixed frame K; `position_inertial` and `velocity_inertial` are the
    same motion seen from the frame that coincides with K at time 0 and does not turn. The last
    row is the end of the flight. Global attributes hold the scenario, the body's constants, the
    package version and the shape's hash; the body's mesh is in `mesh_vertices`, `mesh_facets`.
    """

    dataset: xr.Dataset
    body: Body = field(repr=False)

    @property
    def scenario(self) -> Scenario:
        """The scenario that was flown."""
        return parse_scenario(self.dataset.attrs["scenario"], "the log's scenario")

    @property
    def summary(self) -> dict[str, typing.Any]:
        """The figures of merit, as DESIGN's `summary.json` names them."""
        return summarise(self)

    def to_netcdf(self, path: str | Path) -> None:
        """Writes the log; the file appears under its name only when it is whole.

        Raises:
          InputError: the folder does not exist or cannot be written.
        """
        # Shuffled, lightly deflated ranges take a tenth of the room: most rays return nothing.
        packed = {"zlib": True, "complevel": 1, "shuffle": True}
        encoding = {name: packed for name in ("ranges",) if name in self.dataset}
        write_whole(
            Path(path),
            lambda name: self.dataset.to_netcdf(name, engine="h5netcdf", encoding=encoding),
        )

    @classmethod
    def load(cls, path: str | Path) -> FlightLog:
        """Reads a log back, into memory.

        Raises:
          InputError: not a flight log, or the mesh in it is not the one its hash names.
        """
        try:
            dataset = xr.load_dataset(path, engine="h5netcdf")
        except (OSError, ValueError, KeyError) as error:
            raise InputError(f"{path} is not a flight log: {error}") from error
        missing = [name for name in ("state", "mesh_vertices") if name not in dataset]
        missing += [name for name in ("scenario", "body", "controller") if name not in dataset.attrs]
        if missing:
            raise InputError(f"{path} is not a flight log: it has no {', '.join(missing)}")
        config = load_typed(BodyConfig, yaml_load(data=dataset.attrs["body"]), str(path))
        shape = Polyhedron(
            dataset["mesh_vertices"].values, dataset["mesh_facets"].values, name=config.mesh
        )
        if shape.sha256 != dataset.attrs["shape_sha256"]:
            raise InputError(f"{path}: the mesh does not match its hash; the file is damaged")
        return cls(dataset, Body(config, shape))

    def plot(self) -> Figure:
        """Path, distance to the goal, speed, force and clearance over time, as one figure."""
        from proxops.diagrams.plots import plot_flight  # matplotlib only when it is wanted

        return plot_flight(self)


def make_dataset(
    columns: dict[str, np.ndarray],
    times: np.ndarray,
    scenario: Scenario,
    body: Body,
    attributes: dict[str, typing.Any],
) -> xr.Dataset:
    """The dataset of a log from its columns, arrays whose first axis is time."""
    data: dict[str, typing.Any] = {}
    for name, (dimensions, units, long_name) in VARIABLES.items():
        if name in columns:
            notes = {"units": units, "long_name": long_name}
            data[name] = (("time", *dimensions), columns[name], notes)
    position, velocity = inertial_motion(times, columns["state"], body.spin_rate)
    note = "in the non-turning frame that is K at time 0"
    data["position_inertial"] = (
        ("time", "axis"), position, {"units": "m", "long_name": f"position {note}"},
    )  # fmt: skip
    data["velocity_inertial"] = (
        ("time", "axis"), velocity, {"units": "m/s", "long_name": f"velocity {note}"},
    )  # fmt: skip
    data["mesh_vertices"] = (
        ("vertex", "axis"), body.shape.vertices,
        {"units": "m", "long_name": "vertices of the body's mesh in K"},
    )  # fmt: skip
    data["mesh_facets"] = (
        ("facet", "corner"), body.shape.facets.astype(np.int32),
        {"units": "1", "long_name": "facets as indices into mesh_vertices, wound outwards"},
    )  # fmt: skip
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


def inertial_motion(
    times: np.ndarray, states: np.ndarray, spin_rate: float
) -> tuple[np.ndarray, np.ndarray]:
    """Position and velocity (N, 3) in the non-turning frame that is K at time 0.

    Args:
      times: (N,) in s. states: (N, 6), position and velocity in K. spin_rate: rad/s about z.
    """
    cos, sin = np.cos(spin_rate * times), np.sin(spin_rate * times)

    def turned(vector: np.ndarray) -> np.ndarray:
        x, y, z = vector.T
        return np.stack([cos * x - sin * y, sin * x + cos * y, z], axis=1)

    position = states[:, :3]
    spin = np.array([0.0, 0.0, spin_rate])
    return turned(position), turned(states[:, 3:] + np.cross(spin, position))


def dense_positions(times: np.ndarray, states: np.ndarray) -> np.ndarray:
    """Positions (M, 3) along the path, ten a row: cubic Hermite through positions and velocities.

    At 10 s steps it is within a millimetre of the integrated path.
    """
    step = np.diff(times)[:, None, None]
    s = (np.arange(_SUBSTEPS) / _SUBSTEPS)[None, :, None]
    p, v = states[:, None, :3], states[:, None, 3:]
    path = (
        (1 + 2 * s) * (1 - s) ** 2 * p[:-1]
        + s * (1 - s) ** 2 * step * v[:-1]
        + s**2 * (3 - 2 * s) * p[1:]
        + s**2 * (s - 1) * step * v[1:]
    )
    return np.concatenate([path.reshape(-1, 3), states[-1:, :3]])


def summarise(log: FlightLog) -> dict[str, typing.Any]:
    """The flight's figures of merit; see `FlightLog.summary`."""
    data, scenario = log.dataset, log.scenario
    times, states = data["time"].values, data["state"].values
    attrs = data.attrs
    arrival = float(attrs["arrival_time_s"])
    arrived = bool(np.isfinite(arrival))
    least = float(clearances(log.body.keep_out_semi_axes, dense_positions(times, states)).min())
    # Thrust acceleration, and how much of each interval lies before arrival.
    thrust = np.abs(data["force"].values[:-1]).sum(axis=1) / scenario.spacecraft.mass_kg
    lengths = np.diff(times)
    until = np.clip((arrival if arrived else np.inf) - times[:-1], 0.0, lengths)
    error = states[-1] - data["target"].values[-1]
    solve_ms = data["solve_time"].values * 1e3
    asked = solve_ms[np.isfinite(solve_ms)]
    collided = bool(attrs["collided"])
    violations = int(attrs["keep_out_violations"])
    return {
        "controller": attrs["controller"],
        "seed": scenario.transit.seed,
        "transit": scenario.transit.index,
        "success": arrived
        and arrival <= scenario.arrival.deadline_s
        and not collided
        and violations == 0,
        "success_2km": _arrives(log, *WIDE_ARRIVAL) and not collided and violations == 0,
        "collided": collided,
        "keep_out_violations": violations,
        "min_clearance_m": least,
        "terminal_position_error_m": float(np.linalg.norm(error[:3])),
        "terminal_speed_m_s": float(np.linalg.norm(error[3:])),
        "arrival_time_s": arrival if arrived else None,
        "delta_v_m_s": float(thrust @ until),
        "hold_delta_v_m_s": float(thrust @ (lengths - until)),
        "steps": len(times) - 1,
        "mpc_solves": int(asked.size),
        "policy_share": float(np.mean(data["decision"].values[:-1] == 2)),
        "control_ms_median": float(np.median(asked)) if asked.size else None,
        "control_ms_p99": float(np.percentile(asked, 99)) if asked.size else None,
        "wall_s": float(attrs["wall_s"]),
        "scenario_sha256": attrs["scenario_sha256"],
        "policy_sha256": attrs.get("policy_sha256"),
    }


def _arrives(log: FlightLog, radius: float, speed: float) -> bool:
    """Whether the rows show a dwell within radius (m) and speed (m/s) that begins in time."""
    arrival = log.scenario.arrival
    times = log.dataset["time"].values
    error = log.dataset["state"].values - log.dataset["target"].values
    distance, rate = np.linalg.norm(error[:, :3], axis=1), np.linalg.norm(error[:, 3:], axis=1)
    outside = (distance > radius) | (rate > speed)
    # Entered somewhere in the step before the first row inside.
    entered = times[0] if not outside[0] else None
    for k in range(1, len(times)):
        if entered is not None and times[k] - entered >= arrival.dwell_s - 1e-6:
            return bool(entered <= arrival.deadline_s)
        if outside[k]:
            entered = None
        elif entered is None:
            entered = times[k - 1]
    return False


def differences(first: FlightLog, second: FlightLog) -> list[str]:
    """Names of the variables in which two logs differ by any bit, wall times aside."""
    names = sorted(set(first.dataset.variables) | set(second.dataset.variables))
    return [
        name
        for name in names
        if name != "solve_time"
        and not (
            name in first.dataset
            and name in second.dataset
            and first.dataset[name].dtype == second.dataset[name].dtype
            and first.dataset[name].identical(second.dataset[name])
        )
    ]


def write_whole(path: Path, write: Callable[[Path], typing.Any]) -> None:
    """Calls `write` with a temporary name beside `path`, then renames: never a half file.

    Raises:
      InputError: the folder does not exist or cannot be written, or the disk is full.
    """
    try:
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=".part")
        os.close(handle)
    except OSError as error:
        raise InputError(f"cannot write in {path.parent}: {error.strerror}") from error
    temporary = Path(name)
    try:
        write(temporary)
        with temporary.open("rb") as file:
            os.fsync(file.fileno())
        temporary.chmod(0o644)
        temporary.replace(path)
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror or error}") from error
    finally:
        temporary.unlink(missing_ok=True)
