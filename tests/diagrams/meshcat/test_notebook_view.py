"""Meshcat in a notebook: whole pages, which stay when the notebook is saved."""

import html
import re
import sys
import types
from typing import Any

import numpy as np
import pytest
import trimesh
from meshcat_pages import messages
from short_flights import kleopatra
from synthetic_log import synthetic_log

from proxops.diagrams.meshcat.lidar_scene import plane_edges
from proxops.diagrams.meshcat.notebook_view import show_body, show_flight, show_page
from proxops.systems import InputError, Lidar, LidarErrors

POSITION = np.array([150e3, 40e3, 60e3])


@pytest.fixture
def pages(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What IPython shows under a cell, one page after the other."""
    shown: list[str] = []

    def display(content: str) -> None:
        (source,) = re.findall(r'srcdoc="([^"]*)"', content)
        shown.append(html.unescape(source))

    module: Any = types.ModuleType("IPython.display")
    module.HTML, module.display = str, display
    monkeypatch.setitem(sys.modules, "IPython.display", module)
    return shown


def test_flight_is_the_replay(pages: list[str]) -> None:
    log = synthetic_log(30)
    show_flight(log)
    assert f"<title>{log.body.config.name}, hybrid</title>" in pages[0]
    assert 'id="legend"' in pages[0]


def test_elsewhere_it_says_what_to_use(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "IPython.display", None)
    with pytest.raises(InputError, match=r"for notebooks .*write_replay"):
        show_page("")


def test_body_with_markers(pages: list[str]) -> None:
    show_body(kleopatra(), np.array([[150e3, 0.0, 0.0], [0.0, 110e3, 0.0]]))
    show_body(kleopatra())
    marked, plain = (b"".join(messages(page)) for page in pages)
    for name in (b"/body", b"/keep_out", b"/markers/2"):
        assert name in marked
    assert b"/markers/3" not in marked
    assert b"/markers" not in plain


def test_rays_end_on_the_body_or_short_of_its_distance() -> None:
    shape = kleopatra().shape
    frame = Lidar(shape, LidarErrors()).frames(np.zeros(1), POSITION[None], seed=0)[0]
    mesh, hits = shape.to_trimesh(), np.isfinite(frame[1])
    assert 0 < hits.sum() < hits.size
    ends = plane_edges(POSITION, frame, 1)
    off = trimesh.proximity.closest_point(mesh, ends[hits])[1]
    assert off.max() < 1.0
    lengths = np.linalg.norm(ends[~hits] - POSITION, axis=1)
    np.testing.assert_allclose(lengths, 0.9 * np.linalg.norm(POSITION))
    # Plane 1 holds the z axis and is turned by 15 degrees about it.
    normal = np.array([-np.sin(np.radians(15)), np.cos(np.radians(15)), 0.0])
    np.testing.assert_allclose((ends - POSITION) @ normal, 0.0, atol=1e-3)
