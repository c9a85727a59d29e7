"""The README is short and its links lead somewhere."""

import re

from pages import PAGES, README


def test_its_links_lead_somewhere() -> None:
    links = re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", PAGES["README.md"])
    for link in links:
        assert (README.parent / link).exists(), link


def test_its_links_to_sections_lead_somewhere() -> None:
    for page, anchor in re.findall(r"\]\((docs/[^)#]+)#([^)]+)\)", PAGES["README.md"]):
        headings = re.findall(r"^#+ (.*)$", PAGES[page], re.MULTILINE)
        anchors = {re.sub(r"[^\w\- ]", "", each).lower().replace(" ", "-") for each in headings}
        assert anchor in anchors, (page, anchor)
