"""What all runs of DAgger do: choose a round's transits, find their logs, count how they ended."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from pathlib import Path

from proxops.diagrams.flight import Flight, Row
from proxops.diagrams.scenario import is_blocked
from proxops.training.data.label_files import Labels

# Of the transits that are not blocked one in this many is flown, because those are easy.
_CLEAR_EVERY = 7


def hard_transits(count: int) -> list[int]:
    """Numbers of `count` transits of a set: all blocked ones, and a few of the others."""
    hard = (each for each in itertools.count() if is_blocked(each) or each % _CLEAR_EVERY == 0)
    return list(itertools.islice(hard, count))


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
