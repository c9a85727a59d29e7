"""The report on a training set: counts, fuel, clearances, commands, distances, size on disk."""

from __future__ import annotations

import itertools
import typing
from collections.abc import Mapping, Sequence

import numpy as np

from proxops.diagrams.logs import length_text, three_digits
from proxops.training.reports import DASH, SMALL_COMMAND, Section, Table, Text, number_text

Figures = dict[str, typing.Any]

GOAL_EDGES = (0.0, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0)
CLEARANCE_EDGES = (0.0, 1.0, 3.0, 8.0, 20.0, 50.0, 100.0)
"""Edges of the histograms of distances from the goal and from the keep-out ellipsoid, as multiples
of the radius of arrival (1 km)."""


def collection_report(manifest: Mapping[str, typing.Any]) -> Figures:
    """The figures of a manifest: of all flights, and of each kind.

    Delta-v and arrival time are over the flights that succeeded, None where none did.
    """
    flights = manifest["flights"]
    kinds = dict.fromkeys(flight["kind"] for flight in flights)
    return {
        "seed": manifest["seed"],
        "all": _figures(flights),
        "kinds": {
            kind: _figures([flight for flight in flights if flight["kind"] == kind])
            for kind in kinds
        },
        "goal_distance_edges": list(GOAL_EDGES),
        "clearance_edges": list(CLEARANCE_EDGES),
    }


def _figures(flights: Sequence[Mapping[str, typing.Any]]) -> Figures:
    def total(name: str) -> int:
        return sum(flight[name] for flight in flights)

    def summed(name: str) -> np.ndarray:
        return np.sum([flight[name] for flight in flights], axis=0)

    arrived = [flight for flight in flights if flight["success"]]

    def median(name: str) -> float | None:
        return float(np.median([flight[name] for flight in arrived])) if arrived else None

    least = [flight["min_clearance_m"] for flight in flights]
    zero = summed("zero_commands") / max(1, total("commands"))
    return {
        "flights": len(flights),
        "successes": len(arrived),
        "collisions": sum(bool(flight["collided"]) for flight in flights),
        "keep_out_violations": total("keep_out_violations"),
        "delta_v_m_s_median": median("delta_v_m_s"),
        "arrival_time_s_median": median("arrival_time_s"),
        "min_clearance_m": min(least),
        "min_clearance_m_median": float(np.median(least)),
        "steps": total("steps"),
        "zero_command_share": dict(zip(("x", "y", "z", "all"), zero.tolist(), strict=True)),
        "goal_distances": summed("goal_distances").tolist(),
        "clearances": summed("clearances").tolist(),
        "bytes": total("bytes"),
        "wall_s": sum(flight["wall_s"] for flight in flights),
    }


def report_rows(report: Figures) -> tuple[list[str], list[list[str]]]:
    """A table: its head, and a line for each kind and for all."""
    head = [
        "kind", "flights", "success", "collisions", "keep-out", "Δv (m/s)", "arrival (s)",
        "least clearance", "zero x, y, z, all (%)", "steps", "MB",
    ]  # fmt: skip
    lines = []
    for kind, figures in (*report["kinds"].items(), ("all", report["all"])):
        delta_v = figures["delta_v_m_s_median"]
        shares = [f"{100 * share:.0f}" for share in figures["zero_command_share"].values()]
        lines.append(
            [
                kind,
                str(figures["flights"]),
                str(figures["successes"]),
                str(figures["collisions"]),
                str(figures["keep_out_violations"]),
                DASH if delta_v is None else three_digits(delta_v),
                number_text(figures["arrival_time_s_median"], ".0f"),
                length_text(figures["min_clearance_m"]),
                ", ".join(shares),
                str(figures["steps"]),
                f"{figures['bytes'] / 1e6:.1f}",
            ]
        )
    return head, lines


def histogram_rows(edges: Sequence[float], counts: Sequence[int]) -> list[tuple[str, str]]:
    """What lies between the edges, as labels and shares in percent; empty ends are left out."""
    labels = [f"< {edges[0]:g}"]
    labels += [f"{low:g} to {high:g}" for low, high in itertools.pairwise(edges)]
    labels.append(f"> {edges[-1]:g}")
    total = max(1, sum(counts))
    rows = [(label, f"{100 * n / total:.1f} %", n) for label, n in zip(labels, counts, strict=True)]
    return [(label, share) for k, (label, share, n) in enumerate(rows) if n or 0 < k < len(edges)]


def collection_sections(report: Figures) -> list[Section]:
    """The report for reading."""
    figures = report["all"]
    size = f"{figures['flights']} flights, {figures['steps']} control steps"
    notes = (
        "Δv and arrival are medians of the flights that succeeded; a command is zero below "
        f"{100.0 * SMALL_COMMAND:.1f} % of the thrust limit; keep-out counts violations."
    )
    text = Text(f"{size}, {figures['bytes'] / 1e6:.0f} MB. {notes}")
    sections = [Section("Flights by kind", [text, Table(*report_rows(report))])]
    for title, edges, counts in (
        ("Distance to the goal", report["goal_distance_edges"], figures["goal_distances"]),
        ("Clearance of the keep-out", report["clearance_edges"], figures["clearances"]),
    ):
        table = Table(["radii", "share"], histogram_rows(edges, counts))
        sections.append(Section(title, [Text("In radii of arrival, share of all rows."), table]))
    return sections
