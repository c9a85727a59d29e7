"""Every value of a scenario and of a body, set to what no flight can have: refused, or flown."""

import dataclasses as dc
import functools
import itertools
import math
import typing
from collections.abc import Iterator
from pathlib import Path

import pytest
from short_flights import kleopatra

from proxops.diagrams.flight.simulation import fly
from proxops.diagrams.scenario.body import BodyConfig, load_body
from proxops.diagrams.scenario.scenario import (
    dump_changes,
    dump_scenario,
    load_scenario,
    parse_scenario,
)
from proxops.diagrams.scenario.scenario_config import Scenario
from proxops.systems.common import InputError, limits_of
from proxops.systems.lidar import LearnedLidarConfig

VALUES: tuple[typing.Any, ...] = (
    math.nan, math.inf, 0, -1, 1e300, 1e-300, 10**22, 10**400,
    "text", "", "\0", True, None, [], [1.0, 2.0], {"a": 1},
)  # fmt: skip
# Optional parts are there, so that their values are tried too.
PARTS = {"assurance": {}, "disturbance": {}, "force_noise": {}, "kicks": {}, "sunlight": {}}
# Three control steps.
THREE_STEPS = {"arrival.deadline_s": 20.0, "arrival.dwell_s": 10.0, "log_ranges": True}


def fields(config: type, key: str = "") -> Iterator[tuple[str, dc.Field]]:
    """Every field of a dataclass and of those in it, with its key."""
    for field in dc.fields(config):
        path = f"{key}.{field.name}" if key else field.name
        options = [field.type, *typing.get_args(field.type)]
        nested = [option for option in options if dc.is_dataclass(option)]
        if nested:
            yield from fields(typing.cast(type, nested[0]), path)
        else:
            yield path, field


FIELDS = dict(fields(Scenario))


def settings(key: str, value: typing.Any) -> dict[str, typing.Any]:
    part = key.partition(".")[0]
    present = {name: content for name, content in PARTS.items() if name == part}
    return {**THREE_STEPS, **present, key: value}


def plain(error: InputError) -> None:
    assert str(error)
    assert "\n" not in str(error)
    assert "Traceback" not in str(error)


def loaded(changes: dict[str, typing.Any]) -> Scenario | None:
    """The scenario, or None where it is refused; in one plain line."""
    try:
        return load_scenario(None, changes)
    except InputError as error:
        plain(error)
        return None


def is_read(changes: dict[str, typing.Any]) -> bool:
    """Whether it is not refused. It is written and read again as it is."""
    scenario = loaded(changes)
    for dump in (dump_scenario, dump_changes):
        assert scenario is None or parse_scenario(dump(scenario)) == scenario
    return scenario is not None


@pytest.mark.parametrize("key", FIELDS)
def test_values_are_refused_or_read(key: str) -> None:
    read = [value for value in VALUES if is_read(settings(key, value))]
    limits = limits_of(FIELDS[key])
    if FIELDS[key].type in (int, float):
        assert limits is not None, "a number has limits"
        assert all(limits[0] <= value <= limits[1] for value in read)


@pytest.mark.parametrize("field", [field.name for field in dc.fields(LearnedLidarConfig)])
def test_values_of_a_learned_lidar_are_refused_or_read(field: str) -> None:
    for value in VALUES:
        is_read({"lidar": {"_tag": "!LearnedLidar", "bundle": "folder", field: value}})


def flown_values(key: str) -> list[typing.Any]:
    """What is tried of a key in flight: four that are read, its limits first."""
    limits = limits_of(FIELDS[key]) or ()
    whole = FIELDS[key].type is int
    ends = [int(end) if whole else end for end in limits if math.isfinite(end)]
    read = (value for value in (*ends, *VALUES) if loaded(settings(key, value)) is not None)
    return [*itertools.islice(read, 4)]


def fly_or_refuse(key: str, value: typing.Any) -> None:
    changes = settings(key, value)
    if key == "control_period_s":
        changes |= {"arrival.deadline_s": 2.0 * value, "arrival.dwell_s": value}
    elif key.startswith("arrival.") and isinstance(value, int | float):
        # The flight stays short: the control period grows with it.
        changes["control_period_s"] = max(10.0, min(3600.0, value))
    scenario = loaded(changes)
    if scenario is None:
        return
    try:
        log = fly(scenario, "zero", body=kleopatra() if key != "body" else None)
        assert log.summary["steps"] >= 1
    except InputError as error:
        plain(error)


# A few at every run, the others with the slow tests.
OFTEN = ("spacecraft.mass_kg", "truth.gravity", "lidar.max_range_m", "transit.start_m")


@pytest.mark.parametrize(
    "key", [pytest.param(key, marks=() if key in OFTEN else pytest.mark.slow) for key in FIELDS]
)
def test_what_is_read_flies(key: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a traceback, and without a warning, which would be an error here."""
    # Many values leave no transit to be found.
    monkeypatch.setattr("proxops.diagrams.scenario.transits._ATTEMPTS", 1000)
    for value in flown_values(key):
        fly_or_refuse(key, value)


# --- bodies ---------------------------------------------------------------------------------------


@functools.cache
def rock() -> dict[str, typing.Any]:
    return {
        "name": "Rock", "mesh": "rock.obj", "mesh_unit": "m", "mass_kg": 1e9,
        "rotation_period_h": 4.0, "keep_out_semi_axes_m": [160.0, 160.0, 160.0],
    }  # fmt: skip


@pytest.mark.parametrize("key", [field.name for field in dc.fields(BodyConfig)])
def test_values_of_a_body_are_refused_or_read(key: str, tmp_path: Path) -> None:
    import trimesh
    import yaml

    trimesh.creation.icosphere(1, 60.0).export(tmp_path / "rock.obj")
    limits = limits_of({field.name: field for field in dc.fields(BodyConfig)}[key]) or ()
    axes = [[value] * 3 for value in (math.nan, math.inf, 0, -1, 1e300, 1e-300, 1e22)]
    for value in (*VALUES, *limits, *axes):
        path = tmp_path / "rock.yaml"
        path.write_text(yaml.safe_dump({**rock(), key: value}))
        try:
            body = load_body(str(path))
        except InputError as error:
            plain(error)
            continue
        try:
            near = {"transit.start_m": [300.0, 0.0, 0.0], "transit.goal_m": [300.0, 50.0, 0.0]}
            fly(load_scenario(None, {**THREE_STEPS, **near, "body": str(path)}), "zero", body=body)
        except InputError as error:
            plain(error)
