"""The closed-loop studies: their variants are what they are named, their columns right."""

import argparse
import dataclasses
import functools
from types import ModuleType

import pytest
from scripts import load_script
from short_flights import kleopatra

from proxops.diagrams.scenario import draw_world, load_scenario, of_transit
from proxops.studies.campaigns.variants import Variant, variant_flights
from proxops.systems.navigation import LidarNavigationConfig

PLAIN = {"log_ranges": False, "transit.seed": 10001}


TOLD = "after_survey"


@pytest.fixture(scope="module")
def studies() -> ModuleType:
    return load_script("benchmarks/closed_loop.py")


@functools.cache
def every_line(studies: ModuleType) -> list[Variant]:
    asked = argparse.Namespace(dispersions=TOLD, controller="zero")
    plain = load_scenario(None, PLAIN, on_true_state=True)
    return [variant for variant, _ in studies.one_at_a_time(asked, plain).lines.values()]


def test_the_navigation_is_told_the_dispersions_and_nothing_of_the_world(
    studies: ModuleType,
) -> None:
    plain = load_scenario(None, PLAIN)
    of_flight, body = of_transit(plain, 10001, 3), kleopatra()
    told = draw_world(dataclasses.replace(of_flight, dispersions="after_survey"), body).navigation
    assert isinstance(told, LidarNavigationConfig)
    assert told.expected is not None
    assert told.expected.gravity == pytest.approx(0.0005)
    for variant in every_line(studies):
        if variant.world is not None:
            assert variant.world(of_flight, body).navigation == told
    for name in ("after_survey", "before_survey"):
        [variant] = [each for each in every_line(studies) if each.name == f"all of {name}"]
        [flight] = variant_flights(variant, plain, 10001, [3])
        asked = dataclasses.replace(of_flight, dispersions=name)
        assert flight.scenario.navigation == draw_world(asked, body).navigation
