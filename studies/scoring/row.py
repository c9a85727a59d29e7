"""`ScoreRow`: what a controller did on a track, with a hash, as one line of a table."""

from __future__ import annotations

import dataclasses as dc
import hashlib
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from proxops.diagrams.flight import Row, Workers, run_campaign
from proxops.studies.campaigns import TaskRun, fly_runs, makes_a_map
from proxops.studies.figures import exact_interval
from proxops.studies.scoring.track import Track
from proxops.systems.common import InputError, write_json
from proxops.training.reports import number_text

MAP_RMS, MAP_WITHIN = 6e-4, 0.99
"""A survey succeeds if its map is off by at most so much of the size, root mean square, and that
share of it is within three sigma of what the survey says itself."""


@dc.dataclass(frozen=True)
class Outcome:
    """What a row keeps of a flight."""

    success: bool
    collided: bool
    keep_out_violations: int
    """Of a touch-and-go, which has to enter the ellipsoid: 1 if it did not end safe."""
    delta_v_m_s: float
    terminal_position_error_m: float
    """Of a touch: the miss of the site; of a survey: the root mean square of its map's errors."""
    arrival_time_s: float | None
    """Of a survey: its time in orbit."""

    @classmethod
    def of(cls, row: Row) -> Outcome:
        """Of a flight's summary, with the digits that are kept."""
        if "ended_early" in row:  # A mission whose survey saw too little, or that found no place.
            return cls(False, False, 0, 0.0, 0.0, None)
        if "arrival_time_s" not in row:
            return cls._of_survey(row)
        time, touches = row["arrival_time_s"], "touched" in row
        return cls(
            row["success"],
            row["collided"],
            int(not row["safe"]) if touches else row["keep_out_violations"],
            round(row.get("mission_delta_v_m_s", row["delta_v_m_s"]), 4),
            round(row.get("touch_miss_m") or row["terminal_position_error_m"], 2),
            None if time is None else round(time, 1),
        )

    @classmethod
    def _of_survey(cls, row: Row) -> Outcome:
        rms = row["survey_map_rms_of_size"]
        good = rms <= MAP_RMS and row["survey_within_3_sigma"] >= MAP_WITHIN
        return cls(
            row["success"] and good,
            row["collided"],
            row["keep_out_violations"],
            round(row["survey_delta_v_m_s"], 4),
            round(rms * row["survey_length_m"], 2),
            round(3600.0 * row["survey_hours"], 1),
        )


@dc.dataclass(frozen=True)
class Score:
    """The figures of a row."""

    transits: int
    successes: int
    interval: tuple[float, float]
    """The exact interval of 95 % of the probability of success."""
    violations: int
    """Flights that enter the keep-out ellipsoid or collide."""
    delta_v_ratio: float | None
    """The sum of Δv over that of the MPC on the transits in which both succeeded; None if there are
    none."""
    error_m: float | None
    """With `time_s`: medians of the flights that succeeded; None if there are none."""
    time_s: float | None


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
    flights: Sequence[Outcome]
    """The outcome of each transit, in their order."""

    @property
    def version(self) -> str:
        """The version of proxops that flew it."""
        return self.provenance.partition(",")[0].removeprefix("proxops ")

    @property
    def sha256(self) -> str:
        """Hash of all of the row."""
        return hashlib.sha256(json.dumps(dc.asdict(self), sort_keys=True).encode()).hexdigest()

    def figures(self, track: Track) -> Score:
        """The figures of the row.

        Raises:
          InputError: the row is of another track.
        """
        if self.track_sha256 != track.sha256:
            raise InputError(f"the row {self.name!r} is not of the track {track.name!r} as it is")
        expert = track.expert_delta_v_m_s or [None] * len(self.flights)
        good = [each for each in self.flights if each.success]
        pairs = [
            (each.delta_v_m_s, best)
            for each, best in zip(self.flights, expert, strict=True)
            if each.success and best
        ]
        errors, times = ([getattr(each, name) for each in good]
                         for name in ("terminal_position_error_m", "arrival_time_s"))  # fmt: skip
        return Score(
            len(self.flights),
            len(good),
            exact_interval(len(good), len(self.flights)),
            sum(bool(each.keep_out_violations or each.collided) for each in self.flights),
            float(np.divide(*np.sum(pairs, axis=0))) if pairs else None,
            float(np.median(errors)) if good else None,
            float(np.median(times)) if good else None,
        )


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
    if makes_a_map(flights[0].scenario):
        where = folder.resolve()
        runs = [
            TaskRun(each.name, each.scenario, controller, where / each.name) for each in flights
        ]
        rows = fly_runs(runs, workers)
    else:
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
        [Outcome.of(row) for row in rows],
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
    row.figures(track)
    taken = [each.delta_v_m_s if each.success else None for each in row.flights]
    return dc.replace(track, expert_delta_v_m_s=taken)


def save_row(row: ScoreRow, path: Path) -> None:
    """Writes a row as a JSON file, with its hash."""
    write_json(path, dc.asdict(row) | {"sha256": row.sha256}, indent=None)


def load_row(path: Path) -> ScoreRow:
    """Reads a row that `save_row` wrote.

    Raises:
      InputError: the file is not of a row, or has been changed.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        told = content.pop("sha256")
        flights = [Outcome(**each) for each in content.pop("flights")]
        row = ScoreRow(**content, flights=flights)
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

    def place(each: tuple[ScoreRow, Score]) -> tuple[float, ...]:
        score = each[1]
        return -score.successes, score.violations, score.delta_v_ratio or np.inf

    scored = sorted(((row, row.figures(track)) for row in rows), key=place)
    lines = [
        [
            row.name,
            row.version,
            f"{score.successes} of {score.transits}",
            " to ".join(f"{100 * end:.1f}" for end in score.interval),
            str(score.violations),
            number_text(score.delta_v_ratio, ".3f"),
            number_text(score.error_m, ".2f" if (score.error_m or 1.0) < 1.0 else ".0f"),
            number_text(score.time_s, ".0f"),
            row.sha256[:12],
        ]
        for row, score in scored
    ]
    return [head, *lines]
