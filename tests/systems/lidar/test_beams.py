"""Rays with a width: against many thin rays in their cones, and bodies with closed forms."""

import numpy as np
import pytest
import trimesh
from contact_binary import box, polyhedron
from scipy.spatial.transform import Rotation

from proxops.systems import Lidar, LidarErrors, LidarGeometry, Polyhedron, RayCaster

FEW = LidarGeometry(planes=12, rays=180)
# A field of 60 degrees, which looks along -x.
FLASH, DOWN = LidarGeometry(40, 50, field_of_view=1.05), Rotation.from_rotvec([0.0, -1.5, 0.0])
# Outside Kleopatra: far, near, and in the gap beside its neck.
PLACES = np.array(
    [[150e3, 20e3, 10e3], [-60e3, 120e3, -90e3], [20e3, 80e3, 40e3], [5e3, -50e3, 45e3]]
)


def true_ranges(lidar: Lidar, place: np.ndarray, rotation: np.ndarray | None = None) -> np.ndarray:
    returns = lidar.true_returns(np.asarray(place, dtype=float), rotation)
    assert np.all(np.diff(returns.rays) > 0)
    ranges = np.full(lidar.geometry.size, np.inf)
    ranges[returns.rays] = returns.distances
    return ranges


def by_many_rays(
    shape: Polyhedron, directions: np.ndarray, place: np.ndarray, width: float
) -> np.ndarray:
    """The nearest of 500 thin rays in each cone: 100 on its rim, the others spread over it."""
    spread = np.arange(400)
    share = np.append(np.sqrt(spread / 400.0), np.ones(100))
    around = np.append(spread * np.pi * (3.0 - np.sqrt(5.0)), np.arange(100) * np.pi / 50.0)
    across = np.cross(directions, [0.3, 0.5, 0.81])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    upwards, caster = np.cross(directions, across), RayCaster(shape)
    nearest, origins = np.full(len(directions), np.inf), np.tile(place, (len(directions), 1))
    for off, turn in zip(0.5 * width * share, around, strict=True):
        side = np.cos(turn) * across + np.sin(turn) * upwards
        rays = np.cos(off) * directions + np.sin(off) * side
        nearest = np.minimum(nearest, caster.distances(origins, rays))
    return nearest


@pytest.mark.parametrize("turn", [None, Rotation.from_rotvec([1.0, 0.5, -2.0]), DOWN])
@pytest.mark.parametrize("width", [1e-3, 5e-3])
def test_a_beam_reads_the_nearest_of_many_rays(
    kleopatra: Polyhedron, width: float, turn: Rotation | None
) -> None:
    """No ray in the cone reads less; the nearest of 500 reads more by far less than the noise."""
    geometry = FLASH if turn is DOWN else FEW
    lidar = Lidar(kleopatra, LidarErrors(beam_width=width), geometry)
    line = Lidar(kleopatra, LidarErrors(), geometry)
    rotation = None if turn is None else turn.as_matrix()
    directions = lidar.directions if turn is None else turn.apply(lidar.directions)
    excess, shorter, limb = [], [], 0
    for place in PLACES:
        got, thin = true_ranges(lidar, place, rotation), true_ranges(line, place, rotation)
        wanted = by_many_rays(kleopatra, directions, place, width)
        # Rays spread over the cone can miss what touches it by a hair.
        assert (np.isfinite(got) != np.isfinite(wanted)).sum() <= 1
        both = np.isfinite(got) & np.isfinite(wanted)
        excess.append(wanted[both] - got[both])
        met = np.isfinite(thin)
        shorter.append(thin[met] - got[met])
        limb += int((np.isfinite(got) & ~np.isfinite(thin)).sum())
    excess, shorter = np.concatenate(excess), np.concatenate(shorter)
    assert len(excess) > 200
    # 0.2 m: the single precision of the rays, at grazing incidence.
    assert excess.min() > -0.2
    assert np.quantile(excess, 0.95) < 1.0
    assert np.quantile(excess, 0.99) < 10.0
    # It is an effect that matters: a line reads more.
    assert np.median(shorter) > 20.0 * width / 1e-3
    assert shorter.min() >= 0.0
    assert width == 1e-3 or limb > 0


def test_a_wall_in_closed_form() -> None:
    """To a plane, the nearest ray in the cone is the axis turned towards its normal."""
    lidar = Lidar(
        polyhedron(box([60e3, 0.0, 0.0], [20e3, 4e6, 4e6])),
        LidarErrors(beam_width=0.02),
        LidarGeometry(max_range=np.inf),
    )
    got = true_ranges(lidar, np.zeros(3))
    incidence = np.arccos(np.clip(lidar.directions[:, 0], -1.0, 1.0))
    wanted = 50e3 / np.cos(np.maximum(incidence - 0.01, 0.0))
    seen = incidence < np.radians(85.0)
    assert seen.sum() > 1000
    np.testing.assert_allclose(got[seen], wanted[seen], rtol=1e-9)
    assert np.isinf(got[incidence > np.radians(91.0)]).all()


def test_a_ball_returns_to_beams_that_pass_it_by() -> None:
    """At the limb: a beam returns up to the angle of the tangent and half its width."""
    radius, distance, width = 10e3, 100e3, 0.02
    ball = trimesh.creation.icosphere(6, radius)
    lidar = Lidar(polyhedron(ball), LidarErrors(beam_width=width), LidarGeometry(12, 3600))
    place = np.array([-distance, 0.0, 0.0])
    got = true_ranges(lidar, place)
    off = np.arccos(np.clip(lidar.directions[:, 0], -1.0, 1.0))
    limb = np.arcsin(radius / distance)
    assert np.isfinite(got[off < limb + 0.5 * width - 1e-4]).all()
    assert np.isinf(got[off > limb + 0.5 * width]).all()
    # Where the axis is turned towards the centre, it meets the ball at an angle less by the half.
    near = np.maximum(off - 0.5 * width, 0.0)
    seen = near < 0.9 * limb
    near = near[seen]
    wanted = distance * np.cos(near) - np.sqrt(radius**2 - (distance * np.sin(near)) ** 2)
    # Facets of 1.3 degrees lie up to 0.7 m inside the ball, and more along slanting rays.
    assert np.abs(got[seen] - wanted).max() < 3.0


def test_a_thin_pole_in_front_of_a_wall() -> None:
    """The axis meets the wall; a pole beside it reaches into the cone, and is nearer."""
    wall = box([110e3, 0.0, 0.0], [20e3, 100e3, 100e3])
    for off, seen in ((70.0, True), (90.0, False), (-70.0, True)):
        pole = box([50e3, off + np.sign(off) * 25.0, 0.0], [50.0, 50.0, 40e3])
        lidar = Lidar(polyhedron(wall, pole), LidarErrors(beam_width=3e-3))
        assert true_ranges(Lidar(polyhedron(wall, pole), LidarErrors()), np.zeros(3))[
            0
        ] == pytest.approx(100e3, abs=0.02)
        # The pole's near corner is at 49,975 m; the cone is 75 m wide there on each side.
        got = true_ranges(lidar, np.zeros(3))[0]
        wanted = np.hypot(50e3 - 25.0, off) if seen else 100e3
        assert got == pytest.approx(wanted, abs=0.02)


def test_incidence_is_that_of_the_axis(kleopatra: Polyhedron) -> None:
    """An axis that grazes loses the return; a beam whose axis misses keeps it."""
    place, errors = PLACES[0], LidarErrors(beam_width=5e-3, max_incidence=1.0)
    beams = Lidar(kleopatra, errors).true_returns(place)
    lines = Lidar(kleopatra, LidarErrors(max_incidence=1.0)).true_returns(place)
    assert beams.grazing is not None
    assert lines.grazing is not None
    common = np.isin(beams.rays, lines.rays)
    assert np.array_equal(beams.grazing[common], lines.grazing)
    assert (~common).any()
    assert not beams.grazing[~common].any()
