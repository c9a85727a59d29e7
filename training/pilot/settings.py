"""The settings of a pilot's training, and the pilot's dimensions for the flights it learns from."""

from __future__ import annotations

import dataclasses as dc
from importlib import metadata
from typing import Any

from proxops.systems.common import InputError
from proxops.training.data import PackedFlights, body_length, keep_out_of
from proxops.training.loop import Schedule
from proxops.training.pilot.dimensions import PilotDimensions
from proxops.training.pilot.examples import Hits, box_of

# The surface is learned in a box this many grid spacings beyond the returns.
_BOX_MARGIN = 1.5
# The guidance's ellipsoid starts as the keep-out's, this much larger.
_KEEP_OUT_SHARE = 1.02


@dc.dataclass(frozen=True)
class PilotSettings:
    """Settings of a training by our recipe: numbers of examples, sizes, schedules."""

    frames: int = 60_000
    """Greatest number of frames from which the position is learned."""
    hits: int = 64
    """Returns of a frame that the pilot uses."""
    cells: int = 48
    """Cells of the surface's grid along the body's longest side."""
    plans: int = 24_000
    """Transits whose plans the guidance learns from, besides the flights."""
    windows: int = 1200
    """Greatest number of windows of flights that the filter learns from."""
    window: int = 40
    """Steps in a window, for the filter and for the end-to-end training."""
    width: int = 256
    """Width of the guidance's layers."""
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
        """Settings for a smaller pilot, trained in about a minute; it flies less well."""
        return dc.replace(
            self,
            frames=3000,
            cells=32,
            plans=200,
            windows=32,
            width=64,
            coarse=dc.replace(self.coarse, epochs=20, batch=64),
            geometry=dc.replace(self.geometry, batch=64),
            motion=dc.replace(self.motion, epochs=20, batch=256),
            filter=dc.replace(self.filter, epochs=6, batch=8),
            guidance=dc.replace(self.guidance, epochs=8, batch=256),
            end_to_end=dc.replace(self.end_to_end, batch=8),
        )


def origin_of(flights: PackedFlights, settings: PilotSettings) -> dict[str, Any]:
    """Says what a pilot comes from; it is kept in the pilot's file."""
    return {
        "proxops": metadata.version("proxops"),
        "logs_sha256": flights.logs_sha256,
        "settings": dc.asdict(settings),
    }


def settings_of(origin: dict[str, Any]) -> PilotSettings:
    """Reads the settings that a pilot was trained with from `origin_of` in its file.

    Raises:
      InputError: the pilot was trained by another version of proxops, or says no settings.
    """
    version = origin.get("proxops", "before 0.3")
    if version != metadata.version("proxops"):
        raise InputError(
            f"the pilot was trained by proxops {version}, and this is "
            f"{metadata.version('proxops')}: train it again"
        )
    try:
        fields = dict(origin["settings"])
        for name, value in fields.items():
            if isinstance(value, dict):
                fields[name] = Schedule(**value)
        return PilotSettings(**fields)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"the pilot does not say how it was trained: {error}") from error


def dimensions_of(flights: PackedFlights, hits: Hits, settings: PilotSettings) -> PilotDimensions:
    """The dimensions of a pilot for the lidar, spacecraft and body of the flights."""
    setting = flights.setting
    keep_out = keep_out_of(setting)
    low, high = box_of(hits)
    spacing = float((high - low).max()) / settings.cells
    low, high = low - _BOX_MARGIN * spacing, high + _BOX_MARGIN * spacing
    x, y, z = (_KEEP_OUT_SHARE * keep_out).tolist()
    return PilotDimensions(
        planes=setting.planes,
        rays=setting.rays,
        hits=min(settings.hits, setting.planes * setting.rays),
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
