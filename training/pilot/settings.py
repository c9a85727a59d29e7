"""How much of what the pilot learns, and what it has to be for the flights it learns from."""

from __future__ import annotations

import dataclasses as dc
from typing import Any

from proxops.training.data import PackedFlights, body_length, keep_out_of
from proxops.training.loop import Schedule
from proxops.training.pilot.examples import Hits, box_of
from proxops.training.pilot.shape import PilotShape

# The surface is learned in a box this many grid spacings beyond the returns.
_BOX_MARGIN = 1.5
# The guidance's ellipsoid starts as the keep-out's, this much larger.
_KEEP_OUT_SHARE = 1.02


@dc.dataclass(frozen=True)
class PilotSettings:
    """Of a training by our recipe."""

    frames: int = 60_000
    """From which position is learned, at most."""
    hits: int = 64
    """Returns of a frame that the pilot looks at."""
    cells: int = 48
    """Of the surface's grid, along the body."""
    plans: int = 24_000
    """Transits whose plans the guidance learns besides the flights."""
    windows: int = 1200
    window: int = 40
    """Stretches of flights along which the filter learns, at most, and their length in steps, that
    of the whole's too."""
    width: int = 256
    coarse: Schedule = Schedule(epochs=80, batch=512, learning_rate=3e-3, patience=80)
    geometry: Schedule = Schedule(epochs=12, batch=256, learning_rate=3e-2, patience=12)
    motion: Schedule = Schedule(epochs=50, batch=1024, learning_rate=4e-3, patience=50)
    filter: Schedule = Schedule(epochs=20, batch=64, learning_rate=1e-1, patience=20)
    guidance: Schedule = Schedule(epochs=20, batch=1024, learning_rate=2e-3, patience=20)
    end_to_end: Schedule = Schedule(epochs=2, batch=32, learning_rate=2e-4, patience=2)
    seed: int = 0
    device: str = "cpu"
    precision: str = "32-true"

    def quick(self) -> PilotSettings:
        """A smaller pilot from less of all, in about a minute; it flies, though not as well."""
        return dc.replace(
            self,
            frames=3000,
            cells=32,
            plans=200,
            windows=32,
            width=64,
            coarse=dc.replace(self.coarse, epochs=20, batch=64),
            geometry=dc.replace(self.geometry, epochs=12, batch=64),
            motion=dc.replace(self.motion, epochs=20, batch=256),
            filter=dc.replace(self.filter, epochs=6, batch=8),
            guidance=dc.replace(self.guidance, epochs=8, batch=256),
            end_to_end=dc.replace(self.end_to_end, batch=8),
        )


def settings_of(origin: dict[str, Any]) -> PilotSettings:
    """The settings that a pilot was trained with, from what its file says of its origin."""
    fields = dict(origin["settings"])
    for name, value in fields.items():
        if isinstance(value, dict):
            fields[name] = Schedule(**value)
    return PilotSettings(**fields)


def shape_of(flights: PackedFlights, hits: Hits, settings: PilotSettings) -> PilotShape:
    """What a pilot has to be for the lidar, spacecraft and body of the flights."""
    setting = flights.setting
    keep_out = keep_out_of(setting)
    low, high = box_of(hits)
    spacing = float((high - low).max()) / settings.cells
    low, high = low - _BOX_MARGIN * spacing, high + _BOX_MARGIN * spacing
    x, y, z = (_KEEP_OUT_SHARE * keep_out).tolist()
    return PilotShape(
        planes=setting.planes,
        rays=setting.rays,
        hits=settings.hits,
        period=setting.control_period_s,
        mass=setting.mass_kg,
        thrust_limit=setting.thrust_limit_n,
        length=body_length(keep_out),
        keep_out=(x, y, z),
        low=tuple(low.tolist()),
        high=tuple(high.tolist()),
        spacing=spacing,
        guidance_width=settings.width,
    )
