"""The expert's commands along flights of another controller: labels for DAgger."""

from __future__ import annotations

import dataclasses as dc
import functools
from collections.abc import Iterator, Sequence
from importlib import metadata
from pathlib import Path

import numpy as np

from proxops.diagrams.flight import Workers, make_mpc
from proxops.diagrams.logs import FlightLog
from proxops.systems.common import InputError, SolverFailure, file_sha256, make_folder
from proxops.systems.expert import Plan, PlanProgram
from proxops.training.data.label_files import (
    Labels,
    joined_labels,
    labels_of,
    load_labels,
    save_labels,
)

# At every eighth labelled state the later knots of the plan are labels too: the states that follow
# if the expert takes over.
_WHOLE_PLAN_EVERY = 8
# A plan is linearised about the one before it, more often if that is of several periods before.
_SOON, _LATER = 1, 2


@dc.dataclass(frozen=True)
class _Piece:
    """A flight to be labelled."""

    name: str
    log: Path
    most: int | None


def label_flights(logs: Sequence[Path], folder: Path, workers: Workers = Workers()) -> Labels:
    """The labels of all states of all flights together; see `labels_by_flight`."""
    return joined_labels(labels_by_flight(logs, folder, workers, None))


def labels_by_flight(
    logs: Sequence[Path], folder: Path, workers: Workers, most: int | None
) -> list[Labels]:
    """Labels states of flights, and the later knots of some plans from these states.

    The expert is the one of each log's own scenario. The labels of a flight are kept in `folder`
    and not computed again.

    Args:
      workers: compute the labels, and report how many flights are ready.
      most: greatest number of states of a flight that are labelled, evenly, because neighbours are
        alike; None: all.

    Returns:
      The labels of each flight, in the order of `logs`.

    Raises:
      InputError: there are no logs; a log or a file of labels is damaged; or the labels are of
        another flight.
    """
    if not logs:
        raise InputError(
            f"there is no flight to label for {folder}: none of the round could begin in its world"
        )
    make_folder(folder)
    pieces = [_Piece(log.stem, log.resolve(), most) for log in logs]
    todo = [piece for piece in pieces if not _path(piece, folder).exists()]
    task = functools.partial(_label, folder=folder.resolve())
    ready = len(logs) - len(todo)
    workers.progress(ready / len(logs), f"labelling, {ready} of {len(logs)}")
    for _ in workers.results(todo, task):
        ready += 1
        workers.progress(ready / len(logs), f"labelling, {ready} of {len(logs)}")
    return [load_labels(_path(piece, folder), _origin(piece)) for piece in pieces]


def labels_along(
    program: PlanProgram,
    states: np.ndarray,
    target: np.ndarray,
    period: float,
    cold_iterations: int,
    least_horizon: float,
    iterations: int = _SOON,
) -> Labels:
    """Labels every state (N, 6) of a path, and the later knots of some plans.

    Args:
      target: (6,) in m and m/s. period: s from state to state. least_horizon: see `labels_of`.
      cold_iterations, iterations: see `plans_along`.
    """
    own: list[Plan] = []
    whole: list[Plan] = []
    plans = plans_along(program, states, target, period, cold_iterations, iterations)
    for k, plan in enumerate(plans):
        if plan is not None:
            (whole if k % _WHOLE_PLAN_EVERY == 0 else own).append(plan)
    return joined_labels([labels_of(own), labels_of(whole, least_horizon)])


def plans_along(
    program: PlanProgram,
    states: np.ndarray,
    target: np.ndarray,
    period: float,
    cold_iterations: int,
    iterations: int = _SOON,
) -> Iterator[Plan | None]:
    """Gives the expert's plan from every state (N, 6) of a path; None where the solver fails.

    Args:
      target: (6,) in m and m/s. period: s from state to state.
      cold_iterations: number of times that the program is linearised where there is no last plan.
      iterations: the same about the plan before; once, as the expert does in flight, but without
        the deadline of its flight and the push that it estimates.
    """
    last: Plan | None = None
    for state in states:
        try:
            if last is None:
                last = program.solve(state, target, iterations=cold_iterations)
            else:
                last = program.solve(state, target, last, period, iterations=iterations)
        except SolverFailure:
            last = None
        yield last


def _label(piece: _Piece, folder: Path) -> int:
    log = FlightLog.load(piece.log)
    scenario = log.scenario
    expert = make_mpc(scenario, log.body)
    states = log.dataset["state"].values[:-1]
    every = 1 if piece.most is None else max(1, -(-len(states) // piece.most))
    labels = labels_along(
        expert.program,
        states[::every],
        log.dataset["target"].values[0],
        every * scenario.control_period_s,
        scenario.mpc.cold_iterations,
        scenario.mpc.min_horizon_s,
        _SOON if every == 1 else _LATER,
    )
    save_labels(_path(piece, folder), labels, _origin(piece))
    return len(labels["state"])


def _origin(piece: _Piece) -> str:
    """Names all that the labels of a flight depend on."""
    made = f"proxops {metadata.version('proxops')}, flight {file_sha256(piece.log)}"
    states = "every state" if piece.most is None else f"{piece.most} states at most"
    return f"{made}, {states}, whole plans every {_WHOLE_PLAN_EVERY}"


def _path(piece: _Piece, folder: Path) -> Path:
    return folder / f"{piece.name}.npz"
