"""Scenario and body files: what is read, what is written back, and what is refused and how."""

import dataclasses as dc
import operator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plain_polyhedral_gravity import star_shaped

from proxops.diagrams.scenario.body import BodyConfig, load_body
from proxops.diagrams.scenario.scenario import (
    change_scenario,
    dump_scenario,
    load_scenario,
    parse_scenario,
    read_mapping,
)
from proxops.diagrams.scenario.scenario_checks import check_scenario
from proxops.diagrams.scenario.scenario_config import (
    Scenario,
    TransitConfig,
    TrueStateConfig,
    TruthConfig,
)
from proxops.systems.assurance import AssuranceBounds, AssuranceConfig
from proxops.systems.common.errors import InputError
from proxops.systems.expert import MpcConfig
from proxops.systems.lidar import LearnedLidarConfig, LidarConfig
from proxops.systems.navigation import ExpectedErrors, LidarNavigationConfig
from proxops.systems.policy import PolicyConfig
from proxops.systems.vehicle import (
    ArrivalConfig,
    ForceNoiseConfig,
    KicksConfig,
    PointMassConfig,
    RandomWalkDisturbanceConfig,
    TrueThrustersConfig,
)

positive = st.floats(0.5, 1e3)
not_negative = st.floats(0.0, 1e3)
points = st.lists(st.floats(-1e9, 1e9), min_size=3, max_size=3)


@st.composite
def scenarios(draw: st.DrawFn) -> Scenario:
    ends = draw(st.none() | st.tuples(points, points))
    near, far = sorted(draw(st.lists(positive, min_size=2, max_size=2, unique=True)))
    disturbance = st.builds(RandomWalkDisturbanceConfig, positive, not_negative, not_negative)
    expected = st.builds(ExpectedErrors, attitude_deg=st.floats(0.0, 11.0), gravity=positive)
    bounds = st.builds(AssuranceBounds, surface_m=not_negative)
    bounds = st.none() | st.just("after_survey") | bounds
    assurance = draw(st.none() | st.builds(AssuranceConfig, bounds, not_negative))
    return Scenario(
        body=draw(st.text(st.characters(categories=["L", "N", "P", "Zs"]), min_size=1)),
        spacecraft=draw(st.builds(PointMassConfig, positive, positive, positive)),
        lidar=draw(
            st.builds(LidarConfig, not_negative, positive)
            | st.builds(LearnedLidarConfig, st.text(min_size=1, max_size=9).map(repr), not_negative)
        ),
        navigation=draw(
            st.builds(
                LidarNavigationConfig,
                st.none() | expected,
                frame_delay_steps=st.integers(0, 1000),
            )
            | st.builds(TrueStateConfig)
        ),
        mpc=draw(
            st.builds(
                MpcConfig,
                st.integers(2, 500),
                positive,
                positive,
                not_negative,
                positive,
                not_negative,
                st.booleans(),
                # Runtime assurance is refused with the MPC's estimator.
                st.floats(0.0, 1.0) if assurance is None else st.just(0.0),
                st.integers(1, 1000),
            )
        ),
        truth=TruthConfig(
            gravity=draw(positive),
            mass=draw(positive),
            thrusters=TrueThrustersConfig(scale=[draw(positive) for _ in range(3)]),
            specific_impulse_s=draw(st.none() | positive),
        ),
        assurance=assurance,
        disturbance=draw(st.none() | disturbance),
        transit=TransitConfig(
            seed=draw(st.integers(0, 2**63 - 1)),
            index=draw(st.integers(0, 10**9)),
            start_m=ends and ends[0],
            goal_m=ends and ends[1],
            cube_m=draw(positive),
            min_distance_m=near,
            max_distance_m=far,
            end_clearance_m=draw(not_negative),
            max_hover_share=draw(positive),
        ),
        arrival=draw(st.builds(ArrivalConfig, positive, positive, positive, positive)),
        control_period_s=draw(positive),
        noise_seed=draw(st.integers(0, 2**63 - 1)),
    )


def write(folder: Path, text: str | bytes, name: str = "scenario.yaml") -> Path:
    path = folder / name
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


# --- what is read ---------------------------------------------------------------------------------


@settings(max_examples=25)
@given(scenarios())
def test_round_trip(scenario: Scenario) -> None:
    check_scenario(scenario)
    text = dump_scenario(scenario)
    assert parse_scenario(text) == scenario
    assert dump_scenario(parse_scenario(text)) == text


def test_defaults() -> None:
    assert load_scenario() == Scenario()
    assert load_scenario().spacecraft is not load_scenario().spacecraft


def test_dump_holds_every_key_and_loads_from_a_file(tmp_path: Path) -> None:
    ends = TransitConfig(
        start_m=[1.0, 2.0, 3.0], goal_m=[4.0, 5.0, 6.0], start_velocity_m_s=[7.0, 8.0, 9.0]
    )
    scenario = Scenario(
        assurance=AssuranceConfig(),
        disturbance=RandomWalkDisturbanceConfig(),
        force_noise=ForceNoiseConfig(),
        kicks=KicksConfig(),
        policy=PolicyConfig("/somewhere/policy"),
        navigation=LidarNavigationConfig(ExpectedErrors(), map="/somewhere/map.obj"),
        truth=TruthConfig(mesh="/somewhere/mesh.obj", specific_impulse_s=220.0),
        dispersions="after_survey",
        transit=ends,
    )
    text = dump_scenario(scenario)
    for section in dc.fields(Scenario):
        assert f"{section.name}:" in text
        value = getattr(scenario, section.name)
        if dc.is_dataclass(value):
            for field in dc.fields(value):
                assert f"{field.name}:" in text
    assert load_scenario(write(tmp_path, text)) == scenario


def test_file_over_defaults(tmp_path: Path) -> None:
    path = write(tmp_path, "spacecraft: {mass_kg: 1e3}\nmpc:\n  intervals: 12  # fewer\n")
    expected = Scenario()
    expected.spacecraft.mass_kg = 1000.0
    expected.mpc.intervals = 12
    assert load_scenario(path) == expected
    assert load_scenario(str(path)) == expected


@pytest.mark.parametrize(
    "text", ["disturbance: {}", "disturbance: !RandomWalkDisturbanceConfig {}", "!Scenario\n"]
)
def test_tag_that_says_what_is_known(tmp_path: Path, text: str) -> None:
    scenario = load_scenario(write(tmp_path, text + "\ncontrol_period_s: 5"))
    assert scenario.control_period_s == 5.0
    if "disturbance" in text:
        assert scenario.disturbance == RandomWalkDisturbanceConfig()


def test_body_path_is_relative_to_the_file(tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    path = write(tmp_path / "sub", "body: ../rock.yaml")
    assert load_scenario(path).body == str((tmp_path / "rock.yaml").resolve())
    assert load_scenario(write(tmp_path, "body: kleopatra")).body == "kleopatra"


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


def test_a_learned_lidar_s_path_becomes_absolute(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    given: dict[str, object] = {"_tag": "!LearnedLidar", "bundle": "lidar"}
    for scenario in (
        load_scenario(None, {"lidar": given}),
        change_scenario(Scenario(), {"lidar": given}),
    ):
        assert scenario.lidar == LearnedLidarConfig(str(tmp_path / "lidar"))
    assert given["bundle"] == "lidar"


@pytest.mark.parametrize("key", ["policy.bundle", "assurance.bounds"])
def test_no_path_stays_none(key: str, tmp_path: Path) -> None:
    """It would become that of the folder."""
    section, last = key.split(".")
    for read in (
        lambda: load_scenario(None, {key: ""}),
        lambda: load_scenario(write(tmp_path, f"{section}: {{{last}: ''}}")),
    ):
        with pytest.raises(InputError, match=rf"{key} must name .*, or be null"):
            read()


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


def test_more_overrides() -> None:
    ends = load_scenario(None, ["transit.start_m=[1, 2, 3]", "transit.goal_m=[4, 5.5, 6e3]"])
    assert ends.transit.start_m == [1.0, 2.0, 3.0]
    assert ends.transit.goal_m == [4.0, 5.5, 6000.0]
    places = {"transit.start_m": np.arange(1, 4), "transit.goal_m": np.array([4.0, 5.5, 6e3])}
    assert load_scenario(None, places) == ends
    assert load_scenario(None, ["noise_seed=3", "noise_seed=4"]).noise_seed == 4
    assert load_scenario(None, "noise_seed=3").noise_seed == 3
    assert load_scenario(None, ["disturbance={}", "disturbance=null"]).disturbance is None


# --- what is refused ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        ("", "is empty"),
        ("# only a comment\n", "is empty"),
        ("- a\n- b\n", "holds a list"),
        ("a: [1", "is not YAML.*line 1"),
        ("7: 3", "the key 7 is no text"),
        ("x: !!python/object/apply:os.getcwd []", "is not YAML"),
        (bytes(range(256)), "is not a text file"),
        (b"\x01\x02\xff", "is not YAML"),
    ],
)
def test_files_that_hold_no_scenario(tmp_path: Path, content: str | bytes, complaint: str) -> None:
    path = write(tmp_path, content)
    with pytest.raises(InputError, match=rf"scenario\.yaml.*{complaint}"):
        load_scenario(path)
    with pytest.raises(InputError, match=complaint):
        read_mapping(path)
    if isinstance(content, str):
        with pytest.raises(InputError, match=f"^log.*{complaint}"):
            parse_scenario(content, "log")


def test_directory_and_missing_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is a directory"):
        load_scenario(tmp_path)
    for path in (tmp_path / "absent.yaml", write(tmp_path, "a: 1") / "below"):
        with pytest.raises(InputError, match="cannot be read"):
            load_scenario(path)


@pytest.mark.parametrize(
    ("key", "nearest"),
    [
        ("control_period", "control_period_s"),
        ("Mpc", "mpc"),
        ("spacecraft.mass", "mass_kg"),
        ("disturbance.reset_period", "reset_period_s"),
        ("spacecraft.", "mass_kg|thrust_limit_n|speed_limit_m_s"),
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


@pytest.mark.parametrize(
    ("override", "complaint"),
    [
        ("spacecraft.mass_kg=heavy", "spacecraft.mass_kg needs a number, got 'heavy'"),
        ("spacecraft.mass_kg=true", "spacecraft.mass_kg needs a number, got True"),
        ("spacecraft.mass_kg.x=3", "spacecraft.mass_kg needs a number"),
        ("spacecraft=3", "spacecraft needs `key: value` lines, got 3"),
        ("disturbance=!Earthquake {}", "disturbance cannot be !Earthquake"),
        ("mpc.intervals=3.5", "mpc.intervals needs a whole number, got 3.5"),
        ("control_period_s=2026-01-01", "control_period_s needs a number"),
        ("body=3", "body needs a text, got 3"),
        ("transit.start_m=4", "transit.start_m needs a list, each a number or null, got 4"),
        ("transit.start_m=[1, 2, x]", "transit.start_m needs a list, each a number"),
    ],
)
def test_wrong_type(override: str, complaint: str) -> None:
    with pytest.raises(InputError, match=f"^scenario: {complaint}"):
        load_scenario(None, [override])


@pytest.mark.parametrize(
    ("overrides", "complaint"),
    [
        (["noise_seed=-1"], "noise_seed must not be negative"),
        (["mpc.intervals=1"], "mpc.intervals must be at least 2"),
        (["mpc.cold_iterations=0"], "mpc.cold_iterations must be positive"),
        (["transit.min_distance_m=2e5"], "transit.min_distance_m must be below"),
        (["transit.start_m=[1, 2, 3]"], "transit needs both start_m and goal_m, or neither"),
        (["transit.start_m=[1, 2, 3]", "transit.goal_m=[1, 2]"], "goal_m must be three numbers"),
        (["transit.start_m=[1, 2, .nan]", "transit.goal_m=[1, 2, 3]"], "start_m must be three"),
        (["kicks.mean_interval_s=5"], "kicks.mean_interval_s must be at least control_period_s"),
        (["transit.start_velocity_m_s=[1, 2]"], "start_velocity_m_s must be three numbers"),
        (["transit.start_velocity_m_s=[1, 2, 41]"], "within spacecraft.speed_limit_m_s"),
        (["mpc.estimator_gain=0.1", "assurance={}"], "leave out assurance or the estimator"),
    ],
)
def test_values_that_do_not_fit_each_other(overrides: list[str], complaint: str) -> None:
    with pytest.raises(InputError, match=complaint):
        load_scenario(None, overrides)


@pytest.mark.parametrize("override", ["noise_seed", "=3", " = 3", ""])
def test_override_without_key_or_value(override: str) -> None:
    with pytest.raises(InputError, match=r"not of the form key\.subkey=value"):
        load_scenario(None, [override])


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


def test_own_body(rock) -> None:
    body = load_body(rock())
    assert body.config == BodyConfig(**ROCK)
    np.testing.assert_allclose(body.shape.centre_of_mass, 0.0, atol=1e-10)
    assert body.gravity_field.mass == pytest.approx(1e9)
    assert body.spin_rate == pytest.approx(2 * np.pi / 14400)


@pytest.mark.parametrize("name", ["itokawa", "", "..", "a\nb"])
def test_unknown_body(name: str) -> None:
    with pytest.raises(InputError, match=r"does not ship with proxops \(kleopatra does\)"):
        load_body(name)


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"mas_kg": 3.0}, "no key 'mas_kg' in BodyConfig; the nearest is 'mass_kg'"),
        ({"mass_kg": -1e9}, "mass_kg must be positive"),
        ({"mass_kg": 1e15}, "which no body has"),
        ({"rotation_period_h": "5:23"}, "rotation_period_h needs a number, got '5:23'"),
        ({"rotation_period_h": -5.2}, "turn the mesh half a turn: .* --fix NEW --flip"),
        ({"name": '"Kleopatra\\nMETA_STOP"'}, "characters that can be printed"),
        ({"keep_out_semi_axes_m": [160, 160]}, "must be three positive lengths"),
        ({"keep_out_semi_axes_m": [160, 160, 0]}, "must be three positive lengths"),
        ({"keep_out_semi_axes_m": 160}, "keep_out_semi_axes_m needs a list, each a number"),
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
        ("nope", "there is no key 'nope' in a scenario; the nearest is"),
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


def test_values_by_keyword() -> None:
    """They are the overrides of a mapping, and read better in a notebook."""
    found = load_scenario(transit=3, dispersions="after_survey", control_period_s=5.0)
    keys = {"transit.index": 3, "dispersions": "after_survey", "control_period_s": 5.0}
    assert found == load_scenario(None, keys)
    assert found.transit.index == 3
    with pytest.raises(InputError, match="there is no key 'dispersion'"):
        load_scenario(dispersion="after_survey")
