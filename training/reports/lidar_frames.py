"""Draws real and generated frames beside each other, as the paper's figure does."""

from __future__ import annotations

import typing

import numpy as np

if typing.TYPE_CHECKING:
    from matplotlib.figure import Figure

_INCHES_WIDE = 11.0


def plot_frames(positions: np.ndarray, frames: dict[str, np.ndarray], planes: int) -> Figure:
    """Draws a row of pictures for each position, with a column for each source of frames.

    Each frame is drawn twice: as planes by rays, and filled ray by ray with all planes of each ray,
    six rays to a row where their number allows it: the paper's 60 rows and 72 columns.

    Args:
      positions: (N, 3) in m in K.
      frames: by source, (N, R) in m, +inf where nothing returns.
    """
    from matplotlib.figure import Figure  # It is slow to import, so only when it is needed.

    count, sources = len(positions), len(frames)
    figure = Figure(figsize=(_INCHES_WIDE, 3.0 * count), layout="constrained")
    stacks = np.atleast_1d(figure.subfigures(count, 1))
    for k, stack in enumerate(stacks):
        seen = np.concatenate([source[k][np.isfinite(source[k])] for source in frames.values()])
        low, high = (seen.min() / 1e3, seen.max() / 1e3) if seen.size else (0.0, 1.0)
        place = ", ".join(f"{x / 1e3:.0f}" for x in positions[k])
        stack.suptitle(f"from ({place}) km", fontsize="small")
        axes = stack.subplots(2, sources, squeeze=False, height_ratios=[1, 3])
        image = None
        for column, (name, source) in enumerate(frames.items()):
            whole = np.where(np.isfinite(source[k]), source[k] / 1e3, np.nan).reshape(planes, -1)
            for row, picture in enumerate((whole, _reshaped(whole))):
                axis = axes[row, column]
                image = axis.imshow(picture, aspect="auto", vmin=low, vmax=high, cmap="viridis")
                axis.set_facecolor("0.15")
                axis.tick_params(labelsize="xx-small")
                size = " × ".join(map(str, picture.shape))
                axis.set_title(f"{name}, {size}", fontsize="x-small")
        assert image is not None
        bar = stack.colorbar(image, ax=axes, shrink=0.8)
        bar.set_label("range (km)", fontsize="x-small")
        bar.ax.tick_params(labelsize="xx-small")
    return figure


def _reshaped(frame: np.ndarray) -> np.ndarray:
    """A frame (planes, rays) with six rays of all planes in a row if possible."""
    planes, rays = frame.shape
    return frame.T.reshape((rays // 6, 6 * planes) if rays % 6 == 0 else (rays, planes))
