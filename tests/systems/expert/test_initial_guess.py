"""First guesses of plans: their ends and sides, and that the better way round is found."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from transit_sets import transit_set

from proxops.diagrams.flight.scenario_systems import make_mpc
from proxops.diagrams.scenario import Scenario, load_body
from proxops.systems import Horizon, Plan, TransitProgram
from proxops.systems.expert.initial_guess import initial_paths
from proxops.systems.shapes.ellipsoid import blocks_segment

AXES = np.array([143e3, 73e3, 68e3])
FRACTIONS = Horizon().fractions()
place = st.lists(st.floats(-170e3, 170e3), min_size=3, max_size=3).map(np.array)


def outside(point: np.ndarray) -> bool:
    return bool(np.linalg.norm(point / AXES) > 1.0)


@given(place, place)
def test_paths_lead_from_start_to_end_and_stay_outside(start, end):
    assume(outside(start) and outside(end))
    paths = initial_paths(FRACTIONS, start, end, AXES)
    for path in paths:
        assert path[[0, -1]] == pytest.approx(np.stack([start, end]), abs=1e-3)
        assert np.linalg.norm(path / AXES, axis=1).min() > 1.0 - 1e-9
    a, b = (point / AXES / np.linalg.norm(point / AXES) for point in (start, end))
    apart = np.degrees(np.arccos(np.clip(a @ b, -1.0, 1.0)))
    both = blocks_segment(AXES, start, end) and apart > 60.0 + 1e-6
    if both or not blocks_segment(AXES, start, end):
        assert len(paths) == 1 + both
    if both:  # Half-way they are on opposite sides.
        middle = [initial_paths(np.array([0.5]), start, end, AXES)[k][0] / AXES for k in (0, 1)]
        x, y = (m / np.linalg.norm(m) for m in middle)
        assert x @ y < -0.99


def test_ends_between_which_nothing_chooses():
    """Their directions add up to just what the axis would add, the other way."""
    z = -0.05
    start = 1.2 * np.array([np.sqrt(1.0 - z**2), 0.0, z]) * AXES
    for path in initial_paths(FRACTIONS, start, start * [-1.0, 1.0, 1.0], AXES):
        assert np.isfinite(path).all()


@pytest.mark.parametrize("axis", range(3))
def test_exactly_opposite_ends_go_round_by_a_short_axis(axis):
    """The shortest that is not their own: over the pole or, from pole to pole, by the waist."""
    start = 1.2 * AXES * np.eye(3)[axis]
    near = [path / AXES for path in initial_paths(FRACTIONS, start, -start, AXES)]
    by = 2 if axis < 2 else 1
    assert [np.sign(path[1:-1, by]).sum() for path in near] == [15.0, -15.0]
    for path in near:
        assert np.delete(path, [axis, by], axis=1) == pytest.approx(0.0, abs=1e-9)


# Which way round


def plan_by(program: TransitProgram, ends: tuple[np.ndarray, np.ndarray], side: float) -> Plan:
    """From a bow of a path by the side at an angle in rad about the line between the ends."""
    start, target = ends
    along = (target - start)[:3] / np.linalg.norm((target - start)[:3])
    across = np.linalg.svd(along[None])[2][1:]
    bow = np.array([np.cos(side), np.sin(side)]) @ across * AXES
    (share,) = FRACTIONS[None, :, None]
    positions = (1.0 - share) * start[:3] + share * target[:3] + 6.0 * share * (1.0 - share) * bow
    times = 6000.0 * FRACTIONS
    states = np.hstack([positions, np.gradient(positions, times, axis=0)])
    guess = Plan(times, states, np.zeros((16, 3)), target, 0.0, 0.0, 0, 0)
    return program.solve(start, target, guess, iterations=25)


@pytest.mark.slow
@pytest.mark.parametrize("index", [77, 81, 87, 501, 191])
def test_the_cheaper_way_round_is_taken(index):
    """Transits 77, 87 and 501 are cheaper by the longer of the two initial guesses.

    By the other, the first of them, from pole to pole, would take longer than a success may.
    """
    program = make_mpc(Scenario(), load_body("kleopatra")).program
    assert isinstance(program, TransitProgram)
    transit = transit_set(15000, index + 1)[index]
    ends = np.r_[transit.start, np.zeros(3)], np.r_[transit.goal, np.zeros(3)]
    plan = program.solve(*ends, iterations=10)
    others = [plan_by(program, ends, side) for side in np.arange(8) * np.pi / 4.0]
    best = min(other.cost for other in others if other.slack < 1e-9)
    assert plan.slack < 1e-9
    assert plan.cost < 1.01 * best
    if index == 77:
        assert plan.times[-1] < 6800.0
        assert max(other.times[-1] for other in others) > 7500.0
