"""Reports as pages: well-formed, self-contained, and what was put in comes out."""

import base64
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from proxops.systems import InputError
from proxops.training.reports.figure_text import interval_text
from proxops.training.reports.report import Section, Table, Text, html_page, picture, write_report

AWKWARD = "a < b & \"c\" | *d* _e_ `f` [g](h) <script>alert('x')</script>"
VOID = {"meta", "img"}


class Page(HTMLParser):
    """The text, tags and addresses of a page; fails where tags don't match."""

    def __init__(self, page: str):
        super().__init__()
        self.open: list[str] = []
        self.tags: list[str] = []
        self.addresses: list[str] = []
        self.words: list[str] = []
        self.cells: list[list[str]] = []
        self.feed(page)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        if tag not in VOID:
            self.open.append(tag)
        self.addresses += [value or "" for name, value in attrs if name in ("src", "href")]
        if tag == "tr":
            self.cells.append([])
        if tag in ("td", "th"):
            self.cells[-1].append("")

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] in ("td", "th"):
            self.cells[-1][-1] += data
        elif self.open and self.open[-1] != "style":
            self.words.append(data.strip())


@pytest.fixture(scope="module")
def sections() -> list[Section]:
    figure = Figure(figsize=(2.0, 1.0))
    figure.subplots().plot([0.0, 1.0])
    table = Table(["", "one", AWKWARD], [["first", "1", "2"], [AWKWARD, "3", "4"]])
    return [
        Section("Words", [Text(AWKWARD), Text("proxops evaluate --set 'a=b'", code=True)]),
        Section(AWKWARD, [table, picture("a-line", figure, AWKWARD)]),
    ]


def test_html_holds_everything_and_asks_for_nothing(sections: list[Section]) -> None:
    text = html_page("A title", sections)
    page = Page(text)
    assert "script" not in page.tags
    [address] = page.addresses
    kind, data = address.split(",")
    assert kind == "data:image/png;base64"
    assert base64.b64decode(data).startswith(b"\x89PNG")
    assert not re.search(r"https?://|@import|url\(", text.replace(address, ""))
    assert page.words.count("A title") == 2
    assert page.words.count(AWKWARD) == 3  # A paragraph, a heading, a caption.
    assert "proxops evaluate --set 'a=b'" in page.words
    assert page.cells == [["", "one", AWKWARD], ["first", "1", "2"], [AWKWARD, "3", "4"]]


def test_files(sections: list[Section], tmp_path: Path) -> None:
    folder = tmp_path / "a" / "report"
    write_report(folder, "Title", sections)
    assert (folder / "report.html").read_text() == html_page("Title", sections)
    text = (folder / "report.md").read_text()
    [shown] = re.findall(r"\]\((figures/.*?)\)$", text, re.MULTILINE)
    assert (folder / shown).read_bytes().startswith(b"\x89PNG")
    assert {path.name for path in folder.iterdir()} == {"report.html", "report.md", "figures"}
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot make the folder"):
        write_report(tmp_path / "file", "Title", sections)


# --- figures in tables ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("interval", "text"),
    [
        ((0.981725, 1.0), "98.2–100.0 %"),
        ((0.972, 0.99987), "97.2–under 100 %"),
        ((0.0, 0.0183), "0.0–1.8 %"),
        ((0.0001, 0.5), "over 0–50.0 %"),
    ],
)
def test_an_interval_is_rounded_but_never_to_certainty(
    interval: tuple[float, float], text: str
) -> None:
    assert interval_text(interval) == text
    assert interval_text(interval, " to ") == text.replace("–", " to ")
