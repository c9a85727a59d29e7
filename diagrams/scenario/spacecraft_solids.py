"""The solids of a rigid spacecraft, by which it is drawn."""

from __future__ import annotations

import typing
from dataclasses import dataclass

import numpy as np
from pydrake.geometry import Box, Rgba, Shape
from pydrake.math import RigidTransform, RotationMatrix

from proxops.diagrams.scenario.spacecraft_model import SpacecraftModel
from proxops.systems.common import Vectors3

CORNERS = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1).T
"""The corners (8, 3) of a cube of edges of 2, in the order of `Solid.corners`."""


@dataclass(frozen=True)
class Solid:
    """A solid of a spacecraft."""

    shape: Shape
    """In m."""
    pose: RigidTransform
    """In S, in m."""
    corners: Vectors3
    """(8, 3) in m in S: of a box about the solid."""
    colour: Rgba | None
    """None: the file gives none."""


def solids_of(model: SpacecraftModel) -> list[Solid]:
    """Gives the visual geometry of a spacecraft's URDF or SDF.

    Where that has none, or names meshes that Drake cannot read, it is one box with the mass and the
    inertia of the spacecraft: a picture does not end a flight.
    """
    try:
        return _visuals(model) or [_equal_box(model)]
    except RuntimeError:
        return [_equal_box(model)]


def _visuals(model: SpacecraftModel) -> list[Solid]:
    """The visual geometry of a URDF or SDF. Drake raises `RuntimeError` where it cannot read it."""
    # Slow to import, and only a rigid spacecraft needs it.
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
    from pydrake.systems.framework import DiagramBuilder

    plant, graph = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.0)
    (instance,) = Parser(plant).AddModels(str(model.path.parent / model.config.bus))
    plant.Finalize()
    context, inspector = plant.CreateDefaultContext(), graph.model_inspector()
    bodies = [plant.get_body(index) for index in plant.GetBodyIndices(instance)]
    root, centre = bodies[0].body_frame(), RigidTransform(-_untyped(model.centre_of_mass))
    solids = []
    for body in bodies:
        pose = centre @ plant.CalcRelativeTransform(context, root, body.body_frame())
        for geometry in plant.GetVisualGeometriesForBody(body):
            place = pose @ inspector.GetPoseInFrame(geometry)
            box = inspector.GetObbInGeometryFrame(geometry)
            look = inspector.GetIllustrationProperties(geometry)
            solids.append(
                Solid(
                    inspector.GetShape(geometry),
                    place,
                    _corners(place @ box.pose(), box.half_width()),
                    look.GetPropertyOrDefault("phong", "diffuse", None),
                )
            )
    return solids


def _equal_box(model: SpacecraftModel) -> Solid:
    """The box of even density that has the mass and the inertia of a spacecraft."""
    moments, axes = np.linalg.eigh(model.inertia)
    axes[:, 2] *= np.linalg.det(axes)
    squares = 12.0 * (moments.sum() / 2.0 - moments) / model.mass
    edges = np.sqrt(np.maximum(squares, 1e-4 * squares.max()))
    pose = RigidTransform(RotationMatrix(_untyped(axes)), np.zeros(3))
    return Solid(Box(*edges), pose, _corners(pose, edges / 2.0), None)


def _corners(pose: RigidTransform, half: np.ndarray) -> Vectors3:
    """The corners (8, 3) of a box of half the edges (3,) in m, at a pose."""
    return (pose @ _untyped((CORNERS * half).T)).T


def _untyped(array: np.ndarray) -> typing.Any:
    """The type stubs of Drake do not know array shapes."""
    return array
