"""Draws a lidar frame as a picture, or beside what the map predicts.

`plot_frame` also shows what the navigation made of the returns.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from scipy.spatial.transform import Rotation

from proxops.diagrams.logs import FlightLog
from proxops.diagrams.plots.shared_axes import length_unit, unit_at
from proxops.diagrams.scenario import LidarNavigationConfig
from proxops.systems.common import InputError
from proxops.systems.navigation import ReturnUse, load_map
from proxops.systems.shapes import Polyhedron, ray_caster

_PREDICTED = "#a8b0bd"
# Multiple of the noise up to which residuals are drawn to scale.
_LINEAR = 10.0
_KINDS = {
    ReturnUse.USED: ("used", "#33415c"),
    ReturnUse.REJECTED: ("rejected", "#b03030"),
    ReturnUse.NOT_USED: ("left alone", "#c07a1f"),
}


def plot_ranges(ax: Axes, frame: np.ndarray) -> AxesImage:
    """Draws a lidar frame (planes, rays) in m as a picture; rays without a return stay blank."""
    planes, rays = frame.shape
    step = 360.0 / rays
    finite = frame[np.isfinite(frame)]
    length, unit = length_unit(float(finite.max(initial=0.0)))
    ranges = np.ma.masked_invalid(frame / length)
    image = ax.imshow(
        ranges, aspect="auto", origin="lower", interpolation="nearest", cmap="viridis_r",
        extent=(-step / 2.0, 360.0 - step / 2.0, -0.5, planes - 0.5),
    )  # fmt: skip
    ax.set_facecolor("#eeeeee")
    ax.set_xlabel(f"angle in the plane (degrees), {rays} rays")
    ax.set_ylabel("plane")
    ax.set_xticks(np.arange(0, 361, 60))
    figure = ax.get_figure()
    if figure is not None and finite.size:
        figure.colorbar(image, ax=ax, label=f"range ({unit})", fraction=0.05, pad=0.02)
    return image


def plot_frame(log: FlightLog, row: int) -> Figure:
    """Draws the frame of a row of a log, as the navigation saw it.

    Returns are numbered in the order of the rays, plane by plane. The upper panel shows their
    ranges, those that the map predicts, and what the navigation made of each. The lower panel shows
    measured less predicted, where both are.

    The log holds frames as they are received. So the prediction is made at the pose in which the
    navigation believed to be `navigation.frame_delay_steps` rows earlier, as old as it took the
    frame to be; without a delay, that is the pose after the frame. The map is that of the
    navigation: `navigation.map`, read from its file again, or else the body of the log.

    Args:
      log: of a flight with a navigation and with frames.
      row: of the log, from 0; negative: from its end.

    Raises:
      InputError: the log has no frames or no navigation; the frame was measured before the log
        begins, or the navigation had no state then; or `navigation.map` cannot be read any more.
    """
    data, settings = log.dataset, log.scenario.navigation
    there = "navigation_return_use" in data and "ranges" in data
    if not there or not isinstance(settings, LidarNavigationConfig):
        raise InputError(
            "the log does not say what became of its lidar returns: fly on navigation, and with "
            "log_ranges: true"
        )
    rows = data.sizes["time"]
    if not -rows <= row < rows:
        raise InputError(f"the log has {rows} rows: there is no row {row}")
    taken = row % rows - settings.frame_delay_steps
    if taken < 0:
        raise InputError(
            f"the frame of row {row % rows} is {settings.frame_delay_steps} rows old "
            "(navigation.frame_delay_steps): it was measured before the log begins"
        )
    measured = data["ranges"].values[row]
    use = data["navigation_return_use"].values[row].ravel()
    predicted = _predicted(log, _map(log, settings), taken)
    measured = measured.ravel().astype(float)
    returned = np.flatnonzero(np.isfinite(measured))
    measured, use, predicted = measured[returned], use[returned], predicted[returned]
    figure = Figure(figsize=(11.0, 6.0), layout="constrained")
    ranges, left = figure.subplots(2, 1, sharex=True, height_ratios=[1.4, 1.0])
    unit, name = unit_at(log.body)
    met = np.flatnonzero(np.isfinite(predicted))
    ranges.plot(met, predicted[met] / unit, "o", color=_PREDICTED, label="predicted", ms=7)
    for kind, (text, colour) in _KINDS.items():
        chosen = np.flatnonzero(use == kind)
        label = f"{text}: {chosen.size}"
        ranges.plot(chosen, measured[chosen] / unit, ".", color=colour, label=label, ms=5)
        both = np.intersect1d(chosen, met)
        left.plot(both, measured[both] - predicted[both], ".", color=colour, ms=5)
    ranges.set_ylabel(f"range ({name})")
    received = f", received at {float(data['time'][row]):.0f} s" if taken != row % rows else ""
    ranges.set_title(f"frame at {float(data['time'][taken]):.0f} s{received}")
    left.set_yscale("symlog", linthresh=_LINEAR * max(log.scenario.lidar.noise_std_m, 1.0))
    left.set_ylabel("measured less predicted (m)")
    left.set_xlabel("return")
    for ax in (ranges, left):
        ax.grid(alpha=0.25)
        ax.margins(x=0.01)
    figure.legend(loc="outside upper center", ncols=4, frameon=False)
    return figure


def _map(log: FlightLog, settings: LidarNavigationConfig) -> Polyhedron:
    """The map by which the navigation flew."""
    if settings.map is None:
        return log.body.shape
    try:
        return load_map(Path(settings.map), settings.map_unit)[0]
    except InputError as error:
        raise InputError(f"navigation.map of the log: {error}") from error


def _predicted(log: FlightLog, map_shape: Polyhedron, row: int) -> np.ndarray:
    """The ranges (planes * rays,) in m that a map predicts at the pose believed in a row.

    They are +inf where the body is not met.
    """
    state = log.dataset["navigation_state"].values[row]
    if not np.isfinite(state).all():
        raise InputError(f"in row {row} of the log the navigation has no state")
    turn = Rotation.from_quat(log.dataset["navigation_attitude"].values[row], scalar_first=True)
    directions = turn.apply(log.scenario.lidar_geometry.directions)
    distances, facets, _ = ray_caster(map_shape).first_hits(state[:3], directions)
    return np.where(facets >= 0, distances, np.inf)
