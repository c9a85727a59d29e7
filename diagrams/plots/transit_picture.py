"""`TransitPicture`: a transit under way as an array of pixels, such as a frame of a video."""

from __future__ import annotations

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from proxops.diagrams.logs import three_digits
from proxops.diagrams.plots.flight_plot import BODY, GOAL, KEEP_OUT, draw_body, true_handles
from proxops.diagrams.plots.shared_axes import AXIS_COLOURS, MINUTE, frame_plane, unit_at
from proxops.diagrams.scenario import Body, TrueBody
from proxops.systems.common import Vector3, Vectors3
from proxops.systems.gravity import AXES

PLANES = ("xy", "xz")
"""Seen along z, and along y."""
_SIZE = (9.6, 5.4)  # inches of 100 pixels each
_PATH = AXIS_COLOURS["y"]


class TransitPicture:
    """Draws transits at a body, seen along z and along y.

    What does not move, the body above all, is drawn once and kept as pixels.
    """

    def __init__(self, body: Body, true_body: TrueBody | None, reach: float):
        """Takes the body as believed and as it is (None: the same), and the half width in m."""
        self._length, self._unit = unit_at(body)
        self._usual = self._reach = reach / self._length
        figure = Figure(figsize=_SIZE, dpi=100.0, layout="constrained")
        self._canvas = FigureCanvasAgg(figure)
        self._background = None
        self._title = figure.suptitle(" ", fontsize="medium", animated=True)
        self._axes: dict[str, Axes] = {}
        self._moving: dict[str, list[Line2D]] = {}
        for ax, plane in zip(figure.subplots(1, 2), PLANES, strict=True):
            draw_body(ax, body, plane, true_body)
            ax.set_title(f"seen along {next(iter({*AXES} - {*plane}))}", fontsize="medium")
            self._axes[plane], self._moving[plane] = ax, [_line(ax, style) for style in _STYLES]
        fixed = [
            Patch(color=BODY, label="body"),
            Line2D([], [], color=KEEP_OUT, linestyle="--", label="keep-out ellipsoid"),
            *(Line2D([], [], **style) for style in _STYLES),
        ]
        handles: list[Artist] = [*fixed, *true_handles(body, true_body)]
        figure.legend(handles=handles, loc="outside lower center", ncols=6, frameon=False)

    def pixels(self, path: Vectors3, goal: Vector3, time: float) -> np.ndarray:
        """Draws a transit.

        Args:
          path: positions (N, 3) in m in K from the start to now. goal: (3,) in m.
          time: since the start in s.

        Returns:
          The picture, uint8 (height, width, 3): red, green and blue.
        """
        path, goal = path / self._length, goal / self._length
        self._frame(float(np.abs(path).max()))
        left = f"{three_digits(float(np.linalg.norm(path[-1] - goal)))} {self._unit} to the goal"
        self._title.set_text(f"{time / MINUTE:.0f} min, {left}")
        self._canvas.restore_region(self._background)
        for plane, lines in self._moving.items():
            across_up = [AXES[letter] for letter in plane]
            for line, points in zip(lines, (path, path[:1], goal[None], path[-1:]), strict=True):
                line.set_data(*points[:, across_up].T)
                self._axes[plane].draw_artist(line)
        self._canvas.figure.draw_artist(self._title)
        return np.asarray(self._canvas.buffer_rgba())[..., :3].copy()

    def _frame(self, farthest: float) -> None:
        """Draws what does not move, unless the kept one reaches as far as is needed."""
        reach = self._usual
        while reach < farthest:
            reach *= 2.0
        if self._background is not None and reach == self._reach:
            return
        self._reach = reach
        for plane, ax in self._axes.items():
            frame_plane(ax, plane, self._unit, reach)
        self._canvas.draw()
        self._canvas.figure.set_layout_engine("none")  # Else all would move a little.
        self._background = self._canvas.copy_from_bbox(self._canvas.figure.bbox)


_STYLES = (
    {"color": _PATH, "linewidth": 1.8, "label": "path"},
    {"color": "black", "marker": "o", "markersize": 5, "linestyle": "", "label": "start"},
    {"color": GOAL, "marker": "*", "markersize": 13, "linestyle": "", "label": "goal"},
    {
        "color": _PATH, "marker": "D", "markersize": 7, "markeredgecolor": "black",
        "linestyle": "", "label": "spacecraft",
    },
)  # fmt: skip
"""Of the lines that move, in their order."""


def _line(ax: Axes, style: dict) -> Line2D:
    (line,) = ax.plot([], [], animated=True, zorder=4, **style)
    return line
