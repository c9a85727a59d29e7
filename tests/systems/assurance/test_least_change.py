"""The least change of a command, where it can be computed otherwise."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from proxops.systems.assurance.least_change import Margin, Path, along_path, least_change

LIMIT, ENOUGH = 1.0, 1e-3
BOX = np.full(3, -LIMIT), np.full(3, LIMIT)
UNIT = st.floats(-1.0, 1.0).filter(lambda x: abs(x) > 0.05)


def nearest(margin: Margin, start: np.ndarray) -> np.ndarray | None:
    return least_change(margin, start, -margin(start), BOX, LIMIT, ENOUGH)


@given(normal=arrays(np.float64, 3, elements=UNIT), start=arrays(np.float64, 3, elements=UNIT))
def test_projects_onto_a_half_space(normal: np.ndarray, start: np.ndarray) -> None:
    """Safe where normal . u >= offset: the least change is along the normal, unless that is out."""
    start, normal = 0.5 * start, normal / np.linalg.norm(normal)
    shortfall = 0.2
    offset = normal @ start + shortfall
    found = nearest(lambda u: float(normal @ u - offset), start)
    assert found is not None
    expected = start + shortfall * normal
    assert normal @ found >= offset
    if np.abs(expected).max() < 0.9:
        np.testing.assert_allclose(found, expected, atol=0.03 * shortfall + ENOUGH)


def test_follows_a_curved_border() -> None:
    """Safe outside a ball: the second gradient brings it to the nearest point of the sphere."""
    centre, start = np.array([0.1, -0.2, 0.0]), np.array([0.3, 0.1, 0.2])

    def margin(u: np.ndarray) -> float:
        return float((u - centre) @ (u - centre)) - 0.36

    found = nearest(margin, start)
    assert found is not None
    away = start - centre
    expected = centre + 0.6 * away / np.linalg.norm(away)
    assert margin(found) >= 0.0
    np.testing.assert_allclose(found, expected, atol=0.02)


@pytest.mark.parametrize("margin", [lambda u: -1.0, lambda u: -math.inf, lambda u: u[0] - 2.0])
def test_says_so_where_nothing_is_safe(margin) -> None:
    assert nearest(margin, np.zeros(3)) is None


@given(border=st.floats(0.05, 0.95))
def test_path_ends_where_it_becomes_safe(border: float) -> None:
    toward = np.array([0.8, 0.0, 0.0])
    point, margin = along_path(
        lambda u: float(u[0]) / 0.8 - border,
        Path(np.zeros(3), toward, 1.0, 1.0),
        border,
        BOX,
        ENOUGH,
    )
    assert margin >= 0.0
    assert border <= point[0] / 0.8 <= border * 1.03 + ENOUGH + 1e-9


def test_path_without_a_known_start_is_halved() -> None:
    """Nothing is known about the start of the line, only that its end is safe."""
    point, margin = along_path(
        lambda u: 1.0 if u[0] > 0.3 else -math.inf,
        Path(np.zeros(3), np.array([0.8, 0.0, 0.0]), 1.0, 1.0),
        math.inf,
        BOX,
        ENOUGH,
    )
    assert margin == 1.0
    assert 0.3 < point[0] < 0.35
