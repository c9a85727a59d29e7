"""Figures in tables: nothing that failed once is shown as certain."""

import pytest

from proxops.training.reports import interval_text


@pytest.mark.parametrize(
    ("interval", "text"),
    [
        ((0.981725, 1.0), "98.2–100.0 %"),
        ((0.972, 0.99987), "97.2–under 100 %"),
        ((0.0, 0.0183), "0.0–1.8 %"),
        ((0.0001, 0.5), "over 0–50.0 %"),
    ],
)
def test_an_interval_is_rounded_but_never_to_certainty(
    interval: tuple[float, float], text: str
) -> None:
    assert interval_text(interval) == text
    assert interval_text(interval, " to ") == text.replace("–", " to ")
