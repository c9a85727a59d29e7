"""Gravity of a mesh by other packages, which come with the extra `bench`."""

from proxops.systems import GravityField
from proxops.systems.gravity import GRAVITATIONAL_CONSTANT


def esa_model(field: GravityField):
    """ESA's polyhedral-gravity: called with a point, it gives potential, acceleration, tensor."""
    import polyhedral_gravity as esa

    shape = field.shape
    off = esa.PolyhedronIntegrity.DISABLE
    source = (shape.vertices, shape.facets)
    return esa.GravityEvaluable(esa.Polyhedron(source, field.density, integrity_check=off))


def basilisk_model(field: GravityField):
    """Basilisk's polyhedral gravity: `computeField` takes a point as a column."""
    from Basilisk.simulation import gravityEffector

    model = gravityEffector.PolyhedralGravityModel()
    model.xyzVertex = field.shape.vertices.tolist()
    model.orderFacet = (field.shape.facets + 1).tolist()
    model.muBody = GRAVITATIONAL_CONSTANT * field.mass
    model.initializeParameters()
    return model
