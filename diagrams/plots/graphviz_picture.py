"""A diagram's Graphviz picture, where Graphviz is installed."""

from __future__ import annotations

import shutil
import subprocess

from pydrake.systems.framework import System


def graphviz_svg(system: System, max_depth: int = 1) -> str | None:
    """The picture of a system's ports and wiring as SVG; None without the program `dot`.

    Args:
      max_depth: how many levels of subsystems are drawn.
    """
    if shutil.which("dot") is None:
        return None
    text = system.GetGraphvizString(max_depth=max_depth)
    drawn = subprocess.run(["dot", "-Tsvg"], input=text, capture_output=True, text=True, check=True)
    return drawn.stdout
