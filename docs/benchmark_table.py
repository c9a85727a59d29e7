"""Prints the tables of docs/benchmark.md from the rows in docs/benchmark.

python docs/benchmark_table.py
"""

import sys
from pathlib import Path

from proxops.studies.scoring import TRACKS, load_row, load_track, row_table

ROWS = Path(__file__).parent / "benchmark"


def tables() -> str:
    """A table in Markdown for each track."""
    rows = [load_row(path) for path in sorted(ROWS.glob("*.json"))]
    texts = []
    for name in TRACKS:
        head, *lines = row_table(load_track(name), [row for row in rows if row.track == name])
        rule = ["---", *["---:"] * (len(head) - 1)]
        cells = [f"| {' | '.join(line)} |" for line in (head, rule, *lines)]
        texts.append("\n".join([f"### {name}", "", *cells]))
    return "\n\n".join(texts) + "\n"


if __name__ == "__main__":
    sys.stdout.write(tables())
