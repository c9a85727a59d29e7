"""Makes a page of a Meshcat, and says how fast the flights on it are played."""

from __future__ import annotations

import html

from pydrake.geometry import Meshcat

PLAYBACK_SPEED = 160.0
"""How much faster than in real time a flight is played."""

FRAMES_PER_SECOND = 16.0


def page_with(meshcat: Meshcat, title: str, addition: str) -> str:
    """Gives a page of a Meshcat that needs no network.

    Args:
      meshcat: its scene, with the recording that was published last.
      title: of the page, as plain text.
      addition: HTML for the end of the page's body.
    """
    page = meshcat.StaticHtml()
    page = page.replace("<title>Drake MeshCat</title>", f"<title>{html.escape(title)}</title>", 1)
    head, end_of_body, tail = page.rpartition("</body>")
    return head + addition + end_of_body + tail
