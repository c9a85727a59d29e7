"""The benchmark of errors of another form: its true surfaces, and who is told what."""

from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import trimesh
from scripts import load_script
from short_flights import kleopatra

from proxops.diagrams.scenario import draw_world, load_scenario, of_transit
from proxops.systems.shapes import Polyhedron
from proxops.systems.shapes.self_intersection import self_intersections


@pytest.fixture(scope="module")
def forms() -> ModuleType:
    return load_script("benchmarks/other_forms.py")


def test_boulders_are_few_and_high(forms: ModuleType) -> None:
    shape = kleopatra().shape
    found = forms.boulders(shape, 1)
    heights = np.linalg.norm(found.vertices - shape.vertices, axis=1)
    weights = np.bincount(shape.facets.ravel(), np.repeat(shape.to_trimesh().area_faces, 3))
    assert np.sqrt(weights @ heights**2 / weights.sum()) == pytest.approx(109.4, rel=1e-3)
    assert heights.max() > 5.0 * 109.4
    assert weights[heights > 50.0].sum() < 0.2 * weights.sum()
    assert len(self_intersections(found.vertices, found.facets)) == 0


def test_curved_facets_of_a_ball_lie_on_it(forms: ModuleType) -> None:
    """The middles of its edges: they are far less off than the edges themselves."""
    ball = trimesh.creation.icosphere(subdivisions=2, radius=1e3)
    found = forms.curved(Polyhedron(ball.vertices, ball.faces))
    assert len(found.facets) == 4 * len(ball.faces)
    assert found.to_trimesh().is_winding_consistent
    chords = ball.vertices[ball.edges_unique].mean(axis=1)
    sunken = 1e3 - np.linalg.norm(chords, axis=1).min()
    left = np.abs(1e3 - np.linalg.norm(found.vertices, axis=1)).max()
    assert left < 0.1 * sunken
    whole = 4.0 / 3.0 * np.pi * 1e9  # Of which facets half as wide leave out a quarter as much.
    assert (whole - found.volume) / (whole - ball.volume) == pytest.approx(0.25, abs=0.1)


def test_what_is_told_is_the_same_in_every_line(forms: ModuleType, tmp_path: Path) -> None:
    scenario = load_scenario(None, {"dispersions": forms.TOLD, "assurance": {"bounds": forms.TOLD}})
    drawn = draw_world(of_transit(scenario, 7, 0), kleopatra())
    lines = forms.changes(forms.surfaces(kleopatra(), tmp_path), kleopatra(), scenario)
    for name, changed in lines.items():
        flown = forms.world(drawn, kleopatra(), changed)
        assert (flown == drawn) == (name == forms.AS_TOLD)
        assert flown.navigation == drawn.navigation
        assert flown.assurance == drawn.assurance
