"""When the hybrid checks next: the fixed period, and how the adaptive one grows and shrinks."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from proxops.systems import CheckSchedule, InputError, PeriodRule
from proxops.systems.agreement_gates import Agreement

ADAPTIVE = CheckSchedule(PeriodRule.ADAPTIVE)
differences = st.floats(0.0, 12.0)


def agreed(difference: float) -> Agreement:
    return Agreement(True, difference, 0.0)


@given(st.floats(1.0, 100.0), differences, st.booleans(), st.integers(0, 200))
def test_fixed_is_fixed(last: float, difference: float, agrees: bool, steps: int) -> None:
    schedule = CheckSchedule(PeriodRule.FIXED, check_period=7)
    assert schedule.next_period(last, Agreement(agrees, difference, 0.0), 1.0, steps) == 7.0


@pytest.mark.parametrize(
    ("difference", "following"),
    [(0.0, 40.0), (0.5, 20.0), (1.0, 10.0), (3.0, 10.0), (0.25, 20.0 * 2.0**0.5)],
)
def test_agreement_stretches_or_shrinks(difference: float, following: float) -> None:
    assert ADAPTIVE.next_period(20.0, agreed(difference), 1.0, 1000) == pytest.approx(following)
    # It is the difference over the limit that counts.
    twice = ADAPTIVE.next_period(20.0, agreed(2.0 * difference), 2.0, 1000)
    assert twice == pytest.approx(following)


def test_bounds() -> None:
    assert ADAPTIVE.next_period(80.0, agreed(0.0), 1.0, 1000) == 100.0
    assert ADAPTIVE.next_period(80.0, agreed(0.0), 1.0, 31) == 31.0
    assert ADAPTIVE.next_period(4.0, agreed(1.0), 1.0, 1000) == 3.0
    assert ADAPTIVE.next_period(80.0, agreed(0.0), 1.0, 0) == 1.0
    assert ADAPTIVE.next_period(80.0, Agreement(False, 2.0, 1.0), 1.0, 1000) == 3.0
    assert ADAPTIVE.next_period(80.0, Agreement(False, 2.0, 1.0), 1.0, 2) == 2.0
    half = CheckSchedule(PeriodRule.ADAPTIVE, reach_share=0.5)
    assert half.next_period(80.0, agreed(0.0), 1.0, 31) == 15.5


@given(st.floats(1.0, 100.0), differences, st.booleans(), st.integers(0, 200))
def test_never_beyond_reach(last: float, difference: float, agrees: bool, steps: int) -> None:
    period = ADAPTIVE.next_period(last, Agreement(agrees, difference, 0.0), 1.0, steps)
    assert 1.0 <= period <= max(1.0, min(steps, 100.0))


@given(st.floats(1.0, 100.0), differences, differences, st.integers(0, 200), st.integers(0, 200))
def test_better_is_longer(last: float, one: float, other: float, near: int, far: int) -> None:
    (one, other), (near, far) = sorted((one, other)), sorted((near, far))
    best = ADAPTIVE.next_period(last, agreed(one), 1.0, far)
    assert best >= ADAPTIVE.next_period(last, agreed(other), 1.0, far)
    assert best >= ADAPTIVE.next_period(last, agreed(one), 1.0, near)
    assert best >= ADAPTIVE.next_period(last, Agreement(False, one, 0.0), 1.0, far)


def test_limit_of_zero() -> None:
    assert ADAPTIVE.next_period(20.0, agreed(0.0), 0.0, 1000) == 10.0


def test_what_no_schedule_is() -> None:
    for wrong in ({"check_period": 0}, {"shortest": 0}, {"shortest": 9, "longest": 8}):
        with pytest.raises(InputError, match="check_period >= 1 and 1 <= shortest <= longest"):
            CheckSchedule(PeriodRule.FIXED, **wrong)
    for share in (0.0, 1.1):
        with pytest.raises(InputError, match="reach_share"):
            CheckSchedule(reach_share=share)
    with pytest.raises(InputError, match="fixed, adaptive"):
        CheckSchedule("never")  # type: ignore[arg-type]
