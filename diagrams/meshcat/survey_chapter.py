"""The survey of a mission as the first chapter of its replay: its orbit, and how returns gather."""

from __future__ import annotations

import numpy as np
import xarray as xr

from proxops.diagrams.logs import SURVEY, FlightLog
from proxops.diagrams.meshcat.meshcat_page import FRAMES_PER_SECOND, PLAYBACK_SPEED
from proxops.diagrams.meshcat.meshcat_scene import RETURNS, Scene, add_points
from proxops.systems.common import InputError, Values, rotation_matrix
from proxops.systems.hybrid import FlownBy

# A survey is played in so many seconds, and its returns appear so many times.
_SECONDS, _TIMES = 20.0, 60
_ROWS = round(_SECONDS * FRAMES_PER_SECOND)
# Most returns that are shown, and how large.
_MOST, _SIZE = 60_000, 0.008
# What is there only when the survey is over: what it finds, and the way in which the lidar looks.
_AFTER = ("/map", "/keep_out", "/goal", "/site", "/spacecraft/turned/sight")


def with_survey_rows(log: FlightLog) -> FlightLog:
    """The log with rows before those of its flight, of a mission's survey in its orbit.

    These rows have what a survey has, and NaN in all other columns.
    """
    data = log.dataset
    if "survey_time" not in data:
        return log
    survey, begin = data[[*SURVEY]], int(data["survey_frame"].min())
    # The last row is the flight's first.
    rows = np.unique(np.linspace(begin, survey.sizes["survey_time"] - 2, _ROWS).astype(int))
    times = np.concatenate([survey["survey_time"].values[rows], data["time"].values])
    joined = data.reindex(time=times)
    filled = {
        "state": survey["survey_state"].values[rows],
        "force": survey["survey_force"].values[rows],
        "attitude": survey["survey_attitude"].values[rows],
        "target": data["target"].values[0],
        "decision": FlownBy.SURVEY,
        "on_times": 0.0,
    }
    for name in {*filled} & {*joined}:
        joined[name].values[: len(rows)] = filled[name]
    return FlightLog(joined, log.body)


def survey_rows(data: xr.Dataset) -> int:
    """How many rows of a log are of its survey: the first ones."""
    return int(np.sum(data["decision"].values == FlownBy.SURVEY))


def shown_times(data: xr.Dataset) -> Values:
    """Gives the time (N,) in s of a replay at which each row of its log is shown."""
    times, count = data["time"].values, survey_rows(data)
    shown = (times - times[count]) / PLAYBACK_SPEED
    if count > 0:
        shown += _SECONDS
        shown[:count] = _SECONDS * (1.0 - times[:count] / times[0])
    return shown


def speed_text(data: xr.Dataset) -> str:
    """Says how much faster than in real time a replay plays its log."""
    text = f"{PLAYBACK_SPEED:.0f} times real time"
    if survey_rows(data) > 0:
        text += f", its survey {-data['time'].values[0] / _SECONDS:,.0f} times"
    return text


def record_survey(scene: Scene, log: FlightLog, shown: Values) -> None:
    """Records how the returns of a survey gather, and that what it finds appears in the end.

    Args:
      log: of `with_survey_rows`. shown: (N,) of `shown_times`.

    Raises:
      InputError: the log has returns of rays that its lidar has not.
    """
    data, directions = log.dataset, log.scenario.lidar_geometry.directions
    count, meshcat = survey_rows(data), scene.meshcat
    if count == 0:
        return
    frame, ray = data["survey_frame"].values, data["survey_ray"].values
    if ray.size and ray.max() >= len(directions):
        raise InputError(f"survey_ray is up to {ray.max()}: the lidar has {len(directions)} rays")
    chosen = np.linspace(0, len(frame) - 1, min(_MOST, len(frame))).astype(int)
    turns = np.array([rotation_matrix(each) for each in data["survey_attitude"].values])
    along = np.einsum("kij,kj->ki", turns[frame[chosen]], directions[ray[chosen]])
    positions = data["survey_state"].values[frame[chosen], :3]
    places = positions + data["survey_range"].values[chosen, None] * along
    over, end = 1.0 - data["survey_time"].values / data["time"].values[0], float(shown[count])
    groups = np.ceil(_TIMES * over[frame[chosen]]).astype(int)
    for group in np.unique(groups).tolist():
        name, last = f"/survey/{group:02d}", _SECONDS * group / _TIMES
        add_points(scene, name, places[groups == group], RETURNS, _SIZE)
        meshcat.SetProperty(name, "visible", False)
        for visible, at in ((False, 0.0), (True, last), (False, end)):
            meshcat.SetProperty(name, "visible", visible, at)
    for name in filter(meshcat.HasPath, _AFTER):
        meshcat.SetProperty(name, "visible", False, 0.0)
        meshcat.SetProperty(name, "visible", True, end)
