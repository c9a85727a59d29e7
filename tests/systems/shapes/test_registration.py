"""Registration of one mesh on another: that it ends. Where it ends is tested beside true bodies."""

import numpy as np
import pytest

from proxops.systems.mapping.spheres import sphere
from proxops.systems.shapes import Polyhedron, registered, registration


def test_it_ends_where_steps_go_forth_and_back(monkeypatch: pytest.MonkeyPatch) -> None:
    """As at one map of Toutatis: by rounding, a step was always better than the best."""
    ball = sphere(3)
    body = Polyhedron(100.0 * ball.vertices, ball.facets)
    normals, calls = body.normals, iter(range(10_000))

    def planes(onto, tree, points):
        step = next(calls)
        return normals, (-1.0) ** step * (1.0 - 1e-12 * step) * normals[:, 0]

    monkeypatch.setattr(registration, "_nearest_planes", planes)
    found = registered(body, body)
    assert next(calls) < 15
    assert np.abs(found.vertices - body.vertices).max() < 1.1
