"""Axes that show a plane of K, alike in both directions."""

from __future__ import annotations

from matplotlib.axes import Axes


def frame_plane(ax: Axes, plane: str, unit: str, reach: float) -> None:
    """Shows a plane such as "xy" out to `reach` on each side of the origin.

    Args:
      ax: the axes.
      plane: names the axis to the right, then the one upwards.
      unit: of lengths in the picture.
      reach: in this unit.
    """
    ax.set_xlim(-reach, reach)
    ax.set_ylim(-reach, reach)
    ax.set_aspect("equal")
    ax.set_xlabel(f"{plane[0]} ({unit})")
    ax.set_ylabel(f"{plane[1]} ({unit})")
    ax.grid(alpha=0.25)
