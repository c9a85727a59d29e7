"""`Track`: transits and worlds that are written down, so that no later version draws others."""

from __future__ import annotations

import dataclasses as dc
import hashlib
import json
import typing
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from proxops import assets
from proxops.diagrams.flight import Flight, body_sha256, controller_label, provenance
from proxops.diagrams.scenario import (
    Scenario,
    SurveyConfig,
    World,
    change_scenario,
    dispersed_values,
    dotted_leaves,
    draw_world,
    dump_scenario,
    load_body,
    of_transit,
    parse_scenario,
    with_ends,
)
from proxops.diagrams.surveys import known_ellipsoid
from proxops.diagrams.yaml_files import parse_mapping
from proxops.studies.campaigns import makes_a_map
from proxops.systems.common import InputError, write_whole

TRACKS = {
    "state": "269914ef78ad88ebcd9d2f906623506242cb5564527976dc3a4a36921ece9e35",
    "lidar": "7751fd493a54c651e4340df68bedcf2e8162b124407db26d1baa8bfe58edffd5",
    "lidar-after-survey": "729d24d3b02bed96a29b7f32fd81e17887357875a7e6523913ac68b2a32a4f85",
    "survey": "345053fab63a6c7cc9dde1625f2b2437c062dfaa353dc80ae730b31978c3001c",
    "touch": "41ad3bb6f14a4158730fef912e10d09b11ee597b1078074b9c30e26013b45748",
    "mission": "de8e4c779ab87c43d9045318c5adea4036c93cef809f3a652ecc3e8988dd8f4d",
}
"""The tracks that ship, and the SHA-256 of each."""
ON_BOARD = ("mpc", "policy", "hybrid")
"""Parts of the scenario that belong to the spacecraft's software: who is scored may change them."""

_SHIPPED = Path(assets.__file__).parent / "tracks"


@dc.dataclass(frozen=True)
class Track:
    """Transits that are the same for ever, each in its world."""

    name: str
    scenario: str
    """YAML of the whole scenario of the first transit."""
    body_sha256: str
    """Hash of the body, as `body_sha256` gives it."""
    changes: Sequence[Mapping[str, typing.Any]]
    """What each transit changes in the scenario: values by dotted keys."""
    expert_delta_v_m_s: Sequence[float | None]
    """Δv in m/s of the MPC in each transit, which `with_expert` tells; None: it did not succeed.
    Empty: it was not flown. Of surveys, that with the estimator that ships."""
    drawn: Sequence[Mapping[str, typing.Any]] = ()
    """What dispersions draw, of surveys and missions, which are told these: values by dotted keys.
    Empty: the changes hold it, and nothing is drawn."""

    @property
    def sha256(self) -> str:
        """Hash of all of the track."""
        return hashlib.sha256(_text(self).encode()).hexdigest()

    def flights(self, controller: str, settings: Sequence[str] = ()) -> list[Flight]:
        """Gives the flights of the track by a controller.

        Args:
          controller: as `named_controller` takes it.
          settings: texts `key=value` that change the spacecraft's own software.

        Raises:
          InputError: a setting is of something else; the body is not that of the track; this
            version draws other worlds; or see `change_scenario` and `provenance`.
        """
        for setting in settings:
            part = setting.partition("=")[0].partition(".")[0]
            if part not in ON_BOARD:
                raise InputError(
                    f"--set {setting}: a track is flown as it is; only what is on board may be "
                    f"changed: {', '.join(ON_BOARD)}"
                )
        first = change_scenario(parse_scenario(self.scenario), settings)
        body = load_body(first.body)
        if body_sha256(body) != self.body_sha256:
            raise InputError(
                f"track {self.name}: the body {first.body} is not the one of the track"
            )
        origin = provenance(first, body, controller)
        stem = controller_label(controller)
        flights = [
            Flight(
                f"{stem}-{number:05d}",
                change_scenario(first, change),
                controller,
                origin,
            )
            for number, change in enumerate(self.changes)
        ]
        for flight, told in zip(flights, self.drawn, strict=False):
            if not _are_alike(dispersed_values(draw_world(flight.scenario, body)), told):
                raise InputError(
                    f"track {self.name}: this version of proxops draws other worlds than the one "
                    "that made the track"
                )
        return flights


def draw_track(name: str, scenario: Scenario, seed: int, count: int) -> Track:
    """Draws transits 0 … count - 1 of a seed, and their worlds, to be written down."""
    body = load_body(scenario.body)
    worlds, drawn = [], []
    for index in range(count):
        one = of_transit(scenario, seed, index)
        if isinstance(one.task, SurveyConfig):
            axes = known_ellipsoid(one, body).tolist()
            one = dc.replace(one, task=dc.replace(one.task, semi_axes_m=axes))
        if makes_a_map(scenario):
            drawn.append(dispersed_values(draw_world(one, body)))
        else:
            world = World.of(one, body)
            one = with_ends(world.scenario, world.transit.start, world.transit.goal)
        worlds.append(dump_scenario(one))
    first, *_ = trees = [dict(dotted_leaves(parse_mapping(world, name))) for world in worlds]
    changes = [{key: tree[key] for key in tree if tree[key] != first[key]} for tree in trees]
    return Track(name, worlds[0], body_sha256(body), changes, [], drawn or ())


def load_track(name: str) -> Track:
    """Reads a track: one of `TRACKS` by its name, or a file that `save_track` wrote.

    Raises:
      InputError: there is no such track; its file cannot be read; or a track that ships is not what
        it was.
    """
    path = _SHIPPED / f"{name}.json" if name in TRACKS else Path(name)
    if not path.is_file():
        raise InputError(
            f"no track {name!r}: name one of {', '.join(TRACKS)}, or a track's JSON file"
        )
    try:
        track = Track(**json.loads(path.read_text(encoding="utf-8")))
    except (TypeError, ValueError) as error:
        raise InputError(f"{path} is not a track: {error}") from error
    changes, taken = track.changes, track.expert_delta_v_m_s
    whole = isinstance(track.scenario, str) and isinstance(changes, list) and changes
    whole = whole and all(isinstance(each, dict) for each in changes) and isinstance(taken, list)
    whole = whole and all(len(each) in (0, len(changes)) for each in (taken, track.drawn))
    if not whole or any(not isinstance(each, int | float | None) for each in taken):
        raise InputError(
            f"{path} is not a track: it needs a scenario's text, a list of changes, and as many Δv "
            "of the MPC in m/s or none"
        )
    if name in TRACKS and track.sha256 != TRACKS[name]:
        raise InputError(
            f"{path} is not the track {name!r} any more: its hash is {track.sha256}, not "
            f"{TRACKS[name]}; install proxops again"
        )
    return track


def _are_alike(found: Mapping[str, typing.Any], told: Mapping[str, typing.Any]) -> bool:
    """Whether two worlds are the same but for last bits, in which processors differ."""
    return found.keys() == told.keys() and all(
        np.allclose(found[key], told[key], rtol=1e-9, atol=0.0) for key in told
    )


def save_track(track: Track, path: Path) -> None:
    """Writes a track as a JSON file."""
    write_whole(path, lambda name: name.write_text(_text(track), encoding="utf-8"))


def _text(track: Track) -> str:
    """The JSON of a track, with one line for each transit; its hash is that of this text."""
    parts = {key: json.dumps(value) for key, value in dc.asdict(track).items()}
    parts["changes"] = "[\n" + ",\n".join(map(json.dumps, track.changes)) + "\n]"
    if not track.drawn:
        del parts["drawn"]
    return "{\n" + ",\n".join(f"{json.dumps(k)}: {text}" for k, text in parts.items()) + "\n}\n"
