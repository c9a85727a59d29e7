"""The hybrid's gates: closed forms, and properties of all forces."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from proxops.systems.hybrid.agreement_gates import AgreementGate, GateKind

GATES = {kind: AgreementGate(kind) for kind in GateKind}
sizes = st.floats(0.0, 12.0) | st.floats(0.0, 0.5)
unit = st.tuples(*[st.floats(-1.0, 1.0)] * 3).map(np.array).filter(lambda v: v @ v > 0.01)
forces = st.builds(lambda size, way: size * way / np.linalg.norm(way), sizes, unit)
kinds = st.sampled_from(list(GateKind))


def turned(way: np.ndarray, angle: float, vector: np.ndarray) -> np.ndarray:
    """Rodrigues' formula."""
    axis = way / np.linalg.norm(way)
    across = np.cross(axis, vector)
    return (
        math.cos(angle) * vector
        + math.sin(angle) * across
        + (1.0 - math.cos(angle)) * (axis @ vector) * axis
    )


def agrees(kind: str, one, other) -> bool:
    return GATES[GateKind(kind)].compare(np.array(one), np.array(other)).agrees


@pytest.mark.parametrize(
    ("one", "other", "printed", "paper", "strict"),
    [
        # Opposite: the printed angle is -90 degrees, and is accepted.
        ([3.0, 0.0, 0.0], [-3.0, 0.0, 0.0], True, False, False),
        # Equal directions: +90 degrees, rejected, whatever the sizes.
        ([3.0, 0.0, 0.0], [5.0, 0.0, 0.0], False, True, False),
        ([7.0, 0.0, 0.0], [0.1, 0.0, 0.0], False, True, False),
        # 5 degrees apart, 0.87 N by sizes, 1.1 N in all.
        ([7.0, 0.0, 0.0], [6.17, 0.75, 0.0], False, True, True),
        # At right angles the printed angle is 0.
        ([3.0, 0.0, 0.0], [0.0, 3.0, 0.0], True, False, False),
        # Near each other, whatever the angle.
        ([0.4, 0.0, 0.0], [-0.4, 0.0, 0.0], True, True, True),
        # No direction: the difference decides.
        ([0.0, 0.0, 0.0], [0.9, 0.0, 0.0], True, True, True),
        ([0.0, 0.0, 0.0], [1.1, 0.0, 0.0], False, False, False),
        ([0.15, 0.0, 0.0], [1.16, 0.0, 0.0], False, True, False),
        ([0.0, 0.0, 0.0], [0.0, 0.0, 0.0], True, True, True),
        # Not finite: nothing agrees.
        ([math.nan, 0.0, 0.0], [1.0, 0.0, 0.0], False, False, False),
        ([math.inf, 0.0, 0.0], [1.0, 0.0, 0.0], False, False, False),
    ],
)
@pytest.mark.filterwarnings("ignore:invalid value")
def test_closed_forms(one, other, printed: bool, paper: bool, strict: bool) -> None:
    got = [agrees(kind, one, other) for kind in ("printed", "paper", "strict")]
    assert got == [printed, paper, strict]


@given(kinds, forces, forces)
def test_symmetric(kind: GateKind, one: np.ndarray, other: np.ndarray) -> None:
    there, back = GATES[kind].compare(one, other), GATES[kind].compare(other, one)
    assert there == pytest.approx(back, nan_ok=True)


@given(kinds, forces, forces, unit, st.floats(-math.pi, math.pi))
def test_rotation_changes_nothing(kind, one, other, axis, angle) -> None:
    # Products of tinier forces are zero in floating point.
    assume(all(not 0.0 < np.abs(force).max() < 1e-150 for force in (one, other)))
    gate = GATES[kind]
    before = gate.compare(one, other)
    after = gate.compare(turned(axis, angle, one), turned(axis, angle, other))
    assert after.difference == pytest.approx(before.difference, abs=1e-9)
    if min(np.linalg.norm(one), np.linalg.norm(other)) > 1e-3:
        assert after.angle == pytest.approx(before.angle, abs=1e-6)
    levels = [before.difference - gate.magnitude, before.angle - gate.angle]
    sizes = np.linalg.norm(one), np.linalg.norm(other)
    levels += [abs(sizes[0] - sizes[1]) - gate.magnitude, *(np.array(sizes) - gate.dead_band)]
    assume(np.nanmin(np.abs(levels)) > 1e-6)  # Else rounding decides.
    assert after.agrees == before.agrees


@given(forces, forces)
def test_strict_is_the_strictest_of_the_right_ones(one: np.ndarray, other: np.ndarray) -> None:
    """Two forces in the dead band are 0.4 N apart at most, which is within the limit."""
    if agrees("strict", one, other):
        assert agrees("paper", one, other)
        assert np.linalg.norm(one - other) < 2.4  # 12 N, 10 degrees and 1 N apart.
