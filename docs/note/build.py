"""Builds the technical note, build/note.pdf, from what docs/results.json and docs/benchmark say.

python docs/note/build.py
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import typst

ROOT = Path(__file__).parents[2]


def benchmark_rows() -> dict[str, list[Mapping[str, Any]]]:
    """The flights of each row of the frozen benchmark, by the name of its file."""
    return {
        path.stem: json.loads(path.read_text())["flights"]
        for path in sorted((ROOT / "docs" / "benchmark").glob("*.json"))
    }


def note(
    results: Mapping[str, Any], rows: Mapping[str, list[Mapping[str, Any]]], form: str = "pdf"
) -> bytes:
    """The note, with what was flown; a part whose campaign is missing says so.

    Args:
      results: content of docs/results.json.
      rows: as `benchmark_rows` gives them; lines of missing rows are left out.
      form: of the document, as typst names it.
    """
    inputs = {"results": json.dumps(results), "rows": json.dumps(rows)}
    source = Path(__file__).with_name("note.typ")
    made = typst.compile(source, root=ROOT, format=form, sys_inputs=inputs)
    assert isinstance(made, bytes)
    return made


def main() -> None:
    """Writes the note."""
    results = json.loads((ROOT / "docs" / "results.json").read_text())
    target = ROOT / "build" / "note.pdf"
    target.parent.mkdir(exist_ok=True)
    target.write_bytes(note(results, benchmark_rows()))


if __name__ == "__main__":
    main()
