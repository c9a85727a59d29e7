"""`sphere`: a ball's mesh of nearly equal facets."""

from __future__ import annotations

import numpy as np

from proxops.systems.mapping.free_surface import Mesh


def sphere(divisions: int) -> Mesh:
    """The unit sphere as an icosahedron whose facets are divided by four, so many times."""
    import trimesh  # It is slow to import, so only when it is needed.

    made = trimesh.creation.icosphere(divisions)
    return Mesh(np.array(made.vertices), np.array(made.faces))
