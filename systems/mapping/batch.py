"""`estimated`: map, path and rotation, from returns and an ellipsoid, coarse to fine."""

from __future__ import annotations

import dataclasses as dc
from typing import NamedTuple

import numpy as np

from proxops.systems.common import InputError, Progress, Vector3, Vectors3, silent
from proxops.systems.mapping.first_orbit import of_body, with_first_orbit
from proxops.systems.mapping.free_surface import Mesh, free_surface, oriented, untangled
from proxops.systems.mapping.path import Path
from proxops.systems.mapping.returns import Returns
from proxops.systems.mapping.spheres import sphere
from proxops.systems.mapping.survey_filter import Around
from proxops.systems.mapping.survey_fit import (
    GRAVITY,
    RATE,
    ROTATION,
    TAIL,
    TAIL_OF_TUMBLING,
    Expected,
    Solution,
    Survey,
    Tumbling,
    Weighting,
    improved,
)  # fmt: skip
from proxops.systems.shapes import mass_properties

# Knots of the path, over the time in which the acceleration's correlation falls to 1/e; and of the
# attitude. A burn is taken as one kick for at most this share of the time between knots.
_KNOTS, _TURNS, _BURN = 1.0, 0.67, 0.25
# The mesh has about this many facets at the end.
FACETS = 14_000
# Returns beyond so many are left out evenly: the map's facets say what is left.
_MOST = 300_000
# Points from which a free surface is begun.
_POINTS = 120_000


class Stage(NamedTuple):
    """Steps of Gauss-Newton that weigh alike."""

    surface: float
    """Standard deviation of the map's own error, over the body's size."""
    steps: int
    stride: int
    """Of the returns, one in so many is used."""
    hold: bool = False
    facets: int = 0
    """Of a new free surface before the stage; 0: that of the stage before."""


STAGES = (
    Stage(0.03, 3, 4, hold=True),
    Stage(0.015, 1, 4, hold=True),
    Stage(0.007, 2, 4),
    Stage(0.004, 3, 3, facets=2500),
    Stage(0.0015, 2, 2, facets=3000),
    Stage(0.0002, 3, 1, facets=FACETS),
)
_SLIDE = 0.03
# The map's size is within this factor of the ellipsoid's.
_UNLIKE = 1.6
_MOST_OF_IT = 0.01, 0.99
_ROUGHNESS = 0.3


class Estimated(NamedTuple):
    """What a survey found."""

    survey: Survey
    solution: Solution
    returns: Returns
    """Those of the body."""


def estimated(
    returns: Returns, around: Around, expected: Expected, progress: Progress = silent
) -> Estimated:
    """Estimates all that a survey can: see `Survey`.

    First one orbit is fitted to the middles of the frames. Then follow star-shaped maps, and free
    surfaces from the placed returns, each fitted to the returns together with all else.

    Args:
      returns: what was measured, without those of moons. around: what was believed before.
      expected: how wrong that may be.
      progress: is called with the share done.

    Raises:
      InputError: the body was hardly seen, the returns show no closed surface, or a body of
        another size.
    """
    semi_axes, longest = around.semi_axes, around.longest
    returns = returns.chosen(np.flatnonzero(of_body(returns, longest)))
    returns = returns.chosen(np.arange(0, len(returns.frames), 1 + len(returns.frames) // _MOST))
    believed = _believed(returns, around, expected)
    survey = with_first_orbit(believed, returns, expected, semi_axes)
    size, done, solution = 2.0 * longest, 0.0, None
    whole = sum(stage.steps / stage.stride for stage in STAGES)
    for stage in STAGES:
        if stage.facets:
            survey = _freed(survey, returns, stage.facets)
        some = returns.chosen(np.arange(0, len(returns.frames), stage.stride))
        free = len(survey.vertices) != len(believed.vertices)
        slide = _SLIDE * size if free else 0.0
        weighting = Weighting(stage.surface * size, _ROUGHNESS, free, slide, stage.hold)
        for _ in range(stage.steps):
            progress(done / whole, f"a map of {len(survey.facets)} facets")
            survey, solution = improved(survey, some, believed, expected, weighting)
            if free:
                survey = _with_inertia(survey)
            done += 1.0 / stage.stride
        # A vertex that stands out alone, by false returns, is gone with the next surface.
        _check_size(np.quantile(survey.vertices, _MOST_OF_IT, axis=0), semi_axes)
    assert solution is not None
    mesh = untangled(Mesh(survey.vertices, survey.facets))
    _check_size(mesh.vertices, semi_axes)
    survey = dc.replace(survey, vertices=mesh.vertices)
    return Estimated(survey, solution, returns)


def _check_size(vertices: Vectors3, semi_axes: Vector3) -> None:
    """Refuses a map that is no body of the ellipsoid."""
    found, wanted = np.ptp(vertices, axis=0).max(), 2.0 * np.max(semi_axes)
    if not wanted / _UNLIKE < found < wanted * _UNLIKE:
        raise InputError(
            f"the frames show a body of {found:.3g} m, and the ellipsoid has {wanted:.3g} m: they "
            "are of another body, or task.semi_axes_m is wrong"
        )


def _believed(returns: Returns, around: Around, expected: Expected) -> Survey:
    """What is believed before the survey; its path is at the origin."""
    start, end = float(returns.times[0]), float(returns.times[-1])
    spacing = _KNOTS * expected.varying_time
    burns = returns.burns(_BURN * spacing).within(start, end)
    path = Path.between(start, end, spacing, burns.times)
    nodes = max(2, round((end - start) / (_TURNS * expected.turning_time)) + 1)
    tail = np.zeros(TAIL if around.spin is None else TAIL_OF_TUMBLING)
    tail[RATE], tail[GRAVITY] = around.rate, around.gm
    epoch, ball = 0.5 * (start + end), sphere(3)
    tumbling = None
    if around.spin is not None:
        tail[ROTATION] = around.spin.angular_velocity(epoch)
        tumbling = Tumbling(around.turn(epoch), around.spin.inertia)
    return Survey(
        path, np.zeros((path.size, 3)), (returns.times, returns.driven),
        np.zeros((nodes, 3)), np.linspace(start, end, nodes), tail,
        epoch, around.rate * epoch, ball.vertices * around.semi_axes, ball.facets, burns.kicks,
        around.moons, tumbling,
    )  # fmt: skip


def _freed(survey: Survey, returns: Returns, facets: int) -> Survey:
    """The survey with a free surface by its placed returns."""
    some = returns.chosen(np.arange(0, len(returns.frames), 1 + len(returns.frames) // _POINTS))
    placed = survey.placed(some)
    rays = np.einsum("kji,kj->ki", placed.bodies[some.frames], placed.along)
    points = oriented(placed.points, rays)
    mesh = free_surface(points, 1.1 * float(points.areas.sum()), facets)
    return dc.replace(survey, vertices=mesh.vertices, facets=mesh.facets)


def _with_inertia(survey: Survey) -> Survey:
    """The survey of a body that tumbles, with the inertia of its map."""
    if survey.tumbling is None:
        return survey
    inertia = mass_properties(survey.vertices, survey.facets).inertia
    return dc.replace(survey, tumbling=survey.tumbling._replace(inertia=inertia))
