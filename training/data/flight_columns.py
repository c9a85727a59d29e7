"""Reads from a flight log the arrays that training needs, and checks them."""

from __future__ import annotations

import dataclasses as dc
import typing
from pathlib import Path

import h5py
import numpy as np

from proxops.diagrams.logs import VARIABLES, check_log_file, commanded_forces
from proxops.diagrams.scenario import parse_scenario
from proxops.systems.common import InputError

# Rays are numbered with 16 bits.
_MAX_RAYS = 2**16
_NEEDED = ("time", "state", "target", "force", "disturbance", "mpc_force", "ranges")
_SIZES = {"component": 6, "axis": 3}


@dc.dataclass(frozen=True)
class Setting:
    """Properties that all flights of a training set must share."""

    body: str
    """YAML of the body's constants."""
    shape_sha256: str
    planes: int
    rays: int
    max_range_m: float
    control_period_s: float
    mass_kg: float
    thrust_limit_n: float


@dc.dataclass(frozen=True)
class FlightColumns:
    """One flight of N steps; vectors are in K, but `commanded_force` is along S.

    The last row of a log is the end of the flight. Nothing was commanded there, so it is no step.
    """

    setting: Setting
    seed: int
    transit: int
    rows: dict[str, np.ndarray]
    """Arrays by the names of `ROWS`, with one row for each step."""
    hit_counts: np.ndarray
    """(N,) int64: number of returns at each step."""
    hits: dict[str, np.ndarray]
    """Arrays by the names of `HITS`: all returns, step by step, in rising order of rays."""


# name: (length of a row, None for a number; type)
ROWS: dict[str, tuple[int | None, str]] = {
    "time": (None, "<f8"),  # s since the start of the flight
    "state": (6, "<f8"),  # m, m/s
    "target": (6, "<f8"),  # m, m/s
    "commanded_force": (3, "<f8"),  # N, the command held over the period before the step
    "mpc_force": (3, "<f8"),  # N, the label; NaN where the MPC was not asked
    "kick": (3, "<f8"),  # m/s^2, acceleration by a velocity kick up to the next step
}
HITS: dict[str, tuple[int | None, str]] = {
    "ray": (None, "<u2"),  # plane * rays + ray in it
    "range": (None, "<f4"),  # m
}


def read_columns(path: Path) -> FlightColumns:
    """Reads and checks one log.

    Raises:
      InputError: the file is no flight log; or a field is missing, has another shape than the
        schema and the log's scenario require, or has impossible values. The message names the file
        and the field.
    """
    try:
        check_log_file(path)
        with h5py.File(path, "r") as file:
            attributes = {name: _plain(value) for name, value in file.attrs.items()}
            raw = {name: _read(file, path, name) for name in (*_NEEDED, "kick") if name in file}
    except InputError:
        raise
    except Exception as error:  # A damaged file makes h5py raise all sorts of errors.
        raise InputError(f"{path} is not a flight log: {error}") from error
    wanted = ("scenario", "body", "shape_sha256", "seed", "transit")
    missing = [name for name in wanted if name not in attributes]
    missing += [name for name in _NEEDED if name not in raw]
    if missing == ["ranges"]:
        raise InputError(f"{path} has no ranges: fly it again with the lidar's frames in the log")
    if missing:
        raise InputError(f"{path} is not a complete flight log: it has no {', '.join(missing)}")
    setting = _setting(path, attributes)
    _check(path, raw, setting)
    steps = len(raw["time"]) - 1
    frames = raw["ranges"][:steps].reshape(steps, setting.planes * setting.rays)
    step, ray = np.nonzero(np.isfinite(frames))
    # What controllers are told: the command, within the limits, without what disturbed it.
    limit = setting.thrust_limit_n
    commanded = commanded_forces(raw["force"], raw["disturbance"], limit)
    before = np.concatenate([np.zeros((1, 3)), commanded[: max(0, steps - 1)]])[:steps]
    rows = {name: raw[name][:steps] for name in ("time", "state", "target", "mpc_force")}
    rows |= {"commanded_force": before, "kick": raw.get("kick", np.zeros((steps + 1, 3)))[:steps]}
    return FlightColumns(
        setting=setting,
        seed=int(attributes["seed"]),
        transit=int(attributes["transit"]),
        rows={name: rows[name].astype(kind) for name, (_, kind) in ROWS.items()},
        hit_counts=np.bincount(step, minlength=steps),
        hits={"ray": ray.astype("<u2"), "range": frames[step, ray].astype("<f4")},
    )


def _plain(value: typing.Any) -> typing.Any:
    """The value of an attribute; NetCDF stores a number as an array of one element."""
    return value.reshape(-1)[0] if isinstance(value, np.ndarray) and value.size == 1 else value


def _read(file: h5py.File, path: Path, name: str) -> np.ndarray:
    variable = file[name]
    if not isinstance(variable, h5py.Dataset) or variable.dtype.kind not in "fiu":
        raise InputError(f"{path}: {name} is not an array of numbers")
    try:
        return variable[()]
    except Exception as error:
        raise InputError(f"{path}: {name} cannot be read: {error}") from error


def _setting(path: Path, attributes: dict[str, typing.Any]) -> Setting:
    scenario = parse_scenario(str(attributes["scenario"]), f"{path}: the scenario in it")
    lidar, craft = scenario.lidar, scenario.spacecraft
    if lidar.planes * lidar.rays > _MAX_RAYS:
        raise InputError(f"{path}: at most {_MAX_RAYS} rays can be packed, it has more")
    return Setting(
        body=str(attributes["body"]),
        shape_sha256=str(attributes["shape_sha256"]),
        planes=lidar.planes,
        rays=lidar.rays,
        max_range_m=lidar.max_range_m,
        control_period_s=scenario.control_period_s,
        mass_kg=craft.mass_kg,
        thrust_limit_n=craft.thrust_limit_n,
    )


def _check(path: Path, raw: dict[str, np.ndarray], setting: Setting) -> None:
    """Raises `InputError` for the first array that does not follow the schema."""
    times = raw["time"]
    if times.ndim != 1 or times.size == 0:
        raise InputError(f"{path}: time has the shape {times.shape}, not that of a flight")
    sizes = _SIZES | {"plane": setting.planes, "ray": setting.rays}
    for name, values in raw.items():
        dimensions = VARIABLES[name].dimensions if name in VARIABLES else ()
        wanted = (times.size, *(sizes[dimension] for dimension in dimensions))
        if values.shape != wanted:
            raise InputError(
                f"{path}: {name} has the shape {values.shape}; by its scenario and the log's "
                f"schema it must be {wanted} (time{''.join(', ' + each for each in dimensions)})"
            )
        if name not in ("mpc_force", "ranges"):
            _need(path, name, np.isfinite(values), "is not finite")
    ranges, label = raw["ranges"], raw["mpc_force"]
    _need(path, "ranges", ranges >= 0.0, "is negative or NaN")  # +inf: no return.
    asked = ~np.isnan(label).any(axis=1, keepdims=True)
    _need(path, "mpc_force", np.isfinite(label) | ~asked, "is infinite")
    _need(path, "mpc_force", np.isnan(label) | asked, "is NaN on some axes only")
    period = setting.control_period_s
    on_time = np.abs(times - period * np.arange(times.size)) < 1e-6 * period
    on_time[-1] |= times.size > 1 and times[-2] < times[-1] < period * (times.size - 1)
    _need(path, "time", on_time, f"is not a multiple of the control period, {period:g} s,")


def _need(path: Path, name: str, good: np.ndarray, fault: str) -> None:
    if not good.all():
        row = np.nonzero(~good)[0][0]
        raise InputError(f"{path}: {name} {fault} at row {row} of {len(good)}; is it damaged?")
