"""What each part of the pilot buys, in closed loop: the ladder from the paper's policy to ours.

Parts are taken out of a trained pilot, each variant is exported as a bundle of its own, and all fly
the same transits. The last is given the map of the surface, on a finer grid, in place of the field
that it learned. Flights are kept one by one: run it again to finish what was interrupted.

    python benchmarks/ablation.py --data out/full --pilot out/pilot --dagger out/dagger
        [--paper out/paper-policy] [--transits 40] [--seed 50] [--workers N]
        [--out out/ablation] [--markdown table.md]

`--pilot` is what `proxops train` wrote, `--dagger` what `proxops dagger` made of it.
"""

import argparse
import os
from pathlib import Path

for name in ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[name] = "1"

import numpy as np
import torch
import trimesh
from _table import flying, show
from torch import Tensor

from proxops.diagrams.flight import file_label
from proxops.diagrams.scenario import load_body, load_scenario
from proxops.studies.evaluation import fly_controllers
from proxops.systems.shapes import Polyhedron
from proxops.training.data import PackedFlights, pack_flights
from proxops.training.export import export_recipe, onnx_export
from proxops.training.pilot import MEMORY, Pilot, load_pilot, measurement_noise

# What the export takes for the same, relatively: velocities that are differences of unfiltered
# fixes hold rounding errors of positions.
SAME = 1e-3
# Of the coarse position, against the fit's: its errors are so many times as large.
COARSE_DOUBT = 30.0
# Grid points of the map along an axis, for each of the learned field.
FINER = 2
HEADINGS = (
    "success", "collisions", "keep-out violations", "end error, median (km)", "p95 (km)",
    "position error, median (m)", "velocity error, median (m/s)",
)  # fmt: skip


class Unfiltered(Pilot):
    """Takes each fix for the position, and its change for the velocity."""

    def see(self, ranges: Tensor, applied_force: Tensor, memory: Tensor) -> Tensor:
        fix = self.fix(ranges, memory)
        started = memory[:, -1:]
        velocity = started * (fix - memory[:, :3]) / self.filter.motion.period
        natural = self.filter.motion.natural(fix, velocity)
        known = torch.zeros_like(memory[:, 6:15]), natural, torch.ones_like(started)
        return torch.cat([fix, velocity, *known], dim=1)

    def fix(self, ranges: Tensor, memory: Tensor) -> Tensor:
        points, solid, valid, count = self.hits(ranges)
        place = self.coarse(points, solid, valid, count)
        for _ in range(3):
            place, _ = self.geometry(place, points, valid)
        return place


class Features(Unfiltered):
    """Has the coarse position alone."""

    def fix(self, ranges: Tensor, memory: Tensor) -> Tensor:
        return self.coarse(*self.hits(ranges))


class FilteredFeatures(Pilot):
    """Filters the coarse position."""

    def see(self, ranges: Tensor, applied_force: Tensor, memory: Tensor) -> Tensor:
        fix = self.coarse(*self.hits(ranges))
        usual = measurement_noise(torch.zeros_like(fix[:, :1]), self.usual_residual)
        memory = self.filter.predict(memory, applied_force)
        return self.filter.correct(memory, fix - memory[:, :3], COARSE_DOUBT * usual)


class Mapped(Pilot):
    """Is given the surface's map: what there is to gain from knowing the body."""

    @torch.no_grad()
    def learn_map(self, shape: Polyhedron) -> None:
        field = self.geometry.field
        counts = [FINER * (count - 1) + 1 for count in reversed(field.values.shape[2:])]
        axes = [torch.linspace(-1.0, 1.0, count, dtype=torch.float64) for count in counts]
        grid = torch.stack(torch.meshgrid(*axes, indexing="ij"), dim=-1)
        points = (field.centre + field.reach * grid).reshape(-1, 3).numpy()
        mesh = trimesh.Trimesh(shape.vertices, shape.facets, process=False)
        nearest, distance, _ = trimesh.proximity.closest_point(mesh, points)
        outside = np.where(mesh.contains(points), -1.0, 1.0)[:, None]
        normal = outside * (points - nearest) / np.maximum(distance, 1e-3)[:, None]
        values = np.hstack([outside * distance[:, None] / field.units[0].item(), normal])
        values = torch.tensor(values.reshape(*counts, 4), dtype=torch.float32)
        field.values = torch.nn.Parameter(values.permute(3, 2, 1, 0)[None].contiguous())


def variant(kind: type[Pilot], folder: Path) -> Pilot:
    """The pilot of a folder, seeing as `kind` does."""
    shape, whole, _ = load_pilot(folder)
    made = shape.make()
    pilot = kind(made.hits, made.coarse, made.geometry, made.filter, made.guidance)
    pilot.load_state_dict(whole.state_dict())
    if isinstance(pilot, Mapped):
        pilot.learn_map(load_body(load_scenario().body).shape)
    return pilot.eval()


def bundles(data: PackedFlights, pilot: Path, dagger: Path, out: Path) -> dict[str, Path]:
    """Folders of the variants' bundles, by what the table calls them."""
    kinds = {
        "features": (Features, pilot),
        "features and filter": (FilteredFeatures, pilot),
        "and geometry layer, no filter": (Unfiltered, pilot),
        "and filter": (Pilot, pilot),
    }
    rounds = sorted(dagger.glob("round-*"), key=lambda folder: int(folder.name.split("-")[1]))
    kinds |= {f"and DAgger, round {k}": (Pilot, each) for k, each in enumerate(rounds, start=1)}
    if rounds:
        kinds["the same, given the map"] = Mapped, rounds[-1]
    folders = {}
    for label, (kind, folder) in kinds.items():
        folders[label] = out / "bundles" / file_label(label)
        if not folders[label].exists():
            export_recipe(
                variant(kind, folder), data, folders[label],
                recipe=f"ablation: {label}", memory=MEMORY, estimates=True,
                data_sha256=data.logs_sha256, metrics={},
            )  # fmt: skip
    return folders


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    for name in ("data", "pilot", "dagger"):
        parser.add_argument(f"--{name}", type=Path)
    parser.add_argument("--paper", type=Path, help="what train --recipe paper wrote")
    parser.add_argument("--transits", type=int, default=40)
    parser.add_argument("--seed", type=int, default=50)
    parser.add_argument("--workers", type=int)
    parser.add_argument("--out", type=Path, default=Path("out/ablation"))
    parser.add_argument("--markdown", type=Path)
    asked = parser.parse_args()
    if None in (asked.data, asked.pilot, asked.dagger):
        # `make bench` runs all programs as they are.
        parser.exit(message="ablation.py needs --data, --pilot and --dagger: nothing is flown\n")
    onnx_export._TOLERANCE = SAME
    folders = bundles(pack_flights(asked.data / "flights"), asked.pilot, asked.dagger, asked.out)
    if asked.paper is not None:
        folders = {"the paper's": asked.paper / "bundle", **folders}
    names = {f"policy:{folder.resolve()}": label for label, folder in folders.items()}
    with flying(asked.workers) as workers:
        results = fly_controllers(
            list(names), load_scenario(None, {"log_ranges": False}), asked.seed, asked.transits,
            asked.out / "flights", workers=workers,
        )  # fmt: skip
    lines = {names[name]: cells(result) for name, result in results.items()}
    title = f"{asked.transits} transits of seed {asked.seed}"
    show(title, HEADINGS, lines, asked.markdown)


def cells(result: dict) -> list[str]:
    def of(name: str, form: str, unit: float = 1.0) -> str:
        value = result.get(name)
        return "–" if value is None else format(value / unit, form)

    return [
        f"{round(result['success_rate'] * result['transits'])}/{result['transits']}",
        str(result["collisions"]),
        str(result["keep_out_violations"]),
        of("terminal_position_error_m_median", ".3f", 1e3),
        of("terminal_position_error_m_p95", ".3f", 1e3),
        of("estimate_position_error_m_median", ".0f"),
        of("estimate_velocity_error_m_s_median", ".3f"),
    ]


if __name__ == "__main__":
    main()
