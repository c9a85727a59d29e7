"""What flights are flown with: the version, the body, and the files of controller and world."""

from __future__ import annotations

import dataclasses as dc
import functools
import hashlib
import os
import subprocess
from collections.abc import Mapping, Sequence
from importlib import metadata
from pathlib import Path

from proxops.diagrams.flight.named_controllers import bundle_of, controller_files
from proxops.diagrams.scenario import (
    Body,
    BodyConfig,
    LearnedLidarConfig,
    LidarNavigationConfig,
    Scenario,
)
from proxops.diagrams.yaml_files import dump_typed, is_yaml_path
from proxops.systems.common import file_sha256, processor
from proxops.systems.lidar import LidarBundle
from proxops.systems.navigation import map_files
from proxops.systems.policy import load_policy


@dc.dataclass(frozen=True)
class Provenance:
    """What flights are flown with: beside scenario and controller, all that they depend on."""

    version: str
    """The version of proxops."""
    body: str
    """The body's hash, as `body_sha256` gives it."""
    files: Mapping[str, Sequence[str]] = dc.field(default_factory=dict)
    """The hashes of the files that flights use, by what they are: `true mesh`, `map`, `lidar`,
    `dispersions`, `policy` and `controller`."""

    @classmethod
    def of(cls, body: Body) -> Provenance:
        """Gives version and body, which all flights and plans have."""
        return cls(own_version(), body_sha256(body))

    def __str__(self) -> str:
        files = (f"{kind} {' '.join(hashes)}" for kind, hashes in self.files.items())
        return ", ".join([f"proxops {self.version}", f"body {self.body}", *files])


def provenance(scenario: Scenario, body: Body, controller: str) -> Provenance:
    """Gives the provenance of flights of a scenario by a controller and this version.

    Raises:
      InputError: a bundle, a module or a file that the flights need does not exist.
    """
    files: dict[str, Sequence[str]] = {}
    if scenario.truth.mesh is not None:
        files["true mesh"] = [file_sha256(Path(scenario.truth.mesh))]
    if isinstance(scenario.navigation, LidarNavigationConfig) and scenario.navigation.map:
        files["map"] = [*map(file_sha256, map_files(Path(scenario.navigation.map)))]
    if isinstance(scenario.lidar, LearnedLidarConfig):
        files["lidar"] = [LidarBundle.load(scenario.lidar.bundle).sha256]
    bounds = None if scenario.assurance is None else scenario.assurance.bounds
    drawn = [each for each in (scenario.dispersions, bounds) if isinstance(each, str)]
    files["dispersions"] = [file_sha256(Path(each)) for each in drawn if is_yaml_path(each)]
    bundle = bundle_of(controller, scenario)
    if bundle is not None:
        files["policy"] = [load_policy(bundle).sha256]
    files["controller"] = [*map(file_sha256, controller_files(controller))]
    used = {kind: hashes for kind, hashes in files.items() if hashes}
    return dc.replace(Provenance.of(body), files=used)


def body_sha256(body: Body) -> str:
    """Gives the SHA-256 hash of a body's constants and shape."""
    constants = dump_typed(body.config, BodyConfig())
    return hashlib.sha256((constants + body.shape.sha256).encode()).hexdigest()


def own_version() -> str:
    """Gives the version of proxops in this process."""
    return metadata.version("proxops")


@functools.cache
def made_with() -> dict[str, str]:
    """Gives the version and machine of this process, and the commit where it runs from a clone."""
    machine = f"{processor()}, {os.cpu_count()} cores"
    commit = _commit()
    return {"version": own_version(), **({"commit": commit} if commit else {}), "machine": machine}


def _commit() -> str:
    """The commit of this file, with "-dirty" after changes; "" where git does not know the file."""
    file = Path(__file__).resolve()
    git = ["git", "-C", str(file.parent)]
    known = [*git, "ls-files", "--error-unmatch", file.name]
    named = [*git, "describe", "--always", "--dirty", "--exclude=*"]
    try:
        subprocess.run(known, capture_output=True, check=True)
        return subprocess.run(named, capture_output=True, check=True, text=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return ""
