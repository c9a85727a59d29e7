"""Flights that try the navigation: their worlds, and what is kept of each.

What is kept of a flight is one list a figure, one value a control step: see `describe_navigation`.
"""

import dataclasses as dc
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.stats import chi2

from proxops.diagrams.flight import Row
from proxops.diagrams.logs import FlightLog, navigation_errors
from proxops.diagrams.scenario import Body, Scenario
from proxops.systems import NavigationPhase
from proxops.systems.common import derived_seed, generator

# Degrees by which S is turned, about a random axis.
TURN = 1.0
# Control steps at the start that no figure counts but those of lies: 200 s at Kleopatra.
SETTLED = 20
CONSISTENT, LIE = 3.0, 6.0
COMPONENTS = ("x", "y", "z", "vx", "vy", "vz", "rx", "ry", "rz")
# Share of chi-square values between their bounds.
BETWEEN = 0.95
_STREAM = 41


def random_turn(seed: int, index: int) -> np.ndarray:
    """A rotation vector (3,) of `TURN` degrees about a random axis."""
    axis = generator(derived_seed(seed, _STREAM), index).standard_normal(3)
    return TURN * axis / np.linalg.norm(axis)


def turned(scenario: Scenario, body: Body) -> Scenario:
    """A `World` in which S is turned by a degree."""
    turn = random_turn(scenario.transit.seed, scenario.transit.index)
    attitude = dc.replace(scenario.truth.attitude, constant_deg=turn.tolist())
    return dc.replace(scenario, truth=dc.replace(scenario.truth, attitude=attitude))


def describe_navigation(log: FlightLog, path: Path | None = None) -> Row:
    """Returns a flight's summary, the body's `size_m`, and what the navigation did as `steps`.

    `steps` has lists over the control steps, with None where the navigation did not follow:
    `position` (m), `velocity` (m/s) and `attitude` (deg): sizes of the errors; `nees`: normalised
    estimation error squared, of nine components; `worst`: the greatest error of a component over
    its standard deviation; `nis`: normalised innovation squared, of `returns` components; both
    are 0 if the frame was not used.
    `inside` has, for each component, the share of the steps after `SETTLED` with an error within
    three standard deviations. `steps` is missing if the flight had no navigation.
    """
    row = log.summary | {"size_m": float(log.body.shape.extents.max())}
    # The flight may end between two control steps.
    data = log.dataset.isel(time=slice(0, -1))
    if "navigation_state" not in data or not data.sizes["time"]:
        return row
    errors, deviations = navigation_errors(data)
    following = data["navigation_phase"].values == NavigationPhase.FOLLOWING
    known = following & np.isfinite(errors).all(axis=1)
    relative = np.abs(errors) / deviations
    settled = known & (np.arange(len(known)) >= SETTLED)
    returns = data["navigation_returns"].values
    figures = {
        "position": np.linalg.norm(errors[:, :3], axis=1),
        "velocity": np.linalg.norm(errors[:, 3:6], axis=1),
        "attitude": np.degrees(np.linalg.norm(errors[:, 6:], axis=1)),
        "nees": _nees(errors, deviations, data["navigation_covariance"].values, known),
        "worst": relative.max(axis=1),
        "nis": np.where(returns > 0, data["navigation_innovation"].values * returns, 0.0),
        "returns": returns,
    }
    steps: Row = {
        name: [
            float(f"{x:.6g}") if np.isfinite(x) else None for x in np.where(known, values, np.nan)
        ]
        for name, values in figures.items()
    }
    if settled.any():
        steps["inside"] = (relative[settled] <= CONSISTENT).mean(axis=0).tolist()
    return row | {"steps": steps, "following": float(following.mean())}


def _nees(
    errors: np.ndarray, deviations: np.ndarray, covariances: np.ndarray, known: np.ndarray
) -> np.ndarray:
    """Normalised estimation errors squared (N,); NaN where nothing is known.

    Args:
      errors: (N, 9). deviations: (N, 9), the roots of the diagonals. covariances: (N, 9, 9).
      known: (N,) bool.
    """
    found = np.full(len(errors), np.nan)
    e, s = errors[known], deviations[known]
    correlations = covariances[known] / (s[:, :, None] * s[:, None, :])
    e = e / s
    found[known] = np.einsum("ni,ni->n", e, np.linalg.solve(correlations, e[:, :, None])[..., 0])
    return found


def lists(rows: Sequence[Row], name: str, start: int = SETTLED) -> list[np.ndarray]:
    """A list of `describe_navigation` of each flight, from a control step on; None is NaN."""
    return [np.array(row["steps"][name][start:], dtype=float) for row in rows if "steps" in row]


def pooled(rows: Sequence[Row], name: str, start: int = SETTLED) -> np.ndarray:
    """The values of all flights at which the navigation followed."""
    values = np.concatenate([np.zeros(0), *lists(rows, name, start)])
    return values[np.isfinite(values)]


def consistency(rows: Sequence[Row]) -> Mapping[str, float]:
    """How errors and innovations compare with what the navigation says of them.

    Errors of one flight are alike from step to step, so NEES is averaged over the flights at each
    step, and each step has its bounds. Innovations are not, so each frame has its own.

    Returns:
      `nees`: mean over steps and flights, over 9; `low`, `high`: bounds of the mean over the
      flights at one step, over 9; `nees_inside`: share of the steps inside their bounds; `nis`: all
      innovations, over their number; `nis_inside`: share of the frames inside theirs. NaN if the
      navigation never followed.
    """
    tails = 0.5 * (1.0 - BETWEEN), 0.5 * (1.0 + BETWEEN)
    flights = lists(rows, "nees")
    longest = max((len(each) for each in flights), default=0)
    table = np.full((len(flights), longest), np.nan)
    for k, each in enumerate(flights):
        table[k, : len(each)] = each
    counts = np.isfinite(table).sum(axis=0)
    table, counts = table[:, counts > 0], counts[counts > 0]
    nis, returns = pooled(rows, "nis"), pooled(rows, "returns")
    nis, returns = nis[returns > 0], returns[returns > 0]
    names = ("nees", "low", "high", "nees_inside", "nis", "nis_inside")
    if not nis.size:
        return dict.fromkeys(names, np.nan)
    sums = np.nansum(table, axis=0)
    low, high = chi2.ppf(np.array(tails)[:, None], 9 * counts)
    within = (sums > low) & (sums < high)
    least, most = chi2.ppf(np.array(tails)[:, None], returns)
    most_flights = 9 * counts.max()
    figures = (
        sums.sum() / (9 * counts.sum()),
        *(chi2.ppf(tails, most_flights) / most_flights),
        within.mean(),
        nis.sum() / returns.sum(),
        ((nis > least) & (nis < most)).mean(),
    )
    return dict(zip(names, map(float, figures), strict=True))
