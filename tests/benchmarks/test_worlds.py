"""Worlds of another form than is told: their true surfaces, and who is told what."""

from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import trimesh
from scripts import load_script
from short_flights import kleopatra

from proxops.diagrams.scenario import draw_world, load_scenario, of_transit
from proxops.systems.shapes import Polyhedron


@pytest.fixture(scope="module")
def worlds() -> ModuleType:
    return load_script("benchmarks/_worlds.py")


def test_curved_facets_of_a_ball_lie_on_it(worlds: ModuleType) -> None:
    """The middles of its edges: they are far less off than the edges themselves."""
    ball = trimesh.creation.icosphere(subdivisions=2, radius=1e3)
    found = worlds.curved(Polyhedron(ball.vertices, ball.faces))
    assert len(found.facets) == 4 * len(ball.faces)
    assert found.to_trimesh().is_winding_consistent
    chords = ball.vertices[ball.edges_unique].mean(axis=1)
    sunken = 1e3 - np.linalg.norm(chords, axis=1).min()
    left = np.abs(1e3 - np.linalg.norm(found.vertices, axis=1)).max()
    assert left < 0.1 * sunken
    whole = 4.0 / 3.0 * np.pi * 1e9  # Of which facets half as wide leave out a quarter as much.
    assert (whole - found.volume) / (whole - ball.volume) == pytest.approx(0.25, abs=0.1)


def test_only_relief_is_told(worlds: ModuleType, tmp_path: Path) -> None:
    told = "after_survey"
    scenario = load_scenario(None, {"dispersions": told, "assurance": {"bounds": told}})
    drawn = draw_world(of_transit(scenario, 7, 0), kleopatra())
    for name, changed in worlds.other_forms(scenario, kleopatra(), tmp_path).items():
        flown = worlds.changed_world(drawn, kleopatra(), changed)
        assert flown != drawn
        assert (flown.navigation == drawn.navigation) != name.endswith("told as relief")
        assert flown.assurance == drawn.assurance
