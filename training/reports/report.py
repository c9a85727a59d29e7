"""Reports: sections of text, tables and pictures, as one HTML page and as Markdown.

The template `report.html.jinja` makes a page that holds its style and its pictures, so it needs no
network and no other file; `report.md.jinja` makes the same as Markdown.
"""

from __future__ import annotations

import base64
import io
import re
import typing
import urllib.parse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import jinja2

from proxops.systems.common import make_folder, write_whole

if typing.TYPE_CHECKING:
    from matplotlib.figure import Figure

_DOTS_PER_INCH = 110


@dataclass(frozen=True)
class Text:
    """A paragraph; with `code` it is set as typed at a terminal."""

    text: str
    code: bool = False


@dataclass(frozen=True)
class Link:
    """A cell of a table that leads to a file."""

    text: str
    path: str
    """Relative to the folder of the report."""


@dataclass(frozen=True)
class Mark:
    """A cell of a table in the colour of success or of failure; its text says which it is."""

    text: str
    good: bool


Cell = str | Link | Mark


@dataclass(frozen=True)
class Table:
    """A head, and lines of the same length; the first column holds labels, the others figures.

    A line of a single cell is the heading of those below it.
    """

    head: Sequence[str]
    lines: Sequence[Sequence[Cell]]


@dataclass(frozen=True)
class Picture:
    """A figure as PNG."""

    name: str
    """Name, without ending, of the file that a Markdown page shows."""
    png: bytes
    caption: str


@dataclass(frozen=True)
class Page:
    """A page with scripts: inside the HTML page, or a file that a Markdown page links to."""

    name: str
    """Name of that file, without ending."""
    html: str
    """The whole page; it needs no network."""
    caption: str


@dataclass(frozen=True)
class Folded:
    """What most readers skip: only its summary is seen until it is opened."""

    summary: str
    blocks: Sequence[Text | Table]


Block = Text | Table | Picture | Page | Folded


@dataclass(frozen=True)
class Section:
    """A heading and the blocks below it."""

    title: str
    blocks: Sequence[Block]


def picture(name: str, figure: Figure, caption: str) -> Picture:
    """Makes a report's picture from a matplotlib figure."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=_DOTS_PER_INCH)
    return Picture(name, buffer.getvalue(), caption)


def html_page(title: str, sections: Sequence[Section]) -> str:
    """Renders the report as one HTML page; all text is escaped."""
    return _TEMPLATES.get_template("report.html.jinja").render(title=title, sections=sections)


def markdown_page(title: str, sections: Sequence[Section], folder: str = "figures") -> str:
    """Renders the report as Markdown.

    Args:
      folder: of the pictures, relative to the page; empty if they lie beside it.
    """
    return _TEMPLATES.get_template("report.md.jinja").render(
        title=title, sections=sections, folder=f"{folder}/" if folder else ""
    )


def markdown_table(table: Table) -> list[str]:
    """Renders a table as lines of Markdown."""
    rows = [
        [f"**{_cell(row[0])}**"] + [""] * (len(table.head) - 1)
        if len(row) == 1 < len(table.head)
        else [_cell(cell) for cell in row]
        for row in (table.head, *table.lines)
    ]
    rows.insert(1, ["---"] + ["---:"] * (len(table.head) - 1))
    return ["| " + " | ".join(row) + " |" for row in rows]


def write_report(folder: Path, title: str, sections: Sequence[Section]) -> None:
    """Writes `report.html`, and `report.md` with its `figures/`, into a folder."""
    write_markdown(folder, title, sections, "figures")
    _write(folder / "report.html", html_page(title, sections).encode())


def write_markdown(
    folder: Path, title: str, sections: Sequence[Section], figures: str = ""
) -> None:
    """Writes `report.md` into a folder, with what it shows beside it or in the folder `figures`."""
    make_folder(folder / figures)
    for block in (block for section in sections for block in section.blocks):
        if isinstance(block, Picture):
            _write(folder / figures / f"{block.name}.png", block.png)
        elif isinstance(block, Page):
            _write(folder / figures / f"{block.name}.html", block.html.encode())
    _write(folder / "report.md", markdown_page(title, sections, figures).encode())


def _write(path: Path, content: bytes) -> None:
    write_whole(path, lambda name: name.write_bytes(content))


# Inside a word an underscore is no markup.
_MARKUP = re.compile(r"[\\`*\[\]<]|(?<!\w)_|_(?!\w)")


def _plain(text: str) -> str:
    """Puts a backslash before everything that Markdown would take for markup."""
    return _MARKUP.sub(r"\\\g<0>", text)


def _cell(cell: Cell) -> str:
    if isinstance(cell, Link):
        return f"[{_cell(cell.text)}]({urllib.parse.quote(cell.path)})"
    if isinstance(cell, Mark):
        return _cell(cell.text)
    return _plain(cell).replace("|", "\\|")


_TEMPLATES = jinja2.Environment(
    loader=jinja2.FileSystemLoader(Path(__file__).parent),
    autoescape=jinja2.select_autoescape(["html.jinja"]),
    undefined=jinja2.StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
)
_TEMPLATES.tests["instance"] = lambda block, name: type(block).__name__ == name
_TEMPLATES.filters |= {
    "address": urllib.parse.quote,
    "base64": lambda data: base64.b64encode(data).decode(),
    "markdown": lambda table: "\n".join(markdown_table(table)),
    "plain": _plain,
}
