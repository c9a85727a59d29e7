"""Writes the motion of a flight as a CCSDS Orbit Ephemeris Message (CCSDS 502.0-B)."""

from __future__ import annotations

import datetime
from pathlib import Path

import numpy as np

from proxops.diagrams.logs import FlightLog
from proxops.systems.common import InputError, needed, write_whole

EPOCH = "2000-01-01T12:00:00"
"""Epoch of time 0 if none is given."""
FRAME = "INERTIAL_OF_BODY"
"""Name of the frame: that of the body at time 0, at rest among the stars."""


def write_oem(log: FlightLog, path: str | Path, epoch: str = EPOCH) -> None:
    """Writes position and velocity of a flight in the inertial frame, whole or not at all.

    The frame coincides with the body-fixed frame K at time 0. No model of the sky ties it to
    others: `REF_FRAME` says so by a name of its own.

    Args:
      log: of a flight. path: of the file, in key-value notation.
      epoch: of time 0, as YYYY-MM-DDThh:mm:ss in TDB.

    Raises:
      InputError: the package oem is not installed, the epoch is not of this form, or the file
        cannot be written.
    """
    oem, components = needed("oem", "exchange"), needed("oem.components", "exchange")
    start = _parsed(epoch)
    data = log.dataset
    position = 1e-3 * data["position_inertial"].values
    velocity = 1e-3 * data["velocity_inertial"].values
    epochs = [_text(start, time) for time in data["time"].values]
    metadata = {
        "OBJECT_NAME": "SPACECRAFT",
        "OBJECT_ID": f"PROXOPS-{log.scenario.transit.seed}-{log.scenario.transit.index}",
        "CENTER_NAME": log.body.config.name.upper(),
        "REF_FRAME": FRAME,
        "TIME_SYSTEM": "TDB",
        "START_TIME": epochs[0],
        "STOP_TIME": epochs[-1],
    }
    header = {"CCSDS_OEM_VERS": "2.0", "CREATION_DATE": epochs[0], "ORIGINATOR": "PROXOPS"}
    states = [*position.T.tolist(), *velocity.T.tolist()]
    moments = tuple(needed("astropy.time", "exchange").Time(epochs, scale="tdb"))
    segment = components.EphemerisSegment(
        components.MetaDataSection(metadata, "2.0"), (moments, *states), version="2.0"
    )
    message = oem.OrbitEphemerisMessage(components.HeaderSection(header), [segment])
    write_whole(Path(path), lambda file: message.save_as(file, file_format="kvn"))


def _parsed(epoch: str) -> datetime.datetime:
    try:
        parsed = datetime.datetime.fromisoformat(epoch)
    except ValueError as error:
        raise InputError(f"the epoch must be YYYY-MM-DDThh:mm:ss, got {epoch!r}") from error
    if parsed.tzinfo is not None:
        raise InputError(f"the epoch is in TDB: give it without a time zone, not {epoch!r}")
    return parsed


def _text(start: datetime.datetime, time: float) -> str:
    """An epoch `time` s after the start, to a microsecond."""
    after = start + datetime.timedelta(microseconds=int(np.round(1e6 * time)))
    return after.isoformat(timespec="microseconds")
