"""Figures as the cells of tables show them."""

from __future__ import annotations

DASH = "–"
"""Stands in a table for a figure that there is not."""


def number_text(value: float | None, form: str, scale: float = 1.0) -> str:
    """Formats a figure times a scale; None gives a dash."""
    return DASH if value is None else format(scale * value, form)
