"""The README is short and its links lead somewhere."""

import re

from pages import PAGES, README, ROOT


def test_it_is_short() -> None:
    assert len(PAGES["README.md"].splitlines()) <= 80


def test_its_picture_is_small() -> None:
    (picture,) = re.findall(r"!\[[^\]]*\]\(([^)]+)\)", PAGES["README.md"])
    assert (ROOT / picture).stat().st_size <= 3_000_000


def test_its_links_lead_somewhere() -> None:
    links = re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", PAGES["README.md"])
    assert len(links) > 10
    for link in links:
        assert (README.parent / link).exists(), link


def test_its_links_to_sections_lead_somewhere() -> None:
    for page, anchor in re.findall(r"\]\((docs/[^)#]+)#([^)]+)\)", PAGES["README.md"]):
        headings = re.findall(r"^#+ (.*)$", PAGES[page], re.MULTILINE)
        anchors = {re.sub(r"[^\w\- ]", "", each).lower().replace(" ", "-") for each in headings}
        assert anchor in anchors, (page, anchor)


def test_it_has_six_lines_of_python() -> None:
    (code,) = re.findall(r"^```python\n(.*?)^```", PAGES["README.md"], re.DOTALL | re.MULTILINE)
    assert len([line for line in code.splitlines() if line]) <= 6
