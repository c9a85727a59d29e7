"""Compares a policy's forces with the MPC's on logged flights: figures, picture, report."""

from __future__ import annotations

import typing
from collections.abc import Mapping, Sequence

import numpy as np

from proxops.training.reports.figure_text import SMALL_COMMAND, number_text
from proxops.training.reports.report import Block, Picture, Section, Table, Text

if typing.TYPE_CHECKING:
    from matplotlib.figure import Figure

# The paper's cap of the colours: most commands are near zero and would hide all others.
_MOST_SHOWN = 1000
_BINS = 71

Figures = dict[str, typing.Any]


def force_figures(wanted: np.ndarray, said: np.ndarray, limit: float) -> Figures:
    """Compares a policy's forces with the MPC's.

    Args:
      wanted, said: the MPC's forces and the policy's, (N, 3) in N in K.
      limit: of the thrusters, in N.

    Returns:
      `steps` is N. `rmse_n` is over all axes, `rmse_axes_n` over each axis. `zero_rmse_n` and
      `zero_rmse_axes_n` are those of a policy that is always zero. `correlation` has a figure for
      each axis. `small_mpc` and `small_policy` are the shares of steps whose force is below
      `SMALL_COMMAND` of the limit. Figures of no steps, and correlations with a constant, are None.
    """
    if len(wanted) == 0:
        names = (
            "rmse_n", "rmse_axes_n", "zero_rmse_n", "zero_rmse_axes_n", "correlation",
            "small_mpc", "small_policy",
        )  # fmt: skip
        return {"steps": 0, **dict.fromkeys(names)}
    squares, zero_squares = ((said - wanted) ** 2).mean(axis=0), (wanted**2).mean(axis=0)
    return {
        "steps": len(wanted),
        "rmse_n": float(np.sqrt(squares.mean())),
        "rmse_axes_n": np.sqrt(squares).tolist(),
        "zero_rmse_n": float(np.sqrt(zero_squares.mean())),
        "zero_rmse_axes_n": np.sqrt(zero_squares).tolist(),
        "correlation": [_correlation(wanted[:, k], said[:, k]) for k in range(3)],
        "small_mpc": _small(wanted, limit),
        "small_policy": _small(said, limit),
    }


def plot_forces(wanted: np.ndarray, said: np.ndarray, limit: float) -> Figure:
    """Draws the paper's 2D histograms, one for each axis: the policy's force against the MPC's.

    Args:
      wanted, said: the MPC's forces and the policy's, (N, 3) in N.
      limit: of the thrusters, in N; forces beyond it are drawn at the limit, where they would fly.
    """
    from matplotlib.figure import Figure  # It is slow to import, so only when it is needed.

    figure = Figure(figsize=(13.0, 4.2), layout="constrained")
    axes = figure.subplots(1, 3, sharex=True, sharey=True)
    edges = np.linspace(-limit, limit, _BINS + 1)
    image = None
    for k, axis in enumerate(axes):
        columns = (np.clip(forces[:, k], -limit, limit) for forces in (wanted, said))
        counts, _, _ = np.histogram2d(*columns, bins=(edges, edges))
        shown = np.ma.masked_equal(counts.T, 0.0)  # Empty bins stay white.
        image = axis.pcolormesh(edges, edges, shown, vmin=0, vmax=_MOST_SHOWN, cmap="viridis")
        axis.plot([-limit, limit], [-limit, limit], color="0.6", linewidth=0.5)
        axis.set_aspect("equal")
        axis.set_title("xyz"[k])
        axis.set_xlabel("actual force (N)")
    axes[0].set_ylabel("predicted force (N)")
    assert image is not None
    figure.colorbar(image, ax=axes, extend="max").set_label("steps")
    return figure


def policy_sections(report: Figures, histograms: Picture | None = None) -> list[Section]:
    """Makes the report of a policy's training.

    Args:
      report: has `parameters` (the number of weights), `training` and `parts`, and after DAgger
        `rounds`.
      histograms: the figure that `plot_forces` drew of the test part.
    """
    sections = [Section("Training", [Text(_training_text(report))])]
    if "rounds" in report:
        sections.append(Section("Rounds of DAgger", _rounds(report["rounds"])))
    lines = [[part, *_cells(figures)] for part, figures in report["parts"].items()]
    blocks: list[Block] = [Text(_INTRODUCTION), Table(_HEAD, lines)]
    if histograms is not None:
        blocks.append(histograms)
    sections.append(Section("Forces against the MPC's", blocks))
    return sections


_INTRODUCTION = (
    "The policy follows each logged flight from its start and gives a force at every step, which "
    "is compared with the MPC's. The policy does not fly here, so a low error does not mean that "
    "it arrives."
)
_HEAD = [
    "part", "flights", "steps", "RMSE (N)", "x", "y", "z", "always zero: RMSE (N)", "x", "y",
    "z", "correlation x", "y", "z", f"below {SMALL_COMMAND:.1%} of the limit: MPC (%)",
    "policy (%)",
]  # fmt: skip
HISTOGRAMS_CAPTION = (
    "Steps of the test part by the MPC's force (actual) and the policy's (predicted); colours end "
    f"at {_MOST_SHOWN}."
)


def _training_text(report: Figures) -> str:
    run = report["training"]
    return (
        f"{report['parameters']} weights. {run['epochs']} epochs, {run['cpu_s']:.0f} s of CPU "
        f"time; the weights of epoch {run['best_epoch'] + 1} are kept: loss on validation "
        f"{run['validation_loss']:.4f}, on training {run['training_loss']:.4f}."
    )


def _rounds(rounds: Sequence[Mapping[str, int]]) -> list[Block]:
    names = ("flights", "arrived", "violations", "collisions", "labels")
    head = ["round", "flights", "arrived", "with keep-out violations", "collisions", "labels"]
    lines = [
        [str(number), *(str(row[name]) for name in names)]
        for number, row in enumerate(rounds, start=1)
    ]
    text = "The policy before each round, on the transits that the round learned from."
    return [Text(text), Table(head, lines)]


def _cells(figures: Figures) -> list[str]:
    nothing = [None] * 3
    numbers = [
        figures["rmse_n"],
        *(figures["rmse_axes_n"] or nothing),
        figures["zero_rmse_n"],
        *(figures["zero_rmse_axes_n"] or nothing),
        *(figures["correlation"] or nothing),
    ]
    shares = [figures["small_mpc"], figures["small_policy"]]
    return [
        str(figures["flights"]),
        str(figures["steps"]),
        *(number_text(number, ".3f") for number in numbers),
        *(number_text(share, ".1f", 100.0) for share in shares),
    ]


def _small(forces: np.ndarray, limit: float) -> float:
    return float((np.linalg.norm(forces, axis=1) < SMALL_COMMAND * limit).mean())


def _correlation(wanted: np.ndarray, said: np.ndarray) -> float | None:
    if wanted.std() == 0.0 or said.std() == 0.0:
        return None
    return float(np.corrcoef(wanted, said)[0, 1])
