"""`SceneLidar`: a lidar for any diagram: rays of one's own, over surfaces that may move."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import LeafSystem

from proxops.systems.common import InputError, SeededSystem, check_type
from proxops.systems.lidar.lidar_errors import (
    LidarErrors,
    TrueReturns,
    check_false_returns,
    check_rays,
    received_ranges,
)
from proxops.systems.lidar.planar_lidar import point_cloud
from proxops.systems.shapes import RayCaster, Surface

if TYPE_CHECKING:
    from pydrake.multibody.tree import Frame, RigidBody


class SceneLidar(SeededSystem):
    """A lidar that rides on anything, over surfaces that may move.

    ```
    X_WS ────────►┌────────────┐
      (abstract)  │ SceneLidar ├─► ranges (rays), m; +inf: no return
    X_W<name> ───►│            ├─► point_cloud (abstract PointCloud), m, in the sensor's frame S;
      (abstract)  └────────────┘   only rays that returned
    ```

    Poses are `RigidTransform`s: that of the sensor's frame S in the world W, and one for each
    surface of the scene, by its name. A surface's port may stay unconnected: then its frame is W.
    A ray reads the nearest surface that it meets, from either side.

    Random numbers are those of `Lidar`: a pure function of (seed, step). A `BodyPose` gives the
    pose of a body of a `MultibodyPlant`, or of a frame that is fixed to one.
    """

    def __init__(
        self,
        scene: Mapping[str, Surface],
        directions: np.ndarray,
        max_range: float,
        errors: LidarErrors | None = None,
        period: float = 0.1,
        seed: int = 0,
    ):
        """Takes the surfaces and the rays.

        Args:
          scene: surfaces in m, each in a frame of its own, by name.
          directions: (R, 3) unit vectors in S, for instance `ray_directions`.
          max_range: in m; a surface beyond returns nothing.
          errors: by default none; beams of a width are not possible here.
          period: time between steps in s, of the random numbers.
          seed: default of the Context's parameter.

        Raises:
          InputError: there is no surface, or it is of another type; a direction is no unit vector,
            a number is not positive, the seed is negative, or the errors have a beam width.
        """
        super().__init__(period, seed)
        errors = LidarErrors() if errors is None else errors
        directions = np.array(directions, dtype=np.float64)
        check_type("SceneLidar", float, max_range=max_range)
        if not max_range > 0.0:
            raise InputError(f"SceneLidar needs a positive max_range, got {max_range}")
        check_type("SceneLidar", LidarErrors, errors=errors)
        check_type("SceneLidar", Mapping, scene=scene)
        for name, surface in scene.items():
            if not isinstance(surface, Surface):
                raise InputError(
                    f"SceneLidar: {name!r} is a {type(surface).__name__}, not a Surface or a "
                    "Polyhedron; Surface.from_trimesh takes a mesh of trimesh"
                )
        check_false_returns(errors, max_range)
        if not scene:
            raise InputError("SceneLidar needs at least one surface")
        if "S" in scene:
            raise InputError("SceneLidar: no surface can be called S: X_WS is the sensor's pose")
        check_rays(errors, "SceneLidar")
        if directions.ndim != 2 or directions.shape[1] != 3 or len(directions) == 0:
            raise InputError(f"directions must have shape (R, 3), got {directions.shape}")
        if not np.allclose(np.linalg.norm(directions, axis=1), 1.0, atol=1e-9):
            raise InputError("directions must be unit vectors")
        self.directions, self.max_range, self.errors = directions, max_range, errors
        self._fans = [RayCaster(surface).fan(directions) for surface in scene.values()]
        self._normals = [surface.normals for surface in scene.values()]
        still = AbstractValue.Make(RigidTransform())
        self._pose_port = self.DeclareAbstractInputPort("X_WS", still)
        self._scene_ports = [self.DeclareAbstractInputPort(f"X_W{name}", still) for name in scene]
        depends = {self.all_input_ports_ticket(), *self.seed_tickets()}
        self._ranges_port = self.DeclareVectorOutputPort(
            "ranges", len(directions), self._calc_ranges, depends
        )
        self.DeclareAbstractOutputPort(
            "point_cloud",
            lambda: AbstractValue.Make(point_cloud(np.zeros(0), np.zeros((0, 3)))),
            self._calc_point_cloud,
            depends,
        )

    def true_returns(
        self, sensor: RigidTransform, surfaces: list[RigidTransform | None]
    ) -> TrueReturns:
        """The rays that meet a surface, at any range, without the errors of ranges.

        Args:
          sensor: X_WS. surfaces: the pose of each surface in W; None: the identity.
        """
        count = len(self.directions)
        distances, cosines = np.full(count, np.inf), np.ones(count)
        grazing = self.errors.max_incidence < math.pi / 2.0
        for fan, normals, pose in zip(self._fans, self._normals, surfaces, strict=True):
            local = sensor if pose is None else pose.inverse() @ sensor
            rotation = local.rotation().matrix()
            hits = fan.hits(local.translation()[None], rotation)
            nearer = hits.distances < distances[hits.rays]
            rays, facets = hits.rays[nearer], hits.facets[nearer]
            distances[rays] = hits.distances[nearer]
            if grazing:
                along = self.directions[rays] @ rotation.T
                cosines[rays] = np.abs(np.einsum("ki,ki->k", normals[facets], along))
        rays = np.flatnonzero(distances < np.inf)
        flat = cosines[rays] < math.cos(self.errors.max_incidence) if grazing else None
        return TrueReturns(rays, distances[rays], flat)

    def _calc_ranges(self, context, output):
        poses = [
            port.Eval(context) if port.HasValue(context) else None for port in self._scene_ports
        ]
        returns = self.true_returns(self._pose_port.Eval(context), poses)
        seed, step = self.seed_of(context), self.step_of(context)
        count = len(self.directions)
        output.SetFromVector(
            received_ranges(returns, count, self.max_range, self.errors, seed, step)
        )

    def _calc_point_cloud(self, context, output):
        output.set_value(point_cloud(self._ranges_port.Eval(context), self.directions))


class BodyPose(LeafSystem):
    """The pose of a body of a `MultibodyPlant`, or of a frame that is fixed to one.

    ```
    poses ───────►┌──────────┐
      (abstract)  │ BodyPose ├─► X_WF (abstract RigidTransform)
                  └──────────┘
    ```

    `poses` is the plant's port `body_poses`. The frame's pose in its body is read once, when this
    system is made: one that is set in the plant's Context does not count.
    """

    def __init__(self, frame: RigidBody | Frame):
        """Takes the body, or a frame such as a `FixedOffsetFrame`, of a finalized plant.

        Raises:
          InputError: it is neither; an index of a body or of a frame is not enough.
        """
        # Slow to import, for this alone.
        from pydrake.multibody.plant import MultibodyPlant
        from pydrake.multibody.tree import Frame, RigidBody

        super().__init__()
        check_type("BodyPose", RigidBody, Frame, frame=frame)
        frame = frame.body_frame() if isinstance(frame, RigidBody) else frame
        index, offset = int(frame.body().index()), frame.GetFixedPoseInBodyFrame()
        # Drake has no other way to name a list of poses from Python.
        plant = MultibodyPlant(time_step=0.0)
        plant.Finalize()
        poses = plant.get_body_poses_output_port().Allocate()
        port = self.DeclareAbstractInputPort("poses", poses)
        self.DeclareAbstractOutputPort(
            "X_WF",
            lambda: AbstractValue.Make(RigidTransform()),
            lambda context, output: output.set_value(port.Eval(context)[index] @ offset),
            {port.ticket()},
        )
