"""Figures of speed that are kept from version to version, in `benchmarks/results.json`.

`make bench` names the file in the environment; without it nothing is kept. The file holds one entry
for each version, machine and set of packages, oldest first: `version`, `machine`, `packages` and
`figures`.
"""

import json
import os
from collections.abc import Mapping
from importlib import metadata
from pathlib import Path

from proxops.systems.common import processor, write_json

FILE = "PROXOPS_BENCH_RESULTS"
PACKAGES = ("drake", "numpy", "numba", "torch", "polyhedral-gravity", "bsk", "casadi", "embreex")


def keep(figures: Mapping[str, float]) -> None:
    """Adds figures to the entry of this version on this machine; those of the same name go."""
    if FILE not in os.environ:
        return
    path = Path(os.environ[FILE])
    entries = json.loads(path.read_text()) if path.exists() else []
    version, machine = metadata.version("proxops"), f"{processor()}, {os.cpu_count()} cores"
    packages = {name: found for name in PACKAGES if (found := installed(name))}
    flown_by = {"version": version, "machine": machine, "packages": packages}
    for entry in entries:
        if all(entry[key] == value for key, value in flown_by.items()):
            break
    else:
        entry = {**flown_by, "figures": {}}
        entries.append(entry)
    entry["figures"] |= {name: float(f"{value:.3g}") for name, value in figures.items()}
    write_json(path, entries, indent=1)


def installed(name: str) -> str | None:
    """The version of an installed distribution; None: it is not installed."""
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None
