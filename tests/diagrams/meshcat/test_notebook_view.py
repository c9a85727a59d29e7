"""Meshcat in a notebook: live where a browser comes to it, a whole page where none does."""

import html
import re
import socket
import sys
import types
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import trimesh
from short_flights import kleopatra
from synthetic_log import synthetic_log

from proxops.diagrams.meshcat import notebook_view
from proxops.diagrams.meshcat.lidar_scene import plane_edges
from proxops.diagrams.meshcat.meshcat_scene import quiet_meshcat
from proxops.diagrams.meshcat.notebook_view import (
    show_body,
    show_flight,
    show_meshcat,
)
from proxops.systems import Lidar, LidarErrors

POSITION = np.array([150e3, 40e3, 60e3])


class Notebook:
    """Collects what IPython shows under a cell; it may open the page as a browser does."""

    def __init__(self) -> None:
        self.address = self.page = ""
        self.opens: Callable[[], Any] | None = None

    def display(self, frame: str, display_id: bool) -> "Notebook":
        assert display_id
        self.address = frame
        if self.opens is not None:
            self.opens()
        return self

    def update(self, shown: str) -> None:
        (source,) = re.findall(r'srcdoc="([^"]*)"', shown)
        self.page = html.unescape(source)


@pytest.fixture
def notebook(monkeypatch: pytest.MonkeyPatch) -> Notebook:
    shown = Notebook()
    module: Any = types.ModuleType("IPython.display")
    module.HTML = str
    module.IFrame = lambda address, _width, _height: address
    module.display = shown.display
    monkeypatch.setitem(sys.modules, "IPython.display", module)
    monkeypatch.setattr(notebook_view, "_PATIENCE", 0.2)
    return shown


def test_without_a_browser_a_whole_page_takes_its_place(notebook: Notebook) -> None:
    meshcat = quiet_meshcat()
    page = "<p class=\"x\">a < b & 'c'</p>"
    show_meshcat(meshcat, page)
    assert notebook.address == meshcat.web_url()
    assert notebook.page == page
    show_meshcat(meshcat)
    assert notebook.page == meshcat.StaticHtml()


def test_a_browser_that_comes_keeps_the_live_page(
    notebook: Notebook, monkeypatch: pytest.MonkeyPatch
) -> None:
    meshcat = quiet_meshcat()
    with socket.create_connection(("localhost", meshcat.port())) as browser:
        lines = (
            "GET / HTTP/1.1", f"Host: localhost:{meshcat.port()}", "Upgrade: websocket",
            "Connection: Upgrade", "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==",
            "Sec-WebSocket-Version: 13", "", "",
        )  # fmt: skip
        notebook.opens = lambda: browser.sendall("\r\n".join(lines).encode())
        with monkeypatch.context() as patched:
            patched.setattr(notebook_view, "_PATIENCE", 20.0)
            show_meshcat(meshcat, "saved")
        assert notebook.address == meshcat.web_url()
        assert notebook.page == ""
        # Somebody who looks already is not a reader of this cell.
        notebook.opens = None
        show_meshcat(meshcat, "saved")
        assert notebook.page == "saved"


def test_flight_is_the_replay(notebook: Notebook) -> None:
    log = synthetic_log(30)
    meshcat = show_flight(log)
    assert meshcat.HasPath("/path/piece_000")
    assert f"<title>{log.body.config.name}, hybrid</title>" in notebook.page
    assert 'id="legend"' in notebook.page


def test_body_with_markers(notebook: Notebook) -> None:
    meshcat = show_body(kleopatra(), np.array([[150e3, 0.0, 0.0], [0.0, 110e3, 0.0]]))
    assert all(meshcat.HasPath(name) for name in ("/body", "/keep_out", "/markers/2"))
    assert not meshcat.HasPath("/markers/3")
    assert not show_body(kleopatra()).HasPath("/markers")


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
