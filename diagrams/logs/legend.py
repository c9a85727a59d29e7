"""Tells who flew each step and why the safety filter intervened, for plots and replays."""

from __future__ import annotations

import json

import numpy as np
import xarray as xr

from proxops.diagrams.logs.flight_summary import INTERVENTION_TOLERANCE
from proxops.systems.assurance import InterventionReason
from proxops.systems.common import InputError, LegendEntry, Values
from proxops.systems.expert import ModelPredictiveController
from proxops.systems.hybrid import FlownBy
from proxops.systems.policy import NeuralPolicy
from proxops.systems.touch import TouchPhase

LEGEND = "legend"
"""Name of the log's attribute that holds the controller's own legend entry as JSON."""
_PLAIN_COLOUR = (0.25, 0.70, 0.45)
_SAFETY_FILTER = LegendEntry("safety filter", (0.93, 0.35, 0.95))
_TOUCH = LegendEntry("touch-and-go", (0.25, 0.80, 0.70))
_SURVEY = LegendEntry("survey", (0.75, 0.75, 0.45))
_LONGEST_NAME = 200
_REASONS = {
    InterventionReason.THRUST_LIMIT: ("more than the thrusters can give", (0.54, 0.56, 0.61)),
    InterventionReason.SPEED_LIMIT: ("an axis might become too fast", (0.85, 0.50, 0.05)),
    InterventionReason.KEEP_OUT: ("after it, braking might be too late", (0.80, 0.25, 0.25)),
    InterventionReason.BACKUP: ("nothing else was found safe: full braking", (0.50, 0.30, 0.85)),
}
REASONS = {
    reason: LegendEntry(f"{reason.in_words}: {why}", colour)
    for reason, (why, colour) in _REASONS.items()
}
"""Why the safety filter changed a command, with a colour for each reason."""


def flown_by(dataset: xr.Dataset) -> Values:
    """Gives the `FlownBy` of each row (N,) of a log: its `decision`, or what it does not hold."""
    codes = dataset["decision"].values.astype(int)
    codes = np.where(np.isin(codes, list(FlownBy)), codes, FlownBy.CONTROLLER)
    if "touch_phase" in dataset:
        learned = np.asarray(dataset.get("touch_by_policy", 0.0)) == 1.0  # Not before 1.18.
        touch = np.where(learned, FlownBy.POLICY, FlownBy.TOUCH)
        codes = np.where(dataset["touch_phase"].values >= TouchPhase.HOME, touch, codes)
    if "intervention" not in dataset:
        return codes
    intervened = dataset["intervention"].values > INTERVENTION_TOLERANCE
    return np.where(intervened, FlownBy.SAFETY_FILTER, codes)


def all_flown_by(dataset: xr.Dataset) -> list[FlownBy]:
    """Lists each `FlownBy` in a log; the last row is the flight's end and does not count."""
    return [FlownBy(code) for code in np.unique(flown_by(dataset)[:-1])]


def legend_of(dataset: xr.Dataset) -> dict[int, LegendEntry]:
    """Gives the name and the colour of each `FlownBy` in a log.

    Raises:
      InputError: the log's legend is damaged.
    """
    entries: dict[int, LegendEntry] = {
        FlownBy.CONTROLLER: LegendEntry(str(dataset.attrs["controller"]), _PLAIN_COLOUR),
        FlownBy.MPC: ModelPredictiveController.legend_entry,
        FlownBy.POLICY: NeuralPolicy.legend_entry,
    }
    own = _read_entry(dataset.attrs.get(LEGEND))
    if own is not None:
        entries = dict.fromkeys(entries, own)
    others = {
        FlownBy.SAFETY_FILTER: _SAFETY_FILTER, FlownBy.TOUCH: _TOUCH, FlownBy.SURVEY: _SURVEY,
    }  # fmt: skip
    return entries | others


def legend_text(entry: LegendEntry) -> str:
    """Writes an entry as the JSON text that the attribute `LEGEND` of a log holds.

    Raises:
      InputError: the name is empty or long, or the colour is not three numbers from 0 to 1.
    """
    text = json.dumps([entry.name, [float(level) for level in entry.colour]])
    _read_entry(text)
    return text


def _read_entry(text: object) -> LegendEntry | None:
    if text is None:
        return None
    try:
        name, colour = json.loads(text)  # pyright: ignore[reportArgumentType]
        red, green, blue = (float(level) for level in colour)
        good = isinstance(name, str) and 0 < len(name) <= _LONGEST_NAME
        if not good or not all(0.0 <= level <= 1.0 for level in (red, green, blue)):
            raise ValueError(text)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(
            "a legend entry needs a name of 1 to 200 letters, and red, green and blue from 0 to 1"
        ) from error
    return LegendEntry(name, (red, green, blue))
