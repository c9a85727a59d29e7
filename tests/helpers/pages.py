"""The README and the pages in docs/, with the code and the commands that stand in them."""

import re
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
README = ROOT / "README.md"
DOCS = ROOT / "docs"

PAGES = {
    path.relative_to(ROOT).as_posix(): path.read_text()
    for path in [README, ROOT / "CONTRIBUTING.md", *sorted(DOCS.rglob("*.md"))]
}
"""Text of every page, by its path in the repository."""


class Block(NamedTuple):
    """A fenced block of a page."""

    page: str
    language: str
    text: str


def _blocks() -> list[Block]:
    # Closing fences are matched too, or they would be taken for opening ones.
    fenced = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
    return [Block(page, *found) for page, text in PAGES.items() for found in fenced.findall(text)]


BLOCKS = _blocks()


def blocks(language: str, page: str | None = None) -> list[str]:
    """The blocks of a language, of one page or of all, in order."""
    return [b.text for b in BLOCKS if b.language == language and page in (None, b.page)]


def named_block(name: str) -> str:
    """The one block whose first line is the comment `# name`."""
    (text,) = {b.text for b in BLOCKS if b.text.startswith(f"# {name}\n")}
    return text


def command_lines() -> list[tuple[str, str]]:
    """Page and line of each command in the blocks without a language, in order."""
    found = []
    for block in BLOCKS:
        if not block.language:
            lines = block.text.replace("\\\n", " ").splitlines()
            found += [(block.page, line) for line in lines if line and not line.startswith("#")]
    return found
