"""Values in YAML: the core schema of YAML 1.2, and what older readers find in what is written."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.common.yaml import yaml_dump_typed, yaml_load

from proxops.diagrams.scenario import (
    Scenario,
    dump_changes,
    dump_scenario,
    load_scenario,
    parse_scenario,
)
from proxops.diagrams.yaml_files.plain_yaml import read_yaml, write_yaml
from proxops.systems.common import InputError

# The examples of chapter 10.3.2 of YAML 1.2.2, and what YAML 1.1 reads in another way.
CORE = {
    "null": None, "Null": None, "~": None, "": None, "nULL": "nULL",
    "true": True, "True": True, "FALSE": False, "yes": "yes", "on": "on", "No": "No", "y": "y",
    "0": 0, "0o7": 7, "0o10": 8, "0x3A": 58, "-19": -19, "+12": 12, "010": 10, "08": 8,
    "0o8": "0o8", "0b11": "0b11", "-0x10": "-0x10", "1_000": "1_000", "5:23": "5:23",
    "-1:30.5": "-1:30.5", "0.": 0.0, "-0.0": -0.0, ".5": 0.5, "+12e03": 12000.0,
    "-2E+05": -200000.0, "1e3": 1000.0,
    "1e-2": 0.01, "1.5e3": 1500.0, ".inf": math.inf, "-.Inf": -math.inf, "+.INF": math.inf,
    ".": ".", "e3": "e3", "1e": "1e", "inf": "inf", "nan": "nan", "+.nan": "+.nan",
    "2020-01-01": "2020-01-01", "'10'": "10", '"true"': "true", "=": "=", "<<": "<<",
    "!!str 10": "10", "!!float 10": 10.0, "!!int 0x10": 16, "!!bool true": True, "!!null ~": None,
}  # fmt: skip


@pytest.mark.parametrize("text", CORE)
def test_the_core_schema(text: str) -> None:
    found = read_yaml(f"value: {text}", "it")["value"]
    assert found == CORE[text]
    assert type(found) is type(CORE[text])


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("!!int 1_000", "line 1: '1_000' has the tag !!int, which it is not"),
        ("!!int [1]", "expected a scalar node"),
        ("{a: 1,\na: 2}", "line 2: it has the key 'a' twice: write it once"),
        ("[{b: {a: 1, a: 2}}]", "twice"),
        ("{? [1] : 2}", "no text"),
        ("{1: 2}", "the key 1 is no text"),
        ("[&x 1, *x]", "alias"),
        ("!Tag", "the tag !Tag needs a mapping after it, which may be empty: !Tag {}"),
        ("!Tag [1]", "needs a mapping"),
        ("[1", "line 1: while parsing a flow sequence; line 2: did not find expected"),
        ("\ud800", "surrogates"),
        ("a\x01b", "control characters"),
    ],
)
def test_what_is_refused(text: str, complaint: str) -> None:
    with pytest.raises(InputError, match=r"^it is not YAML") as caught:
        read_yaml(text, "it")
    assert complaint in str(caught.value)
    assert "\n" not in str(caught.value)


# Texts that one of the versions takes for something else come by chance too seldom.
texts = st.one_of(
    st.text(st.characters(exclude_categories=["Cs"])),
    st.sampled_from(
        [*CORE, "1e3", "0o17", "12:30", "off", "2020-01-01T10:00:00Z", "!a", "- a", "#"]
    ),
    st.from_regex(r"[-+]?[0-9_.:eEoxX]{1,6}", fullmatch=True),
)
numbers = st.floats() | st.sampled_from([1e-300, 1e22, 1e16, -1e-7, 5e-324, 123456789.0, -0.0])
scalars = st.none() | st.booleans() | st.integers() | numbers | texts
trees = st.recursive(
    scalars, lambda inner: st.lists(inner) | st.dictionaries(texts, inner), max_leaves=8
)


def same(one: object, other: object) -> bool:
    """Whether two trees are equal, their types as well, and nan equal to nan."""
    return repr(one) == repr(other)


@settings(max_examples=12)
@given(tree=trees)
def test_all_readers_find_what_was_written(tree: object) -> None:
    text = write_yaml({"value": tree})
    assert same(read_yaml(text, "it"), {"value": tree})
    assert same(yaml_load(data=text, private=True), {"value": tree})


@pytest.mark.parametrize("name", ["Rock", "433", "1e3", "0o17", "5:23", "yes", "a: b"])
def test_a_scenario_is_read_as_it_was_written(name: str) -> None:
    """What an earlier version wrote, by pydrake for YAML 1.1, too."""
    changes = {"navigation": {"_tag": "!TrueState"}, "assurance.bounds": "before_survey"}
    scenario = load_scenario(None, changes)
    scenario.policy.bundle = name
    assert parse_scenario(dump_scenario(scenario)) == scenario
    changes = dump_changes(scenario)
    assert parse_scenario(changes) == scenario
    assert len(changes.splitlines()) < 10
    before = yaml_dump_typed(scenario, schema=Scenario)
    if name not in ("1e3", "0o17"):
        assert parse_scenario(str(before)) == scenario
    if name == "Rock":
        assert before == dump_scenario(scenario)
