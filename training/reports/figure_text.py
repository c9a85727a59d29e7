"""Figures as the cells of tables show them."""

from __future__ import annotations

from collections.abc import Sequence

DASH = "–"
"""Stands in a table for a figure that there is not."""
SMALL_COMMAND = 0.2 / 7.0
"""A command below this share of the thrust limit counts as none: 0.2 N at Kleopatra."""


def number_text(value: float | None, form: str, scale: float = 1.0) -> str:
    """Formats a figure times a scale; None gives a dash."""
    return DASH if value is None else format(scale * value, form)


def interval_text(interval: Sequence[float], between: str = "–") -> str:
    """Formats an interval of a probability in per cent, such as "98.2–100.0 %".

    An end that is below 1 is never shown as 100, nor one above 0 as 0.
    """
    return f"{between.join(_percent(end) for end in interval)} %"


def _percent(share: float) -> str:
    text = f"{100.0 * share:.1f}"
    if share < 1.0 and text == "100.0":
        return "under 100"
    return "over 0" if share > 0.0 and text == "0.0" else text
