"""A ball to stay clear of, and balls that pull as point masses, for tests of the backup braking."""

import functools

import numpy as np
import trimesh

from proxops.systems import FlightLimits, GravityField, Polyhedron

RADIUS, MASS, THRUST = 50e3, 100.0, 7.0
PUSH = THRUST / MASS
BALL = FlightLimits(MASS, THRUST, 40.0, np.full(3, RADIUS))


@functools.cache
def ball_field(mass: float, radius: float) -> GravityField:
    """The field of a ball of many facets: a point mass, but for its sixth degree and higher ones.

    From 1.6 radii on they are below a ten-thousandth of it.
    """
    mesh = trimesh.creation.icosphere(3, radius)
    return GravityField(Polyhedron(mesh.vertices, mesh.faces, "a ball"), mass=mass)


def no_gravity() -> GravityField:
    """As good as none: a grain that pulls with less than 3e-17 m/s^2 at the ball's surface."""
    return ball_field(1e3, 1.0)
