"""Whole flights of adversaries: without assurance they enter the keep-out, with it they do not."""

import numpy as np
import pytest
from scripts import load_script
from short_flights import kleopatra

from proxops.diagrams.scenario.scenario import load_scenario

adversaries = load_script("benchmarks/_adversaries.py")
ADVERSARIES, adversarial_flight = adversaries.ADVERSARIES, adversaries.adversarial_flight


@pytest.mark.parametrize("adversary", [name for name in ADVERSARIES if name != "zero"])
def test_in_without_assurance_and_out_with_it(adversary: str) -> None:
    scenario = load_scenario()
    # Seed 2 starts where each of them gets in within 1,500 s.
    bare, assured = (
        adversarial_flight(scenario, kleopatra(), adversary, 2, steps=150, assured=on)
        for on in (False, True)
    )
    assert np.array_equal(bare.states[0], assured.states[0])
    assert np.array_equal(bare.forces, bare.commands)
    assert bare.clearance < -1.0
    assert assured.clearance > 0.0
    assert assured.speed < 40.001
    assert np.abs(assured.forces).max() <= 7.0
    assert (assured.forces != assured.commands).any()


@pytest.mark.slow
@pytest.mark.parametrize("adversary", ADVERSARIES)
def test_whole_flights_stay_out(adversary: str) -> None:
    scenario = load_scenario()
    for seed in range(100, 108):
        flight = adversarial_flight(scenario, kleopatra(), adversary, seed)
        assert flight.clearance > 0.0, seed
        # Where it has to, keeping out takes some of the speed limit.
        assert flight.speed < 40.05, seed
