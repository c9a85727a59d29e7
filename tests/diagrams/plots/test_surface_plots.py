"""The plots of surface maps and equilibria show what was computed."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from matplotlib.axes import Axes

from proxops.diagrams.plots import surface_plots
from proxops.systems import GravityField, Polyhedron
from proxops.systems.gravity import find_equilibria, plane_cut

SPIN = 2e-4


@pytest.fixture(scope="module")
def field() -> GravityField:
    mesh = trimesh.creation.icosphere(subdivisions=2)
    shape = Polyhedron(mesh.vertices * [75e3, 50e3, 40e3], mesh.faces, "egg")
    return GravityField(shape, density=2000.0)


@pytest.mark.parametrize("view", surface_plots.VIEWS)
def test_surface_shows_the_facets_that_face_the_viewer(
    field: GravityField, ax: Axes, view: str
) -> None:
    axis = "xyz".index(view[1])
    towards = 1.0 if view[0] == "+" else -1.0
    values = towards * field.shape.vertices[field.shape.facets].mean(axis=1)[:, axis]
    surface = surface_plots.draw_surface(ax, field.shape, values, view, "gray")
    facing = int((towards * field.shape.normals[:, axis] > 0.0).sum())
    assert len(surface.get_paths()) == facing >= 150  # Of 320, but for those seen edge on.
    # Values grow towards the viewer, and the nearest are drawn last.
    grey = np.asarray(surface.get_facecolor())[:, 0]
    assert (np.diff(grey) >= 0.0).all()
    assert grey.min() > 0.45
    corners = np.concatenate([path.vertices for path in surface.get_paths()])
    right, up = ("xyz".index(name[1]) for name in surface_plots.VIEWS[view])
    expected = field.shape.extents[[right, up]] / 1e3
    np.testing.assert_allclose(np.ptp(corners, axis=0), expected, rtol=0.02)
    assert {ax.get_xlabel()[-5:], ax.get_ylabel()[-5:]} == {" (km)"}
    assert ax.get_aspect() == 1.0


def test_plane_cut_marks_the_equilibria_in_it(field: GravityField, ax: Axes) -> None:
    equilibria = find_equilibria(field, SPIN)
    cut = plane_cut(field, SPIN, 160e3, "xz", 61)
    surface_plots.draw_plane_cut(ax, cut, equilibria)
    marked = {
        text.get_text(): np.ravel(line.get_xydata())
        for text, line in zip(ax.texts, ax.lines, strict=True)
    }
    assert set(marked) == {"E1", "E3", "E5"}  # E2 and E4 are far from this plane.
    for name, place in marked.items():
        expected = equilibria[int(name[1]) - 1].position[[0, 2]] / 1e3
        np.testing.assert_allclose(place, expected, atol=1e-9)
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("x (km)", "z (km)")


def test_equilibria_are_one_page(field: GravityField, tmp_path: Path) -> None:
    figure = surface_plots.plot_equilibria(field, SPIN, "an egg", count=61)
    ax = figure.axes[0]
    assert [text.get_text() for text in ax.texts] == ["E1", "E2", "E3", "E4", "E5"]
    named = {text.get_text() for text in figure.legends[0].get_texts()}
    assert {"stable", "unstable, one growing mode"} <= named
    assert figure.get_suptitle() == "an egg"
    figure.savefig(tmp_path / "page.png", dpi=50)
    assert (tmp_path / "page.png").stat().st_size > 15_000
