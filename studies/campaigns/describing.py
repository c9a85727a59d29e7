"""The rows that studies keep of a flight: its summary, and more figures from its log."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from proxops.diagrams.flight import Row
from proxops.diagrams.logs import FlightLog, commanded_forces
from proxops.training.reports import SMALL_COMMAND

_TIMES = {"solve": "solve_time", "policy": "policy_time", "decision": "decision_time"}


def describe_flight(log: FlightLog, path: Path | None) -> Row:
    """Returns a flight's summary and its `small_command_share`.

    This is the share of steps at which the commanded force is below 3 % of the thrust limit (0.2 N
    of 7 N) in magnitude. `path` is not used; `run_campaign` gives it.
    """
    data, limit = log.dataset, log.scenario.spacecraft.thrust_limit_n
    commands = commanded_forces(data["force"].values, data["disturbance"].values, limit)[:-1]
    small = np.linalg.norm(commands, axis=1) < SMALL_COMMAND * limit
    return log.summary | {"small_command_share": float(small.mean())}


def describe_steps(log: FlightLog, path: Path | None) -> Row:
    """Returns `describe_flight` with what the steps of a flight saw, checked and took.

    `blind_steps` counts the steps at which no ray returned; it is None if the log has no frames.
    `checks` counts the checks of a hybrid, `agreed` those that passed. `solve_s`, `policy_s` and
    `decision_s` are the wall times in s of all solves of the MPC, of the network, and of deciding
    between them; `solve_s_median` and so on are the medians of one, None if there is none.
    """
    data = log.dataset
    blind = None
    if "ranges" in data:
        seen = np.isfinite(data["ranges"].values[:-1]).any(axis=(1, 2))
        blind = int(np.sum(~seen))
    times: dict[str, float | None] = {}
    for name, column in _TIMES.items():
        taken = data[column].values if column in data else np.zeros(0)
        taken = taken[np.isfinite(taken)]
        times[f"{name}_s"] = float(taken.sum())
        times[f"{name}_s_median"] = float(np.median(taken)) if taken.size else None
    agreement = data["agreement"].values[:-1] if "agreement" in data else np.zeros(0)
    checks = {
        "checks": int(np.isfinite(agreement).sum()), "agreed": int((agreement == 1.0).sum())
    }  # fmt: skip
    return describe_flight(log, path) | {"blind_steps": blind, **checks, **times}
