"""Computes the figures of merit of a touch-and-go from its log."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from proxops.systems.touch import AbortReason, TouchPhase

_DESCENDING = range(TouchPhase.CHECKPOINT, TouchPhase.CONTACT)


def of_controller(data: xr.Dataset) -> xr.Dataset:
    """The rows of a log at which its controller flew: all, or those of the transit to a touch."""
    if "touch_phase" not in data:
        return data
    transit = data["touch_phase"].values == TouchPhase.TRANSIT
    return data.isel(time=np.flatnonzero(transit)) if transit.any() else data


def touch_figures(data: xr.Dataset) -> dict[str, Any]:
    """Gives what touched, where, how, and how it ended; nothing for another flight.

    `safe`: it is at home again, or parked if it was to be, and nothing but the head had a force on
    it. `success`: and it has touched. `touch_policy_share` is that of a learned policy in the steps
    of the legs that have a plan. `touch_aborts` has the name of the reason of each abort,
    `touch_navigation_error_m` the error of the navigated position at the last step before the
    touch, `parked_m` the distance in m from the body's centre in the end, if it parks.
    """
    if "touch_phase" not in data:
        return {}
    attrs, phases = data.attrs, data["touch_phase"].values
    figures = {name: value for name, value in attrs.items() if name.startswith("touch_")}
    # The record at a log's last row is of the step after it.
    broken = np.isin(phases[:-1], _DESCENDING) & (phases[1:] == TouchPhase.AWAY)
    reasons = data["touch_abort"].values[1:][broken]
    touched, home = "touch_time_s" in attrs, bool(np.isfinite(attrs["arrival_time_s"]))
    figures["safe"] = home and not attrs["collided"] and attrs["touch_parts_force_n"] == 0.0
    figures["success"] = figures["success_2km"] = touched and figures["safe"]
    figures["touched"] = touched
    if (phases == TouchPhase.PARK).any():
        figures["parked_m"] = float(np.linalg.norm(data["state"].values[-1, :3]))
    figures["keep_out_violations"] = None  # It has to enter the ellipsoid.
    figures["touch_tries"] = int(np.nanmax(data["touch_tries"].values))
    figures["touch_aborts"] = [AbortReason(int(reason)).name.lower() for reason in reasons]
    legs = np.isin(phases[:-1], [TouchPhase.CHECKPOINT, TouchPhase.MATCHPOINT, TouchPhase.GROUND])
    if legs.any() and "touch_by_policy" in data:  # Not before 1.18.
        figures["touch_policy_share"] = float(data["touch_by_policy"].values[:-1][legs].mean())
    if touched and "navigation_state" in data:
        last = np.searchsorted(data["time"].values, attrs["touch_time_s"]) - 1
        off = (data["navigation_state"] - data["state"]).values[last, :3]
        figures["touch_navigation_error_m"] = float(np.linalg.norm(off))
    return figures
