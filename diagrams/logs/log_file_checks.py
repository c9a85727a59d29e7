"""Checks that a file is a flight log: it may come from a stranger, or be damaged."""

from __future__ import annotations

import typing
from pathlib import Path

import h5py
import numpy as np
import xarray as xr

from proxops.diagrams.logs.columns import (
    COORDINATES,
    NAVIGATION_COLUMNS,
    OUTCOMES,
    RECORDS,
    SIZES,
    SURVEY,
    VARIABLES,
)
from proxops.systems.common import InputError
from proxops.systems.hybrid import FlownBy

# A file without these variables is not a log. All others depend on the flight.
_NEEDED_VARIABLES = (
    "time", "state", "target", "force", "mpc_force", "policy_force", "disturbance", "decision",
    *RECORDS["mpc_record"], "mesh_vertices", "mesh_facets",
)  # fmt: skip
_NEEDED_ATTRIBUTES = ["scenario", "body", "controller", "shape_sha256", "arrival_time_s"]
_NEEDED_ATTRIBUTES += ["collided", "keep_out_violations", "wall_s", "scenario_sha256"]
_TEXTS = ("scenario", "body", "controller", "shape_sha256", "scenario_sha256")
_NUMBERS = (*OUTCOMES, "wall_s", "force_delay_s")
# Variables that are finite in every row, and the greatest size of their values, in SI.
_FINITE = ("time", "state", "target", "force")
_LARGEST = 1e15


def check_log_file(path: str | Path) -> None:
    """Raises `InputError` if a log takes data from another file, as HDF5 can, or is damaged."""
    try:
        with h5py.File(path, "r") as file:
            fault = _foreign_data(file)
    except Exception as error:  # Damaged files raise errors of many types.
        raise InputError(f"{path} is not a flight log: {error}") from error
    if fault is not None:
        raise InputError(f"{path} is not a flight log: {fault}")


def _foreign_data(file: h5py.File) -> str | None:
    """Says what a file takes from elsewhere; None: nothing."""
    if _has_opaque(file):
        return "it has an attribute of opaque bytes"
    for name in file:
        if not isinstance(file.get(name, getlink=True), h5py.HardLink):
            return f"{name} is a link"
        entry = file[name]
        if _has_opaque(entry):
            return f"{name} has opaque bytes"
        if isinstance(entry, h5py.Dataset) and (entry.external or entry.is_virtual):
            return f"{name} is in another file"
    return None


def _has_opaque(entry: h5py.Group | h5py.Dataset | h5py.Datatype) -> bool:
    """Whether an entry or one of its attributes has opaque bytes.

    h5py takes some of them for addresses of Python's objects, so nothing may read them.
    """
    count = h5py.h5a.get_num_attrs(entry.id)
    kinds = [h5py.h5a.open(entry.id, index=k).get_type() for k in range(count)]
    if isinstance(entry, h5py.Dataset):
        kinds.append(entry.id.get_type())
    return any(kind.detect_class(h5py.h5t.OPAQUE) for kind in kinds)


def missing_entries(data: xr.Dataset) -> list[str]:
    """Lists the variables and attributes that every log has and this one has not."""
    missing = [name for name in _NEEDED_VARIABLES if name not in data.variables]
    return missing + [name for name in _NEEDED_ATTRIBUTES if name not in data.attrs]


def wrong_entries(data: xr.Dataset) -> list[str]:
    """Lists the variables and attributes whose types, dimensions or values no flight gives."""
    schema = {"time": ("time",)}
    schema |= {name: ("time", *column.dimensions) for name, column in VARIABLES.items()}
    schema |= {name: column.dimensions for name, column in SURVEY.items()}
    wrong = [
        name
        for name, dimensions in schema.items()
        if name in data.variables
        and (data[name].dims != dimensions or data[name].dtype.kind not in "fiub")
    ]
    wrong += [name for name, size in SIZES.items() if data.sizes.get(name, size) != size]
    wrong += [name for name in COORDINATES if name not in data.sizes]
    for together in (NAVIGATION_COLUMNS, SURVEY):
        missing = [name for name in together if name not in data.variables]
        if len(missing) < len(together):
            wrong += missing
    wrong += [name for name in _TEXTS if not isinstance(data.attrs[name], str)]
    numbers = [name for name in _NUMBERS if name in data.attrs]
    wrong += [name for name in numbers if not isinstance(data.attrs[name], float | int | np.number)]
    if wrong:
        return wrong
    finite = [name for name in (*_FINITE, *SURVEY) if name in data.variables]
    wrong = [name for name in finite if not (np.abs(data[name].values) <= _LARGEST).all()]
    for name in {"time", "survey_time"} & {*finite} - {*wrong}:
        if not (data.sizes[name] and _increases(data[name].values)):
            wrong.append(name)
    if "survey_time" in finite and not wrong:
        wrong += _wrong_of_survey(data)
    if not np.isin(data["decision"].values, list(FlownBy)).all():
        wrong.append("decision")
    for name, column in VARIABLES.items():
        if column.codes is not None and name in data:
            values = data[name].values
            if not (np.isnan(values) | np.isin(values, list(column.codes))).all():
                wrong.append(name)
    wrong += [name for name in ("collided", "keep_out_violations") if not _counts(data.attrs[name])]
    return wrong


def _wrong_of_survey(data: xr.Dataset) -> list[str]:
    """Lists the columns of a survey with values that no survey gives."""
    wrong = [] if data["survey_time"][-1] <= data["time"][0] else ["survey_time"]
    for name, limit in (("survey_frame", data.sizes["survey_time"]), ("survey_ray", np.inf)):
        numbers = data[name].values
        if numbers.dtype.kind not in "iu" or not ((numbers >= 0) & (numbers < limit)).all():
            wrong.append(name)
    return wrong


def _increases(values: np.ndarray) -> bool:
    return bool((np.diff(values) > 0.0).all())


def _counts(value: typing.Any) -> bool:
    return bool(np.isfinite(value)) and value >= 0
