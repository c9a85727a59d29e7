"""The shape of a body: closed triangle meshes, ellipsoids around them, and rays cast at them.

Start with `Polyhedron`, the mesh that gravity, lidar and flight monitor share, and `read_mesh`,
which reads mesh files. `mesh_checks` finds what is wrong with a mesh and `mesh_repair` repairs it.
`ellipsoid` has the geometry of the keep-out ellipsoid, and `RayCaster` casts rays, also at a
`Surface`, which need not close. A true body that
differs from its map is made by `displaced`, a smooth random displacement of the surface, or
`registered`, which moves another mesh of the body onto the map; `halves` cuts a body in two. Almost
everything is a plain function on arrays; nothing here knows gravity, spacecraft or Drake's systems.
A new check of meshes belongs in `mesh_checks`, a new repair in `mesh_repair`.
"""

from proxops.systems.shapes._text_meshes import LONGITUDES
from proxops.systems.shapes.boulders import (
    HEIGHT,
    BouldersConfig,
    relief_of,
    with_boulders,
    with_lone_boulder,
)
from proxops.systems.shapes.displacement import (
    displaced,
    rigid_motions,
    roughened,
    vertex_normals,
)
from proxops.systems.shapes.ellipsoid import (
    blocks_segment,
    clearances,
    closest_point,
    ellipsoidal_norms,
    normal_below,
    outward_normals,
    squared_norm,
    tangent_half_spaces,
)
from proxops.systems.shapes.enclosing_ellipsoid import EnclosingEllipsoid, smallest_ellipsoid
from proxops.systems.shapes.mass import MassProperties, mass_properties
from proxops.systems.shapes.mesh_checks import (
    Defect,
    areas,
    find_defects,
    flat_facets,
    nested_shells,
    shell_labels,
    smallest_angles,
)
from proxops.systems.shapes.mesh_repair import repair_mesh
from proxops.systems.shapes.plane_split import halves
from proxops.systems.shapes.polyhedron import Polyhedron
from proxops.systems.shapes.ray_casting import RayCaster, RayFan, ray_caster
from proxops.systems.shapes.registration import greatest_gap, registered
from proxops.systems.shapes.self_intersection import self_intersections
from proxops.systems.shapes.shape_files import (
    MESH_FORMATS,
    MeshFile,
    mesh_bytes,
    metres_per,
    read_mesh,
)
from proxops.systems.shapes.surface import Surface

__all__ = [
    "HEIGHT",
    "LONGITUDES",
    "MESH_FORMATS",
    "BouldersConfig",
    "Defect",
    "EnclosingEllipsoid",
    "MassProperties",
    "MeshFile",
    "Polyhedron",
    "RayCaster",
    "RayFan",
    "Surface",
    "areas",
    "blocks_segment",
    "clearances",
    "closest_point",
    "displaced",
    "ellipsoidal_norms",
    "find_defects",
    "flat_facets",
    "greatest_gap",
    "halves",
    "mass_properties",
    "mesh_bytes",
    "metres_per",
    "nested_shells",
    "normal_below",
    "outward_normals",
    "ray_caster",
    "read_mesh",
    "registered",
    "relief_of",
    "repair_mesh",
    "rigid_motions",
    "roughened",
    "self_intersections",
    "shell_labels",
    "smallest_angles",
    "smallest_ellipsoid",
    "squared_norm",
    "tangent_half_spaces",
    "vertex_normals",
    "with_boulders",
    "with_lone_boulder",
]
