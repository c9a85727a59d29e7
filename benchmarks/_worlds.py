"""Worlds that are further off, or off in another way, than anybody on board is told."""

import dataclasses as dc
import functools
import math
import typing
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from proxops.diagrams.scenario import (
    Body,
    Dispersion,
    Scenario,
    change_scenario,
    check_scenario,
    draw_world,
)
from proxops.diagrams.scenario.dispersions import Dispersions
from proxops.diagrams.scenario.distributions import (
    Choice,
    Fixed,
    HalfNormal,
    LogUniform,
    Normal,
    Uniform,
)
from proxops.diagrams.scenario.quantities import QUANTITY
from proxops.diagrams.scenario.world import world_of
from proxops.systems.common import generator, make_folder, write_whole
from proxops.systems.shapes import Polyhedron, mesh_bytes

# What says how errors are drawn, not how large they are.
_NO_ERRORS = ("correlation", "mesh", "specific_impulse", "failure")
# A fixed value of these is worse if it is smaller.
_SMALLER_IS_WORSE = ("truth.specific_impulse_s",)
# Of the boulders and craters: their number, their width (the radius at which 1/e of the height is
# left) over the body's length, and the surface's root mean square over it.
_PLACES, _WIDTH, _RMS = 20, 0.03, 5e-4


def farther_off(scenario: Scenario, body: Body, times: float) -> Scenario:
    """A world in which every error of the truth is `times` as large, and nobody is told.

    The specific impulse stays: its error is the propellant that the believed mass leaves out.
    """
    drawn, usual = dc.asdict(scenario.truth), dc.asdict(Scenario().truth)
    return change_scenario(scenario, {"truth": _scaled(drawn, usual, times)})


def _scaled(drawn: dict, usual: dict, times: float) -> dict:
    """Numbers of nested mappings, `times` as far from the usual ones."""
    found = {}
    for key, value in drawn.items():
        nominal = usual.get(key)
        if isinstance(value, dict):
            found[key] = _scaled(value, nominal or {}, times)
        # A whole number says which, when or how many.
        elif isinstance(value, str | int | None) or any(part in key for part in _NO_ERRORS):
            found[key] = value
        else:
            base = np.array(nominal)
            found[key] = (base + times * (np.array(value) - base)).tolist()
    return found


def changed_world(drawn: Scenario, _body: Body, changed: Mapping[str, typing.Any]) -> Scenario:
    """A drawn world with an error of another form; what is told stays."""
    return change_scenario(drawn, changed) if changed else drawn


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
    """The shape with each facet divided into four, whose new vertices lie on PN triangles.

    Source: A. Vlachos et al., Curved PN Triangles, Symposium on Interactive 3D Graphics, 2001.
    """
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


def other_forms(scenario: Scenario, body: Body, folder: Path) -> dict[str, dict[str, typing.Any]]:
    """Changes of a drawn world, by name; writes the true surfaces as meshes in km into a folder."""
    length, thrust = float(body.shape.extents.max()), scenario.spacecraft.thrust_limit_n
    make_folder(folder)
    meshes = {}
    for name, shape in (
        ("boulders and craters", boulders(body.shape, 1)),
        ("curved facets", curved(body.shape)),
    ):
        file = folder / f"{name.replace(' ', '-')}.obj"
        content = mesh_bytes(shape.vertices / 1e3, shape.facets, ".obj", f"{name}, km")
        write_whole(file, functools.partial(Path.write_bytes, data=content))
        meshes[name] = {"truth.mesh": str(file.resolve()), "truth.surface_rms_m": 0.0}
    thirds = {"truth.surface_correlation_m": 0.023 * length}
    relief = {
        "navigation.expected.relief_rms_m": _RMS * length,
        "navigation.expected.relief_correlation_m": _WIDTH * length,
    }
    fine = meshes | {"a surface in waves a third as long": thirds}
    return {
        **fine,
        **{f"{name}, told as relief": changed | relief for name, changed in fine.items()},
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


def _is_number(value: typing.Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


@dc.dataclass(frozen=True)
class FarOut:
    """A quantity that is set far out, and values that mean something only with it, drawn."""

    main: Dispersion
    parts: tuple[Dispersion, ...] = ()

    @property
    def has_multiples(self) -> bool:
        """Whether a multiple of the bound is another value: not so of a name or a choice."""
        return self._value(1.0, 1.0) != self._value(1.0, 2.0)

    def is_clipped(self, scenario: Scenario, body: Body, multiple: float) -> bool:
        """Whether a value this far out is beyond what the scenario permits."""
        ends = [self.main.in_its_unit(self._value(u, multiple), scenario, body) for u in (0.0, 1.0)]
        return ends != [self.value(u, multiple, scenario, body) for u in (0.0, 1.0)]

    def value(self, uniform: float, multiple: float, scenario: Scenario, body: Body):
        """The value, or one number of a list, within what the scenario permits."""
        value = self.main.in_its_unit(self._value(uniform, multiple), scenario, body)
        limits = self.main.limits
        if limits is None or not _is_number(value):
            return value
        return min(max(value, limits[0]), limits[1])

    def _value(self, uniform: float, multiple: float) -> typing.Any:
        multiple /= math.sqrt(self.main.size or 1)
        match self.main.distribution:
            case Normal(mean, three_sigma):
                return mean + math.copysign(multiple * three_sigma, uniform - 0.5)
            case HalfNormal(least, three_sigma):
                return least + multiple * three_sigma
            case LogUniform(low, high):
                return math.sqrt(low * high) * math.sqrt(high / low) ** multiple
            case Uniform(low, high):
                return low + multiple * (high - low)
            case Fixed((same,)) if _is_number(same):
                return same / multiple if self.main.key in _SMALLER_IS_WORSE else multiple * same
            case Choice(values):
                return values[-1]


def quantities(dispersions: Sequence[Dispersion]) -> list[FarOut]:
    """The dispersed quantities; keys that only mean something together are one."""
    whole = {each.key: QUANTITY[each.key].needs for each in dispersions}
    return [
        FarOut(main, tuple(each for each in dispersions if whole[each.key] == main.key))
        for main in dispersions
        if whole[main.key] not in whole
    ]


def as_believed(scenario: Scenario, body: Body, dispersions: str) -> Scenario:
    """The scenario as it is, but for its navigation, which is told the dispersions."""
    drawn = draw_world(dc.replace(scenario, dispersions=dispersions), body)
    return dc.replace(scenario, navigation=drawn.navigation)


def far_out_world(scenario: Scenario, body: Body, quantity: FarOut, multiple: float) -> Scenario:
    """The world of a scenario's flight in which one quantity alone is far out.

    A value that is normal is `multiple` times three standard deviations from its mean, on a random
    side. Of a list, the norm of the deviation is that: each of its n numbers is off by the share
    1/sqrt(n), on a side of its own. The sides depend on seed and number of the transit and on the
    key alone.
    """

    def value(each: Dispersion, uniform: float) -> typing.Any:
        if each is quantity.main:
            return quantity.value(uniform, multiple, scenario, body)
        return each.in_its_unit(each.distribution.value(uniform), scenario, body)

    together = [quantity.main, *quantity.parts]
    world = world_of(Dispersions(scenario, body, together), value)
    world.dispersed = [each.key for each in together]
    check_scenario(world, f"{quantity.main.key} x {multiple:g}, transit {scenario.transit.index}")
    return world


def one_off(
    scenario: Scenario, body: Body, dispersions: str, quantity: FarOut, multiple: float
) -> Scenario:
    """As `as_believed`, but in the world of `far_out_world`."""
    return far_out_world(as_believed(scenario, body, dispersions), body, quantity, multiple)
