"""Flights that try the navigation: their worlds, a lidar that goes blind, and what is kept of each.

What is kept of a flight is one list a figure, one value a control step: see `describe_navigation`.
"""

import dataclasses as dc
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import xarray as xr
from pydrake.systems.framework import Diagram, DiagramBuilder, LeafSystem
from scipy.stats import chi2

from proxops.diagrams.flight import Row, make_mpc, make_navigation
from proxops.diagrams.logs import NAVIGATION_COLUMNS, FlightLog, navigation_errors
from proxops.diagrams.scenario import Body, LidarNavigationConfig, Scenario, filter_tuning
from proxops.systems import CommandAxes, NavigationPhase
from proxops.systems.common import LoggedPort, derived_seed, generator

# Degrees by which S is turned, about a random axis.
TURN = 1.0
# Frames are missing from and until these times in s.
BLIND_FROM, BLIND_UNTIL = 600.0, 900.0
# Control steps at the start that no figure counts but those of lies: 200 s at Kleopatra.
SETTLED = 20
CONSISTENT, LIE = 3.0, 6.0
COMPONENTS = ("x", "y", "z", "vx", "vy", "vz", "rx", "ry", "rz")
# Share of chi-square values between their bounds.
BETWEEN = 0.95
_ON_BOARD = "on_board_"
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


class Curtain(LeafSystem):
    """Lets frames (size) through, but for those between two times in s, which are empty."""

    def __init__(self, size: int, start: float, end: float):
        super().__init__()
        self._start, self._end = start, end
        self._frame = self.DeclareVectorInputPort("ranges", size)
        depends = {self._frame.ticket(), self.time_ticket()}
        self.DeclareVectorOutputPort("seen", size, self._calc, prerequisites_of_calc=depends)

    def _calc(self, context, output):
        ranges = self._frame.Eval(context)
        blind = self._start <= context.get_time() < self._end
        output.SetFromVector(np.full_like(ranges, np.inf) if blind else ranges)


class BlindedMpc(Diagram):
    """The MPC on a navigation of its own, behind a curtain; it commands in S.

    It flies with `navigation: !TrueState {}`, of which it reads nothing: its inputs are `ranges`,
    `commanded_force` and `target`.
    """

    def __init__(self, scenario: Scenario, body: Body):
        super().__init__()
        own = dc.replace(scenario, navigation=LidarNavigationConfig())
        builder = DiagramBuilder()
        navigation = builder.AddNamedSystem(
            "navigation", make_navigation(own, body, filter_tuning(own, body))
        )
        size = navigation.GetInputPort("ranges").size()
        curtain = builder.AddNamedSystem("curtain", Curtain(size, BLIND_FROM, BLIND_UNTIL))
        mpc = builder.AddNamedSystem("mpc", make_mpc(own, body))
        axes = CommandAxes(scenario.spacecraft.thrust_limit_n)
        builder.AddNamedSystem("command_axes", axes)
        for source, output, sink, port in (
            (curtain, "seen", navigation, "ranges"),
            (navigation, "state", mpc, "state"),
            (mpc, "force", axes, "force"),
            (navigation, "attitude", axes, "attitude"),
        ):
            builder.Connect(source.GetOutputPort(output), sink.GetInputPort(port))
        for system, port in (
            (curtain, "ranges"), (navigation, "commanded_force"), (mpc, "target"),
        ):  # fmt: skip
            builder.ExportInput(system.GetInputPort(port), port)
        builder.ExportOutput(axes.GetOutputPort("force"), "force")
        self._logged = []
        for name, each in (navigation.logged_ports() | mpc.logged_ports()).items():
            # The log knows the navigation's own columns only from the navigation of the flight.
            self._logged.append(name.replace("navigation_", _ON_BOARD))
            builder.ExportOutput(each.port, self._logged[-1])
        builder.BuildInto(self)

    def logged_ports(self) -> dict[str, LoggedPort]:
        return {name: LoggedPort(self.GetOutputPort(name)) for name in self._logged}


def blinded_mpc(scenario: Scenario, body: Body) -> Diagram:
    """The controller `_navigation_flights:blinded_mpc`."""
    return BlindedMpc(scenario, body)


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
    data = _with_navigation(log.dataset)
    # The flight may end between two control steps.
    data = data.isel(time=slice(0, -1))
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


def _with_navigation(data: xr.Dataset) -> xr.Dataset:
    """A log's dataset with the columns of a `BlindedMpc` as those of a flight's navigation."""
    if f"{_ON_BOARD}state" not in data:
        return data
    columns = {
        name: data[f"{_ON_BOARD}{name}"].values
        for name in ("state", "attitude", "covariance", "record")
    }
    columns["covariance"] = columns["covariance"].reshape(-1, 9, 9)
    record = columns.pop("record")
    named = {f"navigation_{name}": values for name, values in columns.items()}
    parts = [name for name in NAVIGATION_COLUMNS if name not in named]
    named |= {name: record[:, k] for k, name in enumerate(parts)}
    return data.assign(
        {
            name: (("time", *(f"{name}_{k}" for k in range(1, values.ndim))), values)
            for name, values in named.items()
        }
    )


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
