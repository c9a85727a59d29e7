"""Flights by a wrong map, and back by it and by the map that the first flight mended."""

import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np

from proxops.diagrams.flight import fly, mended_map_of_flight
from proxops.diagrams.logs import FlightLog, navigation_errors
from proxops.diagrams.scenario import (
    change_scenario,
    load_body,
    load_scenario,
    make_true_body,
    scenario_transit,
)
from proxops.systems.navigation import save_mended_map
from proxops.systems.shapes import vertex_normals

FLIGHTS = ("there, by the first map", "back, by the first map", "back, by the mended map")
# Times in s: until the first ends the beginning, from the second on it has settled.
BEGINNING, SETTLED = 60.0, 200.0
# A place was seen if its deviation fell below this share of what it was.
SEEN = 0.5


class Case(NamedTuple):
    """A transit in a world whose surface is off by an error of this size."""

    name: str
    rms: float
    """Of the surface, in m, which the navigation is told."""
    seed: int
    index: int


class Errors(NamedTuple):
    """Position errors of a flight in m, and whether they are within the covariance."""

    name: str
    success: bool
    beginning: float
    """Median in the first minute."""
    settled: float
    """Median after 200 s."""
    arrival: float
    """Median in the last minute."""
    inside: float
    """Share of all steps with each component within three standard deviations."""


class Mended(NamedTuple):
    """What was learned of a surface: rms errors in m along the normals, weighted by area."""

    first: float
    mended: float
    first_where_seen: float
    mended_where_seen: float
    seen: float
    """Share of the area."""
    inside: float
    """Share of the area where the mended map is off by less than three of its deviations."""


class MendedFlights(NamedTuple):
    """What one case gave."""

    flights: list[Errors]
    surface: Mended


def fly_mended(case: Case) -> MendedFlights:
    """Flies there and back: see `FLIGHTS`."""
    scenario = load_scenario(
        None,
        {
            "transit.seed": case.seed,
            "transit.index": case.index,
            "truth.surface_rms_m": case.rms,
            "truth.surface_seed": 1000 * case.seed + case.index,
            "navigation.expected.surface_rms_m": case.rms,
            "log_ranges": False,
        },
    )
    body = load_body(scenario.body)
    true_body = make_true_body(body, scenario.truth)
    kept = []
    log = fly(
        scenario,
        body=body,
        true_body=true_body,
        finished=lambda *flown: kept.append(mended_map_of_flight(*flown)),
    )
    found = [_errors(FLIGHTS[0], log)]
    transit = scenario_transit(scenario, body)
    back = {
        "transit.start_m": transit.goal.tolist(),
        "transit.goal_m": transit.start.tolist(),
        "noise_seed": 1,
    }
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "mended.obj"
        save_mended_map(kept[0], path)
        for name, changes in zip(FLIGHTS[1:], ({}, {"navigation.map": str(path)}), strict=True):
            changed = change_scenario(scenario, back | changes)
            found.append(_errors(name, fly(changed, body=body, true_body=true_body)))
    normals, areas = vertex_normals(body.shape)
    off = np.einsum("vi,vi->v", true_body.shape.vertices - body.shape.vertices, normals)
    left = np.einsum("vi,vi->v", true_body.shape.vertices - kept[0].shape.vertices, normals)
    seen = kept[0].deviations < SEEN * case.rms

    def rms(errors: np.ndarray, where: np.ndarray) -> float:
        return float(np.sqrt(np.average(errors[where] ** 2, weights=areas[where])))

    everywhere = np.ones(seen.size, dtype=bool)
    surface = Mended(
        rms(off, everywhere),
        rms(left, everywhere),
        rms(off, seen) if seen.any() else np.nan,
        rms(left, seen) if seen.any() else np.nan,
        float(np.average(seen, weights=areas)),
        float(np.average(np.abs(left) < 3.0 * kept[0].deviations, weights=areas)),
    )
    return MendedFlights(found, surface)


def _errors(name: str, log: FlightLog) -> Errors:
    errors, deviations = navigation_errors(log.dataset)
    known = np.isfinite(errors).all(axis=1)
    sizes, times = np.linalg.norm(errors[:, :3], axis=1), log.dataset["time"].values
    last = times[known][-1] - BEGINNING if known.any() else 0.0

    def median(where: np.ndarray) -> float:
        return float(np.median(sizes[where & known])) if (where & known).any() else np.nan

    return Errors(
        name,
        bool(log.summary["success"]),
        median(times <= BEGINNING),
        median(times >= SETTLED),
        median(times >= last),
        float((np.abs(errors) <= 3.0 * deviations)[known].all(axis=1).mean()),
    )
