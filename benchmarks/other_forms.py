"""Flies in worlds whose errors have another form than the navigation and assurance are told.

The worlds are those of `after_survey`, and navigation and runtime assurance are told its
distributions, in every line the same. In each line but the first one error is replaced by one of
another form. All lines have the same transits, and the same world otherwise. Flights are kept in
the folder of `--out`: run the command again to finish what was interrupted.

    python benchmarks/other_forms.py [--controller hybrid] [--transits 40] [--seed 8800]
        [--only "curved facets" …] [--workers N] [--out out/other-forms] [--markdown table.md]

The surfaces are those of the scenario's body: `boulders and craters` has twenty of them, with the
root mean square that `after_survey` takes as its three standard deviations; `curved facets` is what
the map's flat facets would be chords of (PN triangles: Vlachos et al., Curved PN Triangles, 2001).
"""

import argparse
import functools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from _campaign import campaign_parser, fly_with_bar, show

from proxops.diagrams.flight import Row
from proxops.diagrams.scenario import Body, Scenario, change_scenario, load_body, load_scenario
from proxops.studies.campaigns import Variant
from proxops.studies.figures import delta_v_pairs, exact_interval
from proxops.systems.common import generator, make_folder, write_whole
from proxops.systems.shapes import Polyhedron, mesh_bytes
from proxops.training.reports import interval_text

TOLD = "after_survey"
AS_TOLD, BOULDERS, CURVED = "as told", "boulders and craters", "curved facets"
# Of the boulders and craters: their number, their width (the radius at which 1/e of the height is
# left) over the body's length, and the surface's root mean square over it.
_PLACES, _WIDTH, _RMS = 20, 0.03, 5e-4
HEADINGS = (
    "success", "exact 95 % interval", "entries", "least clearance (km)", "end error, median (m)",
    "greatest (m)", "Δv over that as told, mean", "navigation off, median (m)",
    "steps within 3σ of the navigation (%)",
)  # fmt: skip


def boulders(shape: Polyhedron, seed: int) -> Polyhedron:
    """The shape with `_PLACES` boulders and craters, which are as many and equally high."""
    mesh, length = shape.to_trimesh(), float(shape.extents.max())
    centres = generator(seed, 0).choice(len(shape.vertices), _PLACES, replace=False)
    away = np.linalg.norm(shape.vertices[:, None] - shape.vertices[centres], axis=2)
    heights = np.exp(-((away / (_WIDTH * length)) ** 2)) @ np.tile([1.0, -1.0], _PLACES // 2)
    weights = np.bincount(shape.facets.ravel(), np.repeat(mesh.area_faces, 3))
    heights *= _RMS * length / np.sqrt(weights @ heights**2 / weights.sum())
    return Polyhedron(shape.vertices + heights[:, None] * mesh.vertex_normals, shape.facets)


def curved(shape: Polyhedron) -> Polyhedron:
    """The shape with each facet divided into four, whose new vertices lie on PN triangles."""
    mesh = shape.to_trimesh()
    vertices, normals = shape.vertices, mesh.vertex_normals
    edges, place = mesh.edges_unique, mesh.faces_unique_edges
    (a, b), (m, n) = vertices[edges.T], normals[edges.T]
    # The middle of the cubic curve over an edge, which leaves its ends at right angles to the
    # normals there: the mean of the ends, and an eighth of both rises.
    rise = np.sum((b - a) * m, axis=1)[:, None] * m - np.sum((b - a) * n, axis=1)[:, None] * n
    middles = 0.5 * (a + b) - rise / 8.0
    u, v, w = shape.facets.T
    uv, vw, wu = (len(vertices) + place).T
    facets = [(u, uv, wu), (v, vw, uv), (w, wu, vw), (uv, vw, wu)]
    return Polyhedron(
        np.concatenate([vertices, middles]),
        np.concatenate([np.stack(corners, axis=1) for corners in facets]),
    )


def surfaces(body: Body, folder: Path) -> dict[str, Path]:
    """Writes the true surfaces as meshes in km; gives their files by the names of their lines."""
    make_folder(folder)
    files = {}
    for name, shape in ((BOULDERS, boulders(body.shape, 1)), (CURVED, curved(body.shape))):
        files[name] = folder / f"{name.replace(' ', '-')}.obj"
        content = mesh_bytes(shape.vertices / 1e3, shape.facets, ".obj", f"{name}, km")
        write_whole(files[name], functools.partial(Path.write_bytes, data=content))
    return files


def changes(files: Mapping[str, Path], body: Body, scenario: Scenario) -> dict[str, dict[str, Any]]:
    """What each line changes in the drawn world."""
    length, thrust = float(body.shape.extents.max()), scenario.spacecraft.thrust_limit_n
    meshes = {
        name: {"truth.mesh": str(path.resolve()), "truth.surface_rms_m": 0.0}
        for name, path in files.items()
    }
    return {
        AS_TOLD: {},
        **meshes,
        "a surface in waves a third as long": {"truth.surface_correlation_m": 0.023 * length},
        "a surface in waves three times as long": {"truth.surface_correlation_m": 0.21 * length},
        "lidar noise twice as large": {"truth.lidar.noise": 2.0},
        "a third of all frames lost": {"truth.lidar.frame_loss": 0.33},
        "attitude that varies in a minute": {
            "truth.attitude.varying_std_deg": 0.02,
            "truth.attitude.correlation_time_s": 60.0,
        },
        "thrust that differs at each step (1 %)": {
            "force_noise": {"std_n": 0.01 * thrust, "correlation_time_s": 0.0}
        },
        "pushes of 0.1 m/s every 15 minutes": {
            "kicks": {"velocity_std_m_s": 0.1, "mean_interval_s": 900.0}
        },
    }


def world(drawn: Scenario, _body: Body, changed: Mapping[str, Any]) -> Scenario:
    """A drawn world with an error of another form; what is told stays."""
    return change_scenario(drawn, changed) if changed else drawn


def figures(rows: Sequence[Row], told: Sequence[Row]) -> list[str]:
    """One line of the table, beside the flights of the first line."""
    flown = [row for row in rows if "unflyable" not in row]
    ends = [row["terminal_position_error_m"] for row in flown]
    ratios = [spent / as_told for spent, as_told in delta_v_pairs(rows, told)]
    known = [row for row in flown if "navigation_consistent" in row]
    successes = sum(row["success"] for row in flown)
    # As in error_scale.py: in a flight that never had a state, the navigation is right nowhere.
    within = np.mean([row.get("navigation_consistent", 0.0) for row in flown])
    return [
        f"{successes} of {len(flown)}",
        interval_text(exact_interval(successes, len(flown)), " to "),
        str(sum(row["keep_out_violations"] for row in flown)),
        f"{min(row['min_clearance_m'] for row in flown) / 1e3:.2f}",
        f"{np.median(ends):.1f}",
        f"{np.max(ends):.0f}",
        f"{np.mean(ratios):.3f}" if ratios else "–",
        f"{np.median([row['navigation_position_error_m_median'] for row in known]):.1f}",
        f"{100.0 * within:.0f}",
    ]


def main() -> None:
    parser = campaign_parser(__doc__, "out/other-forms", transits=40, seed=8800)
    parser.add_argument("--controller", default="hybrid")
    parser.add_argument("--only", nargs="+", metavar="LINE", help="besides the first; default: all")
    asked = parser.parse_args()
    scenario = load_scenario(
        None, {"log_ranges": False, "dispersions": TOLD, "assurance": {"bounds": TOLD}}
    )
    body = load_body(scenario.body)
    every = changes(surfaces(body, asked.out / "surfaces"), body, scenario)
    rows = fly_with_bar(chosen(every, asked), scenario, asked)
    lines = {name: figures(flown, rows[AS_TOLD]) for name, flown in rows.items()}
    title = f"{asked.controller}, assured, {asked.transits} transits of seed {asked.seed}"
    show(title, HEADINGS, lines, asked.markdown)


def chosen(every: Mapping[str, dict[str, Any]], asked: argparse.Namespace) -> list[Variant]:
    """The lines that are asked for, and the first one."""
    for name in asked.only or ():
        if name not in every:
            raise SystemExit(f"--only: there is no line {name!r}; there are {', '.join(every)}")
    return [
        Variant(name, asked.controller, world=functools.partial(world, changed=changed))
        for name, changed in every.items()
        if name == AS_TOLD or asked.only is None or name in asked.only
    ]


if __name__ == "__main__":
    main()
