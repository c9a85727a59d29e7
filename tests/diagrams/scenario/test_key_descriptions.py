"""What is said of each key of a scenario, and the default scenario with comments."""

import re

import pytest

from proxops.diagrams.scenario import (
    Scenario,
    commented_scenario,
    described_keys,
    dotted,
    load_scenario,
    parse_scenario,
)
from proxops.diagrams.scenario.keys import dotted_fields
from proxops.systems.common import InputError


def test_every_key_is_described() -> None:
    names = dict(dotted())
    assert {*dotted_fields()} <= names.keys()
    for name, key in names.items():
        assert key.limits or key.sections, name


def test_a_number() -> None:
    (key,) = (key for name, key in dotted() if name == "mpc.nominal_acceleration_m_s2")
    assert key.default == "0.03"
    assert key.unit == "m/s^2"
    assert key.limits == "at least 1e-09, at most 1e+06"
    assert key.meaning.startswith("This acceleration sets the price of time.")


def test_a_section_of_several_kinds() -> None:
    (key,) = (key for key in described_keys() if key.name == "navigation")
    assert key.default == "!LidarNavigation"
    assert key.choices == ("LidarNavigation", "TrueState")


def test_the_commented_scenario_is_the_default() -> None:
    text = commented_scenario()
    assert parse_scenario(text) == Scenario()
    assert "# Name of a body that ships with proxops" in text
    assert max(map(len, text.splitlines())) <= 110


@pytest.mark.parametrize("name", ["didymos", "bennu_touch_and_go", "kleopatra_mission"])
def test_a_commented_scenario_is_what_it_was(name: str) -> None:
    scenario = load_scenario(name, {"kicks": {}, "dispersions": "mission"})
    assert parse_scenario(commented_scenario(scenario)) == scenario


def test_sections_that_the_default_lacks_are_there_as_comments() -> None:
    """Without the comment signs they are YAML that a scenario takes."""
    found = re.search(r"^# kicks:\n((?:#   .*\n)*)", commented_scenario(), re.MULTILINE)
    assert found is not None
    text = re.sub(r"^# ", "", found[0], flags=re.MULTILINE)
    kicked = parse_scenario(text)
    assert kicked.kicks is not None
    assert kicked == load_scenario(None, {"kicks": {}})


@pytest.mark.parametrize("given", ["navigation=TrueState", "navigation=!TrueState {}"])
def test_a_tag_alone(given: str) -> None:
    assert load_scenario(None, [given]) == load_scenario(on_true_state=True)


def test_a_tag_alone_and_a_value_of_its_section() -> None:
    wanted = load_scenario(None, ["lidar=LearnedLidar", "lidar.bundle=out/lidar"])
    assert type(wanted.lidar).__name__ == "LearnedLidarConfig"
    with pytest.raises(InputError, match="or one of LidarNavigation, TrueState, got 'Truth'"):
        load_scenario(None, ["navigation=Truth"])
