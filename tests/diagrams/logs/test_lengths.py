"""Lengths and speeds in tables, against Python's own rounding to three digits."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from proxops.diagrams.logs import length_text, three_digits


@pytest.mark.parametrize(
    ("metres", "text"),
    [
        (6.371, "6.37 m"),
        (0.0392, "0.0392 m"),
        (0.04, "0.0400 m"),
        (999.0, "999 m"),
        (999.6, "1.00 km"),
        (1e3, "1.00 km"),
        (-12.5, "-12.5 m"),
        (-2345.6, "-2.35 km"),
        (123456.0, "123 km"),
        (4321987.0, "4322 km"),
        (0.0, "0 m"),
    ],
)
def test_lengths_are_in_metres_below_a_kilometre(metres: float, text: str) -> None:
    assert length_text(metres) == text


@given(st.floats(-1e9, 1e9))
def test_three_digits_are_kept(value: float) -> None:
    text = three_digits(value)
    whole = abs(value) >= 999.5
    assert float(text) == (round(value) if whole else float(f"{value:.2e}"))
    if abs(value) >= 1e-4:
        assert "e" not in text
        digits = text.lstrip("-0.").replace(".", "")
        assert len(digits) == 3 or whole
