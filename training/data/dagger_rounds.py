"""What all runs of DAgger do with the flights of a round: find their logs, count how they ended."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from proxops.diagrams.flight import Flight, Row
from proxops.training.data.label_files import Labels


def round_logs(flights: Iterable[Flight], folder: Path) -> list[Path]:
    """The logs of flights that `run_campaign` kept in a folder.

    A flight that cannot begin in its world has none.
    """
    paths = [folder / f"{flight.name}.nc" for flight in flights]
    return [path for path in paths if path.exists()]


def round_outcome(rows: Sequence[Row], labels: Labels) -> dict[str, int]:
    """How the flights of a round ended, and how many labels they gave.

    A world that cannot be flown is no flight.
    """
    rows = [row for row in rows if "unflyable" not in row]
    return {
        "flights": len(rows),
        "arrived": sum(row.get("arrival_time_s") is not None for row in rows),
        "violations": sum(bool(row.get("keep_out_violations")) for row in rows),
        "collisions": sum(bool(row.get("collided")) for row in rows),
        "labels": len(labels["state"]),
    }
