"""`ScoreRow`: what a controller did on a track, with a hash, as one line of a table."""

from __future__ import annotations

import dataclasses as dc
import hashlib
import json
import typing
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from proxops.diagrams.flight import Workers, run_campaign
from proxops.studies.figures import exact_interval
from proxops.studies.scoring.track import Track
from proxops.systems.common import InputError, write_json
from proxops.training.reports import number_text

# Of a flight's summary, with the digits that are kept.
_KEPT = {
    "success": None,
    "collided": None,
    "keep_out_violations": None,
    "delta_v_m_s": 4,
    "terminal_position_error_m": 2,
    "arrival_time_s": 1,
}


@dc.dataclass(frozen=True)
class ScoreRow:
    """What a controller did on a track, flight by flight."""

    name: str
    """What the table calls the controller."""
    controller: str
    """The controller as `named_controller` takes it, and its settings."""
    provenance: str
    """The version of proxops, and hashes of the body and of the controller's files."""
    track: str
    """The name of the track."""
    track_sha256: str
    """Its hash."""
    flights: Sequence[dict[str, typing.Any]]
    """The outcome of each transit, in their order."""

    @property
    def version(self) -> str:
        """The version of proxops that flew it."""
        return self.provenance.partition(",")[0].removeprefix("proxops ")

    @property
    def sha256(self) -> str:
        """Hash of all of the row."""
        return hashlib.sha256(json.dumps(dc.asdict(self), sort_keys=True).encode()).hexdigest()

    def figures(self, track: Track) -> dict[str, typing.Any]:
        """The figures of the row.

        Returns:
          `transits`, `successes`, their exact 95 % `interval`, `violations` (flights that enter the
          keep-out ellipsoid or collide), `delta_v_ratio` (the sum of Δv over that of the MPC on the
          transits in which both succeeded; None if there are none), and of the flights that
          succeeded the medians `error_m` and `time_s` (None if there are none).

        Raises:
          InputError: the row is of another track.
        """
        if self.track_sha256 != track.sha256:
            raise InputError(f"the row {self.name!r} is not of the track {track.name!r} as it is")
        low, high = exact_interval(sum(f["success"] for f in self.flights), len(self.flights))
        expert = track.expert_delta_v_m_s or [None] * len(self.flights)
        good = [flight for flight in self.flights if flight["success"]]
        pairs = [
            (flight["delta_v_m_s"], best)
            for flight, best in zip(self.flights, expert, strict=True)
            if flight["success"] and best
        ]

        def median(key: str) -> float | None:
            return float(np.median([flight[key] for flight in good])) if good else None

        return {
            "transits": len(self.flights),
            "successes": len(good),
            "interval": (low, high),
            "violations": sum(
                bool(f["keep_out_violations"] or f["collided"]) for f in self.flights
            ),
            "delta_v_ratio": float(np.divide(*np.sum(pairs, axis=0))) if pairs else None,
            "error_m": median("terminal_position_error_m"),
            "time_s": median("arrival_time_s"),
        }


def score(
    track: Track,
    controller: str,
    folder: Path,
    *,
    name: str | None = None,
    settings: Sequence[str] = (),
    workers: Workers = Workers(),
) -> ScoreRow:
    """Flies a controller over a track; returns its row.

    Args:
      track: the transits.
      controller: as `named_controller` takes it.
      folder: keeps what was flown: a flight that is there is not flown again.
      name: what the table calls the controller; None: as `controller`.
      settings: as of `Track.flights`.
      workers: fly.

    Raises:
      InputError: a world of the track cannot be flown; or see `Track.flights` and `run_campaign`.
    """
    flights = track.flights(controller, settings)
    rows = run_campaign(flights, folder, workers=workers)
    for row in rows:
        if "unflyable" in row:
            raise InputError(
                f"track {track.name}: transit {row['transit']} cannot be flown: {row['unflyable']}"
            )
    return ScoreRow(
        name or controller,
        " ".join([controller, *settings]),
        str(flights[0].provenance),
        track.name,
        track.sha256,
        [_kept(row) for row in rows],
    )


def with_expert(track: Track, row: ScoreRow) -> Track:
    """The track with what the MPC took for each transit.

    It is another track with another hash: score the MPC and all others over it anew.

    Args:
      track: without or with such figures.
      row: of the MPC over this track.

    Raises:
      InputError: the row is of another track.
    """
    if row.track_sha256 != track.sha256:
        raise InputError(f"the row {row.name!r} is not of the track {track.name!r} as it is")
    taken = [each["delta_v_m_s"] if each["success"] else None for each in row.flights]
    return dc.replace(track, expert_delta_v_m_s=taken)


def save_row(row: ScoreRow, path: Path) -> None:
    """Writes a row as a JSON file, with its hash.

    Raises:
      InputError: see `write_json`.
    """
    write_json(path, dc.asdict(row) | {"sha256": row.sha256}, indent=None)


def load_row(path: Path) -> ScoreRow:
    """Reads a row that `save_row` wrote.

    Raises:
      InputError: the file is not of a row, or has been changed.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        told = content.pop("sha256")
        row = ScoreRow(**content)
    except (AttributeError, KeyError, OSError, TypeError, ValueError) as error:
        raise InputError(f"{path} is not a row of the benchmark: {error}") from error
    if row.sha256 != told:
        raise InputError(f"{path} was changed after it was written: its hash does not fit")
    return row


def row_table(track: Track, rows: Sequence[ScoreRow]) -> list[list[str]]:
    """The table of rows of a track, best first, with its head.

    More successes are better, then fewer violations, then less Δv.

    Raises:
      InputError: a row is of another track.
    """
    head = ["controller", "proxops", "success", "exact 95 % interval (%)", "keep-out violated"]
    head += ["Δv over the MPC's", "error (m)", "time (s)", "row"]
    found = [(row, row.figures(track)) for row in rows]

    def place(each: tuple[ScoreRow, dict[str, typing.Any]]) -> tuple[float, ...]:
        figures = each[1]
        return -figures["successes"], figures["violations"], figures["delta_v_ratio"] or np.inf

    return [head, *(_cells(row, figures) for row, figures in sorted(found, key=place))]


def _cells(row: ScoreRow, figures: dict[str, typing.Any]) -> list[str]:
    low, high = figures["interval"]
    return [
        row.name,
        row.version,
        f"{figures['successes']} of {figures['transits']}",
        f"{100 * low:.1f} to {100 * high:.1f}",
        str(figures["violations"]),
        number_text(figures["delta_v_ratio"], ".3f"),
        number_text(figures["error_m"], ".0f"),
        number_text(figures["time_s"], ".0f"),
        row.sha256[:12],
    ]


def _kept(summary: dict[str, typing.Any]) -> dict[str, typing.Any]:
    """What a row keeps of a flight."""
    return {
        key: summary[key] if digits is None or summary[key] is None else round(summary[key], digits)
        for key, digits in _KEPT.items()
    }
