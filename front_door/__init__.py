"""Fly a spacecraft around an asteroid with a lidar, in Drake.

    import proxops

    log = proxops.fly(proxops.load_scenario(transit=1), "mpc")
    results = proxops.evaluate(["mpc", "policy"], transits=10, folder=Path("out/evaluation"))

These names are imported when they are used. `proxops.systems` has the blocks, `proxops.diagrams`
scenarios, flights, logs and plots, `proxops.training` policies and `proxops.studies` campaigns.
"""

from __future__ import annotations

import importlib
import typing

if typing.TYPE_CHECKING:
    from proxops.diagrams.flight import fly, fly_many
    from proxops.diagrams.scenario import load_body, load_scenario
    from proxops.studies.campaigns import evaluate

    __version__: str

__all__ = ["__version__", "evaluate", "fly", "fly_many", "load_body", "load_scenario"]

_PLACES = {
    "evaluate": "proxops.studies.campaigns",
    "fly": "proxops.diagrams.flight",
    "fly_many": "proxops.diagrams.flight",
    "load_body": "proxops.diagrams.scenario",
    "load_scenario": "proxops.diagrams.scenario",
}


def __getattr__(name: str) -> typing.Any:
    if name == "__version__":
        from importlib import metadata

        value = metadata.version("proxops")
    elif name in _PLACES:
        value = getattr(importlib.import_module(_PLACES[name]), name)
    else:
        raise AttributeError(f"module 'proxops' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
