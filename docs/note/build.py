"""Builds the technical note, build/note.pdf, from the files that hold the measured figures.

python docs/note/build.py
"""

import json
from collections.abc import Mapping
from importlib import metadata
from pathlib import Path
from typing import Any

import typst

ROOT = Path(__file__).parents[2]
SOURCE = Path(__file__).with_name("note.typ")


def sources() -> dict[str, Any]:
    """What the note tells of, by the name of the input of note.typ.

    `version` is that of proxops, `results` docs/results.json, `measured` docs/measured.json,
    `speed` the last entry of benchmarks/results.json, and `rows` the flights of each row in
    docs/benchmark, by the name of its file. Parts whose campaigns are missing in `results` say so,
    and lines whose rows are missing are left out.
    """
    docs = ROOT / "docs"
    return {
        "version": metadata.version("proxops"),
        "results": json.loads((docs / "results.json").read_text()),
        "measured": json.loads((docs / "measured.json").read_text()),
        "speed": json.loads((ROOT / "benchmarks" / "results.json").read_text())[-1],
        "rows": {
            path.stem: json.loads(path.read_text())["flights"]
            for path in sorted((docs / "benchmark").glob("*.json"))
        },
    }


def inputs(told: Mapping[str, Any]) -> dict[str, str]:
    """The same as note.typ takes it."""
    return {name: json.dumps(content) for name, content in told.items()}


def main() -> None:
    """Writes the note."""
    target = ROOT / "build" / "note.pdf"
    target.parent.mkdir(exist_ok=True)
    typst.compile(SOURCE, output=target, root=ROOT, sys_inputs=inputs(sources()))


if __name__ == "__main__":
    main()
