"""Writes reports: sections of text, tables and pictures, as one HTML page or as Markdown.

The HTML page holds its style and its pictures, so it needs no network and no other file.
"""

from __future__ import annotations

import base64
import html
import io
import re
import typing
import urllib.parse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

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
class Table:
    """A head, and lines of the same length; the first column holds labels, the others figures."""

    head: Sequence[str]
    lines: Sequence[Sequence[str | Link]]


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


Block = Text | Table | Picture | Page


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
    parts = [
        "<!DOCTYPE html>",
        '<html lang="en"><head><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<title>{html.escape(title)}</title>",
        f"<style>{_STYLE}</style></head><body>",
        f"<h1>{html.escape(title)}</h1>",
    ]
    for section in sections:
        parts.append(f"<section><h2>{html.escape(section.title)}</h2>")
        parts += [_html_block(block) for block in section.blocks]
        parts.append("</section>")
    return "\n".join([*parts, "</body></html>"]) + "\n"


def _html_block(block: Block) -> str:
    if isinstance(block, Text):
        tag = "pre" if block.code else "p"
        return f"<{tag}>{html.escape(block.text)}</{tag}>"
    if isinstance(block, Picture):
        caption = html.escape(block.caption)
        data = base64.b64encode(block.png).decode()
        image = f'<img alt="{caption}" src="data:image/png;base64,{data}">'
        return f"<figure>{image}<figcaption>{caption}</figcaption></figure>"
    if isinstance(block, Page):
        caption = html.escape(block.caption)
        # Without sandbox: a Meshcat page must fetch its own data.
        content = html.escape(block.html)
        frame = f'<iframe title="{caption}" loading="lazy" srcdoc="{content}"></iframe>'
        return f"<figure>{frame}<figcaption>{caption}</figcaption></figure>"
    head = "".join(f"<th>{html.escape(cell)}</th>" for cell in block.head)
    lines = [
        f"<tr><th>{_html_cell(line[0])}</th>"
        + "".join(f"<td>{_html_cell(cell)}</td>" for cell in line[1:])
        + "</tr>"
        for line in block.lines
    ]
    body = "\n".join(lines)
    return (
        f'<div class="wide"><table><thead><tr>{head}</tr></thead>\n<tbody>{body}</tbody>'
        "</table></div>"
    )


def _html_cell(cell: str | Link) -> str:
    if isinstance(cell, Link):
        address = html.escape(urllib.parse.quote(cell.path))
        return f'<a href="{address}">{html.escape(cell.text)}</a>'
    return html.escape(cell)


def markdown_page(title: str, sections: Sequence[Section], folder: str = "figures") -> str:
    """Renders the report as Markdown.

    Args:
      folder: of the pictures, relative to the page; empty if they lie beside it.
    """
    prefix = f"{folder}/" if folder else ""
    lines = [f"# {_inline(title)}"]
    for section in sections:
        lines += ["", f"## {_inline(section.title)}"]
        for block in section.blocks:
            lines += ["", *_markdown_block(block, prefix)]
    return "\n".join(lines) + "\n"


def _markdown_block(block: Block, prefix: str) -> list[str]:
    if isinstance(block, Text):
        return ["```", block.text, "```"] if block.code else [_inline(block.text)]
    if isinstance(block, Picture):
        caption = _inline(block.caption)
        return [f"![{caption}]({prefix}{block.name}.png)", "", caption]
    if isinstance(block, Page):
        return [f"[{_inline(block.caption)}]({prefix}{block.name}.html)"]
    return markdown_table(block)


def markdown_table(table: Table) -> list[str]:
    """Renders a table as lines of Markdown."""
    rows = [[_cell(cell) for cell in row] for row in (table.head, *table.lines)]
    rows.insert(1, ["---"] + ["---:"] * (len(table.head) - 1))
    return ["| " + " | ".join(row) + " |" for row in rows]


# Inside a word an underscore is no markup.
_MARKUP = re.compile(r"[\\`*\[\]<]|(?<!\w)_|_(?!\w)")


def _inline(text: str) -> str:
    """Puts a backslash before everything that Markdown would take for markup."""
    return _MARKUP.sub(r"\\\g<0>", text)


def _cell(cell: str | Link) -> str:
    if isinstance(cell, Link):
        return f"[{_cell(cell.text)}]({urllib.parse.quote(cell.path)})"
    return _inline(cell).replace("|", "\\|")


def write_report(folder: Path, title: str, sections: Sequence[Section]) -> None:
    """Writes `report.html`, and `report.md` with its `figures/`, into a folder.

    Raises:
      InputError: the folder cannot be made or written.
    """
    _write_pictures(folder / "figures", sections)
    _write(folder / "report.html", html_page(title, sections).encode())
    _write(folder / "report.md", markdown_page(title, sections).encode())


def write_markdown(folder: Path, title: str, sections: Sequence[Section]) -> None:
    """Writes `report.md` into a folder, with its pictures beside it.

    Raises:
      InputError: the folder cannot be made or written.
    """
    _write_pictures(folder, sections)
    _write(folder / "report.md", markdown_page(title, sections, folder="").encode())


def _write_pictures(folder: Path, sections: Sequence[Section]) -> None:
    """Writes the files that a Markdown page shows or links to.

    Raises:
      InputError: the folder cannot be made or written.
    """
    make_folder(folder)
    for section in sections:
        for block in section.blocks:
            if isinstance(block, Picture):
                _write(folder / f"{block.name}.png", block.png)
            elif isinstance(block, Page):
                _write(folder / f"{block.name}.html", block.html.encode())


def _write(path: Path, content: bytes) -> None:
    write_whole(path, lambda name: name.write_bytes(content))


_STYLE = """
body { max-width: 72rem; margin: 2rem auto; padding: 0 1.5rem; color: #1d2430; background: #fff;
  font: 16px/1.5 system-ui, sans-serif; }
h1 { font-size: 1.7rem; } h2 { font-size: 1.25rem; margin-top: 2.2rem; }
p, figcaption { max-width: 50rem; } figcaption { color: #566; font-size: 0.9rem; }
pre { background: #f3f4f7; padding: 0.7rem 1rem; white-space: pre-wrap; overflow-wrap: anywhere; }
figure { margin: 1.2rem 0; } iframe { width: 100%; height: 36rem; border: 0; }
img { max-width: 100%; height: auto; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-size: 0.9rem; font-variant-numeric: tabular-nums; }
th, td { padding: 0.25rem 0.8rem; border-bottom: 1px solid #dde1e8; text-align: right; }
th { font-weight: 600; overflow-wrap: anywhere; }
th:first-child { text-align: left; font-weight: 400; min-width: 14rem; }
thead th { border-bottom: 2px solid #99a3b5; vertical-align: bottom; }
"""
