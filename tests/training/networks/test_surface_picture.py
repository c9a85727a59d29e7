"""The picture of the learned surface shows the field's zero level and the mesh's outline."""

from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.contour import QuadContourSet
from matplotlib.figure import Figure
from short_flights import kleopatra

from proxops.training.networks.geometry_layer import SurfaceField
from proxops.training.networks.surface_picture import plot_cut

HIGH = np.array([120e3, 60e3, 40e3])
PLANES = [("xy", 0, 1), ("xz", 0, 2), ("yz", 1, 2)]


def drawn(ax: Axes, kind: type) -> np.ndarray:
    """All vertices (N, 2) that collections of a kind draw."""
    found: Any
    (found,) = [artist for artist in ax.collections if type(artist) is kind]
    return np.concatenate([path.vertices for path in found.get_paths()])


@pytest.mark.parametrize(("plane", "across", "up"), PLANES)
def test_a_new_field_is_an_ellipsoid(plane: str, across: int, up: int) -> None:
    """With 0.8 of the box as its axes, in closed form, and within a grid's spacing."""
    field = SurfaceField(-HIGH, HIGH, 4e3)
    ax = Figure().subplots()
    plot_cut(ax, field, kleopatra(), plane)
    points = 1e3 * drawn(ax, QuadContourSet)
    level = np.linalg.norm(points / (0.8 * HIGH[[across, up]]), axis=1)
    np.testing.assert_allclose(level, 1.0, atol=0.03)


@pytest.mark.parametrize(("plane", "across", "up"), PLANES)
def test_mesh_is_cut(plane: str, across: int, up: int) -> None:
    """Both ends of each segment lie on the surface: no field point is nearer to inside."""
    shape = kleopatra().shape
    ax = Figure().subplots()
    plot_cut(ax, SurfaceField(-HIGH, HIGH, 20e3), kleopatra(), plane)
    ends = 1e3 * drawn(ax, LineCollection)
    assert len(ends) > 50
    points = np.zeros((len(ends), 3))
    points[:, [across, up]] = ends
    corners = shape.vertices[shape.facets[:, 0]]
    off = np.einsum("pfi,fi->pf", points[:, None] - corners, shape.normals)
    assert np.abs(off).min(axis=1).max() < 1.0
