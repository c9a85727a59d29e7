"""The picture of places that can be touched."""

import numpy as np
import trimesh

from proxops.diagrams.plots import plot_sites
from proxops.systems.shapes import Polyhedron
from proxops.systems.touch import SiteLimits, SiteWorld, map_sites, use_of_limits


def test_colours_and_numbers() -> None:
    mesh = trimesh.creation.icosphere(2, 100.0)
    shape, limits = Polyhedron(mesh.vertices, mesh.faces), SiteLimits(slope_deg=10.0)
    # Gravity along -z: the polar cap of 10 degrees can be touched.
    world = SiteWorld(lambda at: np.tile([0.0, 0, -1e-4], (len(at), 1)), 100.0, np.zeros((0, 3)))
    sites, _ = map_sites(shape, limits, world)
    worst = use_of_limits(sites, limits, 7.0).max(axis=1)
    best = np.array([int(worst.argmin())])
    figure = plot_sites(shape, sites, worst, best, "a ball")
    views = {ax.get_title(): ax for ax in figure.axes}
    top, bottom = views["from +z"], views["from -z"]
    assert [text.get_text() for text in top.texts] == ["1"]
    assert [text.get_text() for text in bottom.texts] == []
    colours = np.asarray(top.collections[0].get_facecolor())
    green = colours[:, 1] > colours[:, 0]
    # Of the cap of 10 degrees, over that of the half ball seen: 1 - cos 10.
    assert 0.005 < green.mean() < 0.03
    assert not (np.asarray(bottom.collections[0].get_facecolor())[:, 1] > 0.5).any()
