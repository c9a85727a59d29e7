"""Draws a lidar frame beside what the map predicts, and what the navigation made of its returns."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

from proxops.diagrams.logs import FlightLog
from proxops.diagrams.plots.plots import length_unit
from proxops.systems.common import InputError
from proxops.systems.lidar import ray_directions
from proxops.systems.navigation import ReturnUse
from proxops.systems.shapes import ray_caster

_PREDICTED = "#a8b0bd"
# Residuals up to so many times the noise are drawn to scale.
_LINEAR = 10.0
_KINDS = {
    ReturnUse.USED: ("used", "#33415c"),
    ReturnUse.REJECTED: ("rejected", "#b03030"),
    ReturnUse.NOT_USED: ("left alone", "#c07a1f"),
}


def plot_frame(log: FlightLog, row: int) -> Figure:
    """Draws the frame of a row of a log, as the navigation saw it.

    Returns are numbered in the order of the rays, plane by plane. The upper panel shows their
    ranges, those that the map predicts at the pose in which the navigation believed to be after the
    frame, and what it made of each. The lower panel shows measured less predicted, where both are.

    Args:
      log: of a flight with a navigation and with frames.
      row: of the log, from 0; negative: from its end.

    Raises:
      InputError: the log has no frames or no navigation, or the navigation had no state there.
    """
    data = log.dataset
    if "navigation_return_use" not in data or "ranges" not in data:
        raise InputError(
            "the log does not say what became of its lidar returns: fly on navigation, and with "
            "log_ranges: true"
        )
    if not -data.sizes["time"] <= row < data.sizes["time"]:
        raise InputError(f"the log has {data.sizes['time']} rows: there is no row {row}")
    measured = data["ranges"].values[row]
    use = data["navigation_return_use"].values[row].ravel()
    predicted = _predicted(log, row, measured.shape)
    measured = measured.ravel().astype(float)
    returned = np.flatnonzero(np.isfinite(measured))
    measured, use, predicted = measured[returned], use[returned], predicted[returned]
    figure = Figure(figsize=(11.0, 6.0), layout="constrained")
    ranges, left = figure.subplots(2, 1, sharex=True, height_ratios=[1.4, 1.0])
    unit, name = length_unit(float(log.body.shape.extents.max()))
    met = np.flatnonzero(np.isfinite(predicted))
    ranges.plot(met, predicted[met] / unit, "o", color=_PREDICTED, label="predicted", ms=7)
    for kind, (text, colour) in _KINDS.items():
        chosen = np.flatnonzero(use == kind)
        label = f"{text}: {chosen.size}"
        ranges.plot(chosen, measured[chosen] / unit, ".", color=colour, label=label, ms=5)
        both = np.intersect1d(chosen, met)
        left.plot(both, measured[both] - predicted[both], ".", color=colour, ms=5)
    ranges.set_ylabel(f"range ({name})")
    ranges.set_title(f"frame at {float(data['time'][row]):.0f} s")
    left.set_yscale("symlog", linthresh=_LINEAR * max(log.scenario.lidar.noise_std_m, 1.0))
    left.set_ylabel("measured less predicted (m)")
    left.set_xlabel("return")
    for ax in (ranges, left):
        ax.grid(alpha=0.25)
        ax.margins(x=0.01)
    figure.legend(loc="outside upper center", ncols=4, frameon=False)
    return figure


def _predicted(log: FlightLog, row: int, shape: tuple[int, ...]) -> np.ndarray:
    """The ranges (planes * rays,) in m that the map predicts; +inf where the body is not met."""
    state = log.dataset["navigation_state"].values[row]
    if not np.isfinite(state).all():
        raise InputError(f"in row {row} of the log the navigation has no state")
    turn = Rotation.from_quat(log.dataset["navigation_attitude"].values[row], scalar_first=True)
    directions = turn.apply(ray_directions(*shape))
    distances, facets, _ = ray_caster(log.body.shape).first_hits(state[:3], directions)
    return np.where(facets >= 0, distances, np.inf)
