"""Learning from flights, and judging what was learned.

What is exported is imported when it is first asked for: torch is needed for training alone.
"""

import importlib
import typing

if typing.TYPE_CHECKING:
    from proxops.training.normalisation import Normalisation, Scale
    from proxops.training.packed_flights import PackedFlight, PackedFlights
    from proxops.training.packing import pack_flights
    from proxops.training.transit_split import part_of_transit
    from proxops.training.windows import WindowDataset, window_loader

_HOMES = {
    "Normalisation": "normalisation",
    "PackedFlight": "packed_flights",
    "PackedFlights": "packed_flights",
    "Scale": "normalisation",
    "WindowDataset": "windows",
    "pack_flights": "packing",
    "part_of_transit": "transit_split",
    "window_loader": "windows",
}

__all__ = [
    "Normalisation",
    "PackedFlight",
    "PackedFlights",
    "Scale",
    "WindowDataset",
    "pack_flights",
    "part_of_transit",
    "window_loader",
]


def __getattr__(name: str) -> typing.Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"proxops.training.{_HOMES[name]}"), name)
