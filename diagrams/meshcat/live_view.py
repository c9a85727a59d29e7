"""Shows a flight in a browser while it is simulated, with Drake's Meshcat."""

from __future__ import annotations

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import LeafSystem

from proxops.diagrams.meshcat.camera_views import look_at_flight
from proxops.diagrams.meshcat.meshcat_scene import (
    Scene,
    add_goal,
    add_plan,
    add_returns,
    add_spacecraft,
    move_axes,
    move_moons,
    move_spacecraft,
    prepare_scene,
)
from proxops.diagrams.meshcat.navigation_scene import (
    add_navigation,
    exaggeration,
    move_navigation,
    region_of,
)
from proxops.diagrams.meshcat.rigid_scene import RigidView
from proxops.diagrams.scenario import Transit
from proxops.systems import Plan, PlanarLidar


class LiveView(LeafSystem):
    """Draws a flight into a Meshcat while it is simulated.

    ```
    position (3), m, K ───────────────────►┌──────────┐
    force (3), N, along the axes of S ────►│ LiveView │
    ranges (planes * rays), m ────────────►│          │
    plan (abstract Plan), if asked ───────►│          │
    navigation_state (6), if asked ───────►│          │
    navigation_covariance (81), if asked ─►│          │
    navigation_return_use, if asked ──────►│          │
    attitude (4), if rigid ───────────────►│          │
    on_times (n), s, if rigid ────────────►└──────────┘
    ```

    The force of a point is drawn along the axes of K, which S holds to within its attitude error;
    a rigid spacecraft is drawn turned, with the flames of its thrusters. Errors of
    the navigation are enlarged, by a factor that keeps its ellipsoid of three standard deviations
    at about the same size.
    """

    def __init__(
        self,
        scene: Scene,
        lidar: PlanarLidar,
        thrust_limit: float,
        period: float,
        with_plan: bool = False,
        with_navigation: bool = False,
        rigid: RigidView | None = None,
    ):
        """Declares the input ports.

        Args:
          scene: the scene to draw in.
          lidar: the source of the ranges.
          thrust_limit: greatest force per axis in N.
          period: time in s from one picture to the next.
          with_plan: whether there is an input port `plan`, whose path is drawn.
          with_navigation: whether there are input ports of what the navigation knows.
          rigid: the picture of the rigid spacecraft, which has more input ports; None: a point.
        """
        super().__init__()
        self.scene, self._thrust_limit = scene, thrust_limit
        geometry = lidar.geometry
        self._shape, self._rays = (geometry.planes, geometry.rays), geometry.directions
        self._position_port = self.DeclareVectorInputPort(name="position", size=3)
        self._force_port = self.DeclareVectorInputPort(name="force", size=3)
        self._ranges_port = self.DeclareVectorInputPort(name="ranges", size=geometry.size)
        self._plan_port = None
        if with_plan:
            model = AbstractValue.Make(None)
            self._plan_port = self.DeclareAbstractInputPort(name="plan", model_value=model)
        self._navigation_ports = []
        if with_navigation:
            self._navigation_ports = [
                self.DeclareVectorInputPort(name="navigation_state", size=6),
                self.DeclareVectorInputPort(name="navigation_covariance", size=81),
                self.DeclareVectorInputPort(name="navigation_return_use", size=geometry.size),
            ]
        self.rigid = rigid
        if rigid is not None:
            self._attitude_port = self.DeclareVectorInputPort(name="attitude", size=4)
            n = rigid.thrusters.count
            self._times_port = self.DeclareVectorInputPort(name="on_times", size=n)
        self.DeclarePeriodicPublishEvent(period_sec=period, offset_sec=0.0, publish=self._draw)

    def _draw(self, context) -> None:
        move_axes(self.scene, context.get_time())
        move_moons(self.scene, context.get_time())
        position = self._position_port.Eval(context)
        ranges = self._ranges_port.Eval(context).reshape(self._shape)
        rays = self._rays
        if self.rigid is None:
            force = self._force_port.Eval(context)
            move_spacecraft(self.scene, position, force, self._thrust_limit)
        else:
            attitude = self._attitude_port.Eval(context)
            rays = self.rigid.rays(attitude)
            self.rigid.move(position, attitude)
            on_times, time = self._times_port.Eval(context), np.array([context.get_time()])
            for thruster, share in enumerate(self.rigid.shares(on_times[None], time)[0]):
                self.rigid.burn(thruster, float(share))
        if self._plan_port is not None:
            # Publish events run before the updates of the same time. So this is the plan that the
            # controller will store; it is cached, and not solved again.
            plan: Plan = self._plan_port.Eval(context)
            add_plan(self.scene, plan.states[:, :3])
        use = None
        if self._navigation_ports:
            state, covariance, use = (port.Eval(context) for port in self._navigation_ports)
            block = covariance.reshape(9, 9)[:3, :3]
            region = region_of((state[:3] - position)[None], block[None])
            move_navigation(self.scene, position, region, 0, exaggeration(region, self.scene.unit))
        add_returns(self.scene, "/lidar/now", position, ranges, rays, use)


def prepare_live_view(view: LiveView, transit: Transit) -> None:
    """Draws the scene of a transit, in which `view` then draws the flight."""
    scene = view.scene
    prepare_scene(scene)
    add_goal(scene, transit.goal)
    for leftover in ("/lidar", "/navigation", "/spacecraft"):  # Of an earlier flight.
        scene.meshcat.Delete(leftover)
    if view.rigid is None:
        add_spacecraft(scene)
    else:
        view.rigid.add()
    if view.HasInputPort("navigation_state"):
        add_navigation(scene)
    look_at_flight(scene, np.stack([transit.start, transit.goal]))
