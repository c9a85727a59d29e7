"""A flight as it happens, in a browser: Drake's Meshcat fed by the diagram."""

from __future__ import annotations

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.geometry import Meshcat, StartMeshcat
from pydrake.systems.framework import DiagramBuilder, LeafSystem, OutputPort

from proxops.diagrams.meshcat.camera_views import look_at_flight
from proxops.diagrams.meshcat.meshcat_scene import (
    Scene,
    add_body,
    add_goal,
    add_keep_out,
    add_plan,
    add_returns,
    add_spacecraft,
    move_spacecraft,
    prepare_scene,
)
from proxops.diagrams.scenario import Transit
from proxops.systems import Plan, PlanarLidar


def start_server() -> Meshcat:
    """A Meshcat that a browser can open, at `web_url()`."""
    return StartMeshcat()


class LiveView(LeafSystem):
    """Draws a flight into a Meshcat while it is simulated.

    ```
    position (3), m, K ───────────────►┌──────────┐
    force (3), N ─────────────────────►│ LiveView │
    ranges (planes * rays), m ────────►│          │
    plan (abstract Plan), if asked ───►└──────────┘
    ```
    """

    def __init__(
        self,
        scene: Scene,
        lidar: PlanarLidar,
        thrust_limit: float,
        period: float,
        with_plan: bool = False,
    ):
        """Takes the lidar that the ranges come from, the limit per axis in N, a period in s.

        `with_plan`: there is an input port `plan`, and its way is drawn.
        """
        super().__init__()
        self.scene, self._thrust_limit = scene, thrust_limit
        geometry = lidar.geometry
        self._shape = (geometry.planes, geometry.rays)
        self._position_port = self.DeclareVectorInputPort(name="position", size=3)
        self._force_port = self.DeclareVectorInputPort(name="force", size=3)
        self._ranges_port = self.DeclareVectorInputPort(name="ranges", size=geometry.size)
        self._plan_port = None
        if with_plan:
            model = AbstractValue.Make(None)
            self._plan_port = self.DeclareAbstractInputPort(name="plan", model_value=model)
        self.DeclarePeriodicPublishEvent(period_sec=period, offset_sec=0.0, publish=self._draw)

    def _draw(self, context) -> None:
        position = self._position_port.Eval(context)
        force = self._force_port.Eval(context)
        ranges = self._ranges_port.Eval(context).reshape(self._shape)
        move_spacecraft(self.scene, position, force, self._thrust_limit)
        add_returns(self.scene, "/lidar/now", position, ranges)
        if self._plan_port is not None:
            # A step's publish events come before its updates, at the same time: this is the plan
            # that the controller is about to remember, solved once and cached.
            plan: Plan = self._plan_port.Eval(context)
            add_plan(self.scene, plan.states[:, :3])


def add_live_view(
    builder: DiagramBuilder,
    transit: Transit,
    view: LiveView,
    sources: dict[str, OutputPort],
) -> None:
    """Sets the scene of a transit and feeds `view` from the ports named as its inputs are."""
    scene = view.scene
    prepare_scene(scene)
    add_body(scene)
    add_keep_out(scene)
    add_goal(scene, transit.goal)
    add_spacecraft(scene)
    look_at_flight(scene, np.stack([transit.start, transit.goal]))
    builder.AddNamedSystem("live_view", view)
    for name, port in sources.items():
        builder.Connect(port, view.GetInputPort(name))
