"""Scenario and body files: what is read, what is written back, and what is refused and how."""

import dataclasses as dc
import operator
from pathlib import Path

import numpy as np
import pytest
from plain_polyhedral_gravity import star_shaped

from proxops.diagrams.scenario.body import load_body
from proxops.diagrams.scenario.scenario import (
    change_scenario,
    dump_scenario,
    load_scenario,
    parse_scenario,
)
from proxops.diagrams.scenario.scenario_config import Scenario, TransitConfig
from proxops.systems.common.errors import InputError
from proxops.systems.vehicle import PointMassConfig, RandomWalkDisturbanceConfig


def write(folder: Path, text: str | bytes, name: str = "scenario.yaml") -> Path:
    path = folder / name
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


# --- what is read ---------------------------------------------------------------------------------


# A path by each key that takes one, and whether the key takes names as well.
PATHS = {
    "body": ("rock.yaml", True),
    "policy.bundle": ("bundle", False),
    "truth.mesh": ("true.obj", False),
    "navigation.map": ("map.obj", False),
    "dispersions": ("mine.yaml", True),
    "assurance.bounds": ("bounds.yaml", True),
}


def at(scenario: Scenario, key: str) -> object:
    return operator.attrgetter(key)(scenario)


@pytest.mark.parametrize("key", PATHS)
def test_relative_paths_become_absolute(
    key: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those of a file from its folder, all others from the working directory."""
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    name, may_be_a_name = PATHS[key]
    here, above = str(tmp_path / "here" / name), str(tmp_path / name)
    assert at(load_scenario(None, {key: f"../{name}"}), key) == above
    changed = change_scenario(load_scenario(), {key: name})
    assert at(changed, key) == here
    assert at(change_scenario(changed, {"noise_seed": 3}), key) == here
    section, dot, last = key.partition(".")
    line = f"{section}: {{{last}: {name}}}" if dot else f"{section}: {name}"
    assert at(load_scenario(write(tmp_path, line)), key) == above
    if may_be_a_name:
        assert at(load_scenario(None, {key: "kleopatra"}), key) == "kleopatra"


@pytest.mark.parametrize(
    "overrides",
    [
        ["spacecraft.mass_kg=250", "disturbance.reset_period_s=50", "transit.index=7"],
        {"spacecraft.mass_kg": 250, "disturbance.reset_period_s": 50.0, "transit.index": 7},
        {
            "spacecraft.mass_kg": np.float64(250),
            "disturbance.reset_period_s": np.float32(50),
            "transit.index": np.int64(7),
        },
    ],
)
def test_overrides(tmp_path: Path, overrides) -> None:
    path = write(tmp_path, "spacecraft: {thrust_limit_n: 3}\ndisturbance: null\ntransit: {seed: 4}")
    expected = Scenario(disturbance=RandomWalkDisturbanceConfig(reset_period_s=50.0))
    expected.spacecraft = PointMassConfig(mass_kg=250.0, thrust_limit_n=3.0)
    expected.transit = TransitConfig(seed=4, index=7)
    assert load_scenario(path, overrides) == expected


# --- what is refused ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        ("# only a comment\n", "is empty"),
        ("- a\n- b\n", "holds a list"),
        ("x: !!python/object/apply:os.getcwd []", "is not YAML"),
        ("mesh: rock.obj", "is a body's file: in a scenario, write body: "),
        (bytes(range(256)), "is not a text file"),
    ],
)
def test_files_that_hold_no_scenario(tmp_path: Path, content: str | bytes, complaint: str) -> None:
    with pytest.raises(InputError, match=rf"scenario\.yaml.*{complaint}"):
        load_scenario(write(tmp_path, content))


def test_directory_and_missing_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is a directory"):
        load_scenario(tmp_path)
    with pytest.raises(InputError, match="cannot be read"):
        load_scenario(tmp_path / "absent.yaml")


@pytest.mark.parametrize(
    ("overrides", "complaint"),
    [
        ("spacecraft.mass_kg=heavy", "spacecraft.mass_kg needs a number, got 'heavy'"),
        ("spacecraft.mass_kg=true", "spacecraft.mass_kg needs a number, got True"),
        ("spacecraft=3", "spacecraft needs `key: value` lines, or one of .*, got 3"),
        ("disturbance=!Earthquake {}", "disturbance cannot be !Earthquake"),
        ("mpc.intervals=3.5", "mpc.intervals needs a whole number, got 3.5"),
        ("body=3", "body needs a text, got 3"),
        ("transit.start_m=[1, 2, x]", "transit.start_m needs a list, each a number"),
        ("noise_seed", r"not of the form key\.subkey=value"),
        (" = 3", r"not of the form key\.subkey=value"),
        ({"policy.bundle": ""}, r"policy\.bundle must name .*, or be null"),
        ({"assurance.bounds": ""}, r"assurance\.bounds must name .*, or be null"),
        ("noise_seed=-1", "noise_seed must not be negative"),
        ("mpc.intervals=1", "mpc.intervals must be at least 2"),
        # Values that do not fit each other.
        ("transit.min_distance_m=2e5", "transit.min_distance_m must be below"),
        ("transit.start_m=[1, 2, 3]", "transit needs both start_m and goal_m, or neither"),
        (["transit.start_m=[1, 2, .nan]", "transit.goal_m=[1, 2, 3]"], "start_m must be three"),
        ("kicks.mean_interval_s=5", "kicks.mean_interval_s must be at least control_period_s"),
        ("transit.start_velocity_m_s=[1, 2, 41]", "within spacecraft.speed_limit_m_s"),
        (["mpc.estimator_gain=0.1", "assurance={}"], "leave out assurance or the estimator"),
    ],
)
def test_values_refused(overrides, complaint: str) -> None:
    with pytest.raises(InputError, match=complaint):
        load_scenario(None, overrides)


@pytest.mark.parametrize(
    ("key", "nearest"),
    [
        ("control_period", "control_period_s"),
        ("spacecraft.mass", "mass_kg"),
        ("spacecraft.", "mass_kg|thrust_limit_n|speed_limit_m_s"),
        ("mass_kg", "spacecraft.mass_kg"),
        ("seed", "transit.seed"),
    ],
)
def test_unknown_key_gives_the_nearest(tmp_path: Path, key: str, nearest: str) -> None:
    *section, last = key.split(".")
    expected = f"{''.join(section)}.*no key '{last}' in .*nearest is '({nearest})'"
    with pytest.raises(InputError, match=expected):
        load_scenario(None, [f"{key}=3"])
    text = f"{section[0]}: {{'{last}': 3}}" if section else f"{last}: 3"
    with pytest.raises(InputError, match=r"scenario\.yaml: " + expected):
        load_scenario(write(tmp_path, text))


# --- bodies ---------------------------------------------------------------------------------------

ROCK = {
    "name": "Rock",
    "mesh": "rock.obj",
    "mesh_unit": "m",
    "mass_kg": 1e9,
    "rotation_period_h": 4.0,
    "keep_out_semi_axes_m": [160.0, 160.0, 160.0],
}


@pytest.fixture
def rock(tmp_path: Path):
    """Writes a body of about 100 m, away from its mesh's origin, with some keys changed."""
    mesh = star_shaped(0, subdivisions=1, size=60.0)
    mesh.apply_translation([500.0, -300.0, 20.0])
    mesh.export(tmp_path / "rock.obj")

    def write_rock(drop: str = "", **changes: object) -> str:
        tree = {key: value for key, value in (ROCK | changes).items() if key != drop}
        lines = "".join(f"{key}: {value}\n" for key, value in tree.items())
        return str(write(tmp_path, lines, "rock.yaml"))

    return write_rock


def test_kleopatra() -> None:
    body = load_body("kleopatra")
    assert body.config.name == "Kleopatra"
    assert body.spin_rate == pytest.approx(2 * np.pi / (5.38528 * 3600))
    np.testing.assert_array_equal(body.keep_out_semi_axes, [140e3, 70e3, 65e3])
    np.testing.assert_allclose(body.shape.centre_of_mass, 0.0, atol=1e-6)
    assert body.gravity_field.mass == pytest.approx(body.config.mass_kg, rel=1e-14)


@pytest.mark.parametrize("name", ["itokawa", "", "..", "a\nb"])
def test_unknown_body(name: str) -> None:
    with pytest.raises(InputError, match=r"does not ship with proxops \(bennu, .*toutatis do\)"):
        load_body(name)


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"mas_kg": 3.0}, "no key 'mas_kg' in BodyConfig; the nearest is 'mass_kg'"),
        ({"mass_kg": 1e15}, "which no body has"),
        ({"rotation_period_h": -5.2}, "turn the mesh half a turn: .* --fix NEW --flip"),
        ({"name": '"Kleopatra\\nMETA_STOP"'}, "characters that can be printed"),
        ({"keep_out_semi_axes_m": [160, 160, 0]}, "must be three positive lengths"),
        ({"keep_out_semi_axes_m": [160, 160, 20]}, "sticks out of the keep-out ellipsoid"),
        ({"mesh_unit": "km"}, "is the mesh in the unit that was said"),
        ({"mesh_unit": "feet"}, "unit 'feet' is not known"),
        ({"mesh": "absent.obj"}, "absent.obj does not exist"),
        ({"mesh": "rock.yaml"}, "could not be read as a mesh"),
    ],
)
def test_body_refused(rock, changes: dict[str, object], complaint: str) -> None:
    with pytest.raises(InputError, match=complaint):
        load_body(rock(**changes))


def test_hint_of_the_ellipsoid_suffices(rock) -> None:
    """The factor in the message is the one that makes the body fit."""
    axes = np.array([80.0, 70.0, 60.0])
    with pytest.raises(InputError) as caught:
        load_body(rock(keep_out_semi_axes_m=axes.tolist()))
    factor = float(str(caught.value).split("semi-axes that are ")[1].split()[0])
    load_body(rock(keep_out_semi_axes_m=(axes * (factor + 1e-3)).tolist()))


@pytest.mark.parametrize(
    ("key", "complaint"),
    [
        ("truth.gravty", "there is no key 'truth.gravty' in a scenario; the nearest is truth.grav"),
        ("mpc.intervals", "mpc.intervals cannot be dispersed"),
    ],
)
def test_what_cannot_have_been_drawn(key: str, complaint: str, tmp_path: Path) -> None:
    text = dump_scenario(Scenario()).replace("dispersed: []", f"dispersed: [{key}]")
    for read in (parse_scenario, lambda text: load_scenario(write(tmp_path, text))):
        with pytest.raises(InputError, match=f"dispersed is what proxops writes .*: {complaint}"):
            read(text)


def test_a_misspelt_attribute_is_refused_in_python_too() -> None:
    scenario = load_scenario()
    sections = [scenario, *filter(dc.is_dataclass, vars_of(scenario))]
    assert len(sections) > 8
    for section in sections:
        with pytest.raises(AttributeError):
            setattr(section, "mas_kg", 5.0)  # noqa: B010 - pyright would refuse it, too.


def vars_of(section: Scenario) -> list[object]:
    return [getattr(section, field.name) for field in dc.fields(section)]


@pytest.mark.parametrize(
    ("craft", "limit"),
    [
        ("RigidBody", 0.5),
        ("!RigidBody {model: osiris_rex}", 0.5),
        ("!RigidBody {speed_limit_m_s: 2.0}", 2.0),
    ],
)
def test_another_spacecraft_keeps_the_speed_limit(craft: str, limit: float) -> None:
    """It is in proportion to the body."""
    changes = [f"spacecraft={craft}"]
    for made in (load_scenario("bennu", changes), change_scenario(load_scenario("bennu"), changes)):
        assert made.is_rigid
        assert made.spacecraft.speed_limit_m_s == limit
