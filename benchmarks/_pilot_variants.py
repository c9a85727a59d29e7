"""Variants of a trained pilot with parts taken out, each exported as a bundle that flies."""

from pathlib import Path

import numpy as np
import torch
import trimesh
from torch import Tensor

from proxops.diagrams.flight import file_label
from proxops.diagrams.scenario import load_body, load_scenario
from proxops.systems.shapes import Polyhedron
from proxops.training.data import pack_flights
from proxops.training.export import export_recipe, onnx_export
from proxops.training.networks import MEMORY, Pilot, load_pilot, measurement_noise

# Relative difference that the export accepts: velocities that are differences of unfiltered fixes
# hold rounding errors of positions.
SAME = 1e-3
# Errors of the coarse position over those of the fitted one.
COARSE_NOISE = 30.0
# Grid points of the map along an axis, for each of the learned field.
FINER = 2


class Unfiltered(Pilot):
    """Uses each fix as the position, and its change as the velocity."""

    def see(self, ranges: Tensor, commanded_force: Tensor, memory: Tensor) -> Tensor:
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
    """Uses the coarse position as the fix."""

    def fix(self, ranges: Tensor, memory: Tensor) -> Tensor:
        return self.coarse(*self.hits(ranges))


class FilteredFeatures(Pilot):
    """Filters the coarse position; there is no geometry layer."""

    def see(self, ranges: Tensor, commanded_force: Tensor, memory: Tensor) -> Tensor:
        fix = self.coarse(*self.hits(ranges))
        usual = measurement_noise(torch.zeros_like(fix[:, :1]), self.usual_residual)
        memory = self.filter.predict(memory, commanded_force)
        return self.filter.correct(memory, fix - memory[:, :3], COARSE_NOISE * usual)


class Mapped(Pilot):
    """Has the map of the surface in place of the learned field."""

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


def pilot_variant(kind: type[Pilot], folder: Path) -> Pilot:
    """The pilot of a folder, with the navigation of `kind`."""
    dimensions, whole = load_pilot(folder)
    made = dimensions.make()
    pilot = kind(made.hits, made.coarse, made.geometry, made.filter, made.guidance)
    pilot.load_state_dict(whole.state_dict())
    if isinstance(pilot, Mapped):
        pilot.learn_map(load_body(load_scenario().body).shape)
    return pilot.eval()


def pilot_bundles(logs: Path, pilot: Path, dagger: Path, out: Path) -> dict[str, Path]:
    """Exports the variants; gives the folders of their bundles by name.

    Args:
      logs: folder of the flights that the pilot learned from.
      pilot, dagger: folders that `proxops train` and `proxops dagger` wrote.
      out: folder of the bundles.
    """
    onnx_export._TOLERANCE = SAME
    data = pack_flights(logs)
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
        folders[label] = out / file_label(label)
        export_recipe(
            pilot_variant(kind, folder), data, folders[label],
            recipe=f"ablation: {label}", memory=MEMORY, estimates=True,
            data_sha256=data.logs_sha256, metrics={},
        )  # fmt: skip
    return folders
