"""Draws a rigid spacecraft: its solids as they are turned, flames, boresight and field of view.

Beside a body of kilometres a spacecraft of metres can't be seen, so it is drawn many times as
large: about as large as a point is drawn. All of it is below /spacecraft/turned, which has the axes
of S.
"""

from __future__ import annotations

import math
import typing

import numpy as np
import xarray as xr
from pydrake.geometry import Rgba
from pydrake.math import RigidTransform, RotationMatrix

from proxops.diagrams.meshcat.meshcat_scene import (
    HULL,
    SPACECRAFT_SIZE,
    THRUST,
    Scene,
    revolved,
    set_mesh,
)
from proxops.diagrams.scenario import (
    RigidBodyConfig,
    Scenario,
    Solid,
    TouchAndGoConfig,
    arm_solids,
    load_spacecraft,
    solids_of,
)
from proxops.systems.common import Values, Vector3, Vectors3, rotation_matrix

SIGHT = Rgba(1.00, 1.00, 1.00)
_FIELD = Rgba(1.00, 1.00, 1.00, 0.08)
# Lengths in Meshcat units: of the flame of a thruster that is on all the time, and its radius.
_FLAME_LENGTH, _FLAME_RADIUS = 0.30, 0.014
# The share below which a flame is not seen. A scale of zero would leave it without normals.
_SMALLEST = 1e-3
# How far the boresight is drawn where nothing looks at the body.
_AHEAD = 0.3
_NAME = "/spacecraft/turned"


class RigidView:
    """The picture of a rigid spacecraft in a scene."""

    def __init__(self, scene: Scene, scenario: Scenario):
        """Draws nothing yet; the scenario's spacecraft must be a rigid body."""
        settings = scenario.spacecraft
        assert isinstance(settings, RigidBodyConfig)
        self._scene, self._period = scene, scenario.attitude_period_s
        model = load_spacecraft(settings.model)
        self.thrusters, self._solids = model.thrusters, solids_of(model)
        if isinstance(scenario.task, TouchAndGoConfig):
            self._solids = [*self._solids, *arm_solids(scenario.task)]
        self._failure = scenario.truth.rigid_body
        boresight = np.array(settings.pointing.boresight)
        self._boresight = boresight / np.linalg.norm(boresight)
        self._points = settings.pointing.mode == "body"
        geometry = scenario.lidar_geometry
        self._field, self._rays = geometry.field_of_view, geometry.directions
        self.times = enlargement(self._solids, scene.unit)
        """How many times too large the spacecraft is drawn."""

    def add(self) -> None:
        """Adds solids, flames, boresight and field of view; see `move`."""
        meshcat, scale = self._scene.meshcat, self.times / self._scene.unit
        for number, solid in enumerate(self._solids):
            name = f"{_NAME}/solids/{number:02d}"
            meshcat.SetObject(name, solid.shape, solid.colour or HULL)
            meshcat.SetTransform(name, solid.pose)
        meshcat.SetProperty(f"{_NAME}/solids", "scale", [scale] * 3)
        points, facets = revolved(np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0]))
        points = points * [_FLAME_LENGTH, _FLAME_RADIUS, _FLAME_RADIUS]
        for number in range(self.thrusters.count):
            name = f"{_NAME}/flames/{number:02d}"
            set_mesh(meshcat, f"{name}/flame", points, facets, THRUST)
            place: typing.Any = scale * self.thrusters.places[number]
            # The force on the spacecraft is opposite to the flame.
            along: typing.Any = -self.thrusters.directions[number]
            meshcat.SetTransform(
                name, RigidTransform(RotationMatrix.MakeFromOneVector(along, 0), place)
            )
        self._add_sight()

    def _add_sight(self) -> None:
        """Adds boresight and field of view, as long as a unit."""
        meshcat = self._scene.meshcat
        line: typing.Any = np.stack([np.zeros(3), self._boresight], axis=1)
        meshcat.SetLine(f"{_NAME}/sight/boresight", line, 2.0, SIGHT)
        if self._field == 0.0:
            return
        half = math.tan(0.5 * self._field)
        corners = np.array([[half, half, 1], [-half, half, 1], [-half, -half, 1], [half, -half, 1]])
        facets = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 1]])
        name = f"{_NAME}/sight/field_of_view"
        set_mesh(meshcat, f"{name}/sides", np.vstack([np.zeros(3), corners]), facets, _FIELD)
        starts: typing.Any = np.zeros((3, 4))
        ends: typing.Any = corners.T
        meshcat.SetLineSegments(f"{name}/edges", starts, ends, 1.0, SIGHT)

    def rays(self, attitude: np.ndarray) -> np.ndarray:
        """Gives the directions (planes * rays, 3) in K of the lidar's rays, at R_KS (4,)."""
        return self._rays @ rotation_matrix(attitude).T

    def shares(self, on_times: Vectors3, times: Values) -> Vectors3:
        """Gives the share (N, n) of the attitude period in which thrusters truly burned.

        Args:
          on_times: (N, n) in s, as commanded. times: (N,) in s, of the ends of the periods.
        """
        shares = on_times / self._period
        if 0 <= self._failure.failed_thruster < self.thrusters.count:
            failed = times > self._failure.failure_time_s
            shares[failed, self._failure.failed_thruster] = 0.0
        return shares

    def move(
        self,
        position: Vector3,
        attitude: np.ndarray,
        time_in_recording: float | None = None,
    ) -> None:
        """Moves and turns the spacecraft, and lets what looks at the body reach its centre.

        Args:
          position: (3,) in K, in m. attitude: R_KS (4,) as a unit quaternion (w, x, y, z).
          time_in_recording: time in s in the animation; None: now.
        """
        meshcat = self._scene.meshcat
        meshcat.SetTransform("/spacecraft", self._scene.pose(position), time_in_recording)
        turn: typing.Any = rotation_matrix(attitude)
        meshcat.SetTransform(
            _NAME, RigidTransform(RotationMatrix(turn), np.zeros(3)), time_in_recording
        )
        looks = self._points or self._field > 0.0
        reach = float(np.linalg.norm(position)) / self._scene.unit if looks else _AHEAD
        meshcat.SetProperty(f"{_NAME}/sight", "scale", [reach] * 3, time_in_recording)

    def burn(self, thruster: int, share: float, time_in_recording: float | None = None) -> None:
        """Sets a flame: its length is proportional to the share of time in which it burns."""
        wide = max(math.sqrt(share), _SMALLEST)
        scale = [max(share, _SMALLEST), wide, wide]
        name = f"{_NAME}/flames/{thruster:02d}/flame"
        self._scene.meshcat.SetProperty(name, "scale", scale, time_in_recording)


def record_flight(view: RigidView, data: xr.Dataset, shown: np.ndarray) -> None:
    """Records the motion and the flames of a log at the times shown (N,) in s."""
    positions, attitudes = data["state"].values[:, :3], data["attitude"].values
    view.add()
    # A page that does not play shows the end of the flight.
    view.move(positions[-1], attitudes[-1])
    for position, attitude, time in zip(positions, attitudes, shown, strict=True):
        view.move(position, attitude, float(time))
    shares = view.shares(data["on_times"].values, data["time"].values)
    for thruster, burnt in enumerate(shares.T):
        view.burn(thruster, 0.0)
        # Between two equal ones a flame needs no key.
        changes = np.flatnonzero(np.diff(burnt))
        for row in np.unique(np.concatenate([[0], changes, changes + 1])):
            view.burn(thruster, float(burnt[row]), float(shown[row]))


def enlargement(solids: list[Solid], unit: float) -> float:
    """Gives how many times too large a spacecraft is drawn: a number with one digit.

    Args:
      solids: of the spacecraft. unit: length of a Meshcat unit in m.
    """
    corners = np.concatenate([solid.corners for solid in solids])
    return float(f"{max(1.0, SPACECRAFT_SIZE * unit / np.ptp(corners, axis=0).max()):.0e}")
