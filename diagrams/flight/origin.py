"""What flights were flown with: the version, the body, and the files of controller and world."""

from __future__ import annotations

import hashlib
from importlib import metadata
from pathlib import Path

from proxops.diagrams.flight.named_bundles import bundle_of, policy_sha256
from proxops.diagrams.flight.named_controllers import controller_files
from proxops.diagrams.scenario import (
    Body,
    LearnedLidarConfig,
    LidarNavigationConfig,
    Scenario,
    dump_typed,
    is_yaml_path,
)
from proxops.systems.common import file_sha256
from proxops.systems.lidar import LidarBundle
from proxops.systems.navigation import map_files

# How each part of a provenance begins.
_PARTS = ("proxops", "body", "true mesh", "map", "lidar", "dispersions", "policy", "controller")


def body_sha256(body: Body) -> str:
    """Gives the SHA-256 hash of a body's constants and shape."""
    constants = dump_typed(body.config)
    return hashlib.sha256((constants + body.shape.sha256).encode()).hexdigest()


def version_and_body(body: Body) -> str:
    """Gives the part of a provenance that all flights and plans have: version and body."""
    return f"{own_version()}, body {body_sha256(body)}"


def own_version() -> str:
    """Gives the version of proxops in this process."""
    return f"proxops {metadata.version('proxops')}"


def provenance(scenario: Scenario, body: Body, controller: str) -> str:
    """Gives the `Flight.provenance` of flights of a scenario by a controller and this version.

    Raises:
      InputError: a bundle, a module or a file that the flights need does not exist.
    """
    return version_and_body(body) + named_files(scenario, controller)


def differing_parts(one: str, other: str) -> list[str]:
    """Names the parts in which two provenances differ."""

    def named(name: str, text: str) -> list[str]:
        return [part for part in text.split(", ") if part.startswith(f"{name} ")]

    return [name for name in _PARTS if named(name, one) != named(name, other)]


def named_files(scenario: Scenario, controller: str) -> str:
    """Gives the part of a provenance that names files by their hashes; "" if there are none.

    Raises:
      InputError: as `provenance`.
    """
    origin = ""
    if scenario.truth.mesh is not None:
        origin += f", true mesh {file_sha256(Path(scenario.truth.mesh))}"
    if isinstance(scenario.navigation, LidarNavigationConfig) and scenario.navigation.map:
        for path in map_files(Path(scenario.navigation.map)):
            origin += f", map {file_sha256(path)}"
    if isinstance(scenario.lidar, LearnedLidarConfig):
        origin += f", lidar {LidarBundle.load(scenario.lidar.bundle).sha256}"
    bounds = None if scenario.assurance is None else scenario.assurance.bounds
    for named in (scenario.dispersions, bounds):
        if isinstance(named, str) and is_yaml_path(named):
            origin += f", dispersions {file_sha256(Path(named))}"
    bundle = bundle_of(controller, scenario)
    if bundle is not None:
        origin += f", policy {policy_sha256(bundle)}"
    for number, path in enumerate(controller_files(controller)):
        origin += f"{'' if number else ', controller'} {file_sha256(path)}"
    return origin
