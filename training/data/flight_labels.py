"""The expert's commands along flights of another controller: labels for DAgger."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Iterator, Sequence
from importlib import metadata
from pathlib import Path

import numpy as np

from proxops.diagrams.flight import Workers, make_mpc
from proxops.diagrams.logs import FlightLog
from proxops.systems.common import InputError, SolverFailure, file_sha256
from proxops.systems.expert import Plan, PlanProgram
from proxops.training.data.label_files import Labels, joined_labels, kept_labels, labels_of

# At every eighth labelled state the later knots of the plan are labels too: the states that follow
# if the expert takes over.
_WHOLE_PLAN_EVERY = 8
# A plan is linearised about the one before it, more often if that is of several periods before.
_SOON, _LATER = 1, 2


@dc.dataclass(frozen=True)
class _Flight:
    """A flight to be labelled."""

    log: Path
    most: int | None
    count: int = 1

    @property
    def name(self) -> str:
        return self.log.stem

    @property
    def origin(self) -> str:
        """Names all that the labels of a flight depend on."""
        made = f"proxops {metadata.version('proxops')}, flight {file_sha256(self.log)}"
        states = "every state" if self.most is None else f"{self.most} states at most"
        return f"{made}, {states}, whole plans every {_WHOLE_PLAN_EVERY}"

    def compute(self) -> Labels:
        log = FlightLog.load(self.log)
        scenario = log.scenario
        states = log.dataset["state"].values[:-1]
        every = 1 if self.most is None else max(1, -(-len(states) // self.most))
        return labels_along(
            make_mpc(scenario, log.body).program,
            states[::every],
            log.dataset["target"].values[0],
            every * scenario.control_period_s,
            scenario.mpc.cold_iterations,
            scenario.mpc.min_horizon_s,
            _SOON if every == 1 else _LATER,
        )


def labels_by_flight(
    logs: Sequence[Path], folder: Path, workers: Workers = Workers(), most: int | None = None
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
    return kept_labels([_Flight(log.resolve(), most) for log in logs], folder, workers, "labelling")


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
