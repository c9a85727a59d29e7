"""Lengths and speeds as tables and reports show them, at bodies of any size."""


def three_digits(value: float) -> str:
    """Writes a number with three significant digits; of 1000 and more, all whole digits."""
    if value == 0.0:
        return "0"
    return f"{value:#.3g}".rstrip(".") if abs(value) < 999.5 else f"{value:.0f}"


def length_text(metres: float) -> str:
    """Writes a length with three digits, in m if it is below 1 km, otherwise in km."""
    near = abs(metres) < 999.5
    return f"{three_digits(metres)} m" if near else f"{three_digits(metres / 1e3)} km"
