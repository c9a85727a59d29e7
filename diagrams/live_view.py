"""A flight as it happens, in a browser: Drake's Meshcat fed by the diagram."""

from __future__ import annotations

import numpy as np
from pydrake.geometry import Meshcat, StartMeshcat
from pydrake.systems.framework import DiagramBuilder, LeafSystem, OutputPort

from proxops.diagrams.body import Body
from proxops.diagrams.meshcat_scene import (
    add_body,
    add_goal,
    add_keep_out,
    add_returns,
    add_spacecraft,
    look_at_flight,
    move_spacecraft,
    prepare_scene,
)
from proxops.diagrams.transits import Transit
from proxops.systems import Lidar


def start_server() -> Meshcat:
    """A Meshcat that a browser can open, at `web_url()`."""
    return StartMeshcat()


class LiveView(LeafSystem):
    """Draws a flight into a Meshcat while it is simulated.

    ```
    position (3), m, K ─────────►┌──────────┐
    force (3), N ───────────────►│ LiveView │
    ranges (planes * rays), m ──►└──────────┘
    ```
    """

    def __init__(self, meshcat: Meshcat, lidar: Lidar, thrust_limit: float, period: float):
        """Takes the lidar that the ranges come from, the limit per axis in N, a period in s."""
        super().__init__()
        self._meshcat, self._thrust_limit = meshcat, thrust_limit
        self._shape = (lidar.planes, lidar.rays)
        self._position_port = self.DeclareVectorInputPort(name="position", size=3)
        self._force_port = self.DeclareVectorInputPort(name="force", size=3)
        self._ranges_port = self.DeclareVectorInputPort(
            name="ranges", size=lidar.planes * lidar.rays
        )
        self.DeclarePeriodicPublishEvent(period_sec=period, offset_sec=0.0, publish=self._draw)

    def _draw(self, context) -> None:
        position = self._position_port.Eval(context)
        force = self._force_port.Eval(context)
        ranges = self._ranges_port.Eval(context).reshape(self._shape)
        move_spacecraft(self._meshcat, position, force, self._thrust_limit)
        add_returns(self._meshcat, "/lidar/now", position, ranges)


def add_live_view(
    builder: DiagramBuilder,
    meshcat: Meshcat,
    body: Body,
    transit: Transit,
    view: LiveView,
    sources: dict[str, OutputPort],
) -> None:
    """Sets the scene of a transit and feeds `view` from the ports named as its inputs are."""
    prepare_scene(meshcat)
    add_body(meshcat, body)
    add_keep_out(meshcat, body)
    add_goal(meshcat, transit.goal)
    add_spacecraft(meshcat)
    look_at_flight(meshcat, body, np.stack([transit.start, transit.goal]))
    builder.AddNamedSystem("live_view", view)
    for name, port in sources.items():
        builder.Connect(port, view.GetInputPort(name))
