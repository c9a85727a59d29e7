"""Worlds whose errors are many times as large as they were drawn."""

import dataclasses as dc

import numpy as np

from proxops.diagrams.scenario import Body, Scenario, change_scenario

# What says how errors are drawn, not how large they are.
_NO_ERRORS = ("seed", "correlation", "latency", "mesh", "specific_impulse", "failed", "failure")


def farther_off(scenario: Scenario, body: Body, times: float) -> Scenario:
    """A `World`: every error of the truth is `times` as large, and nobody on board is told.

    The specific impulse stays: its error is the propellant that the believed mass leaves out.
    """
    drawn, usual = dc.asdict(scenario.truth), dc.asdict(Scenario().truth)
    return change_scenario(scenario, {"truth": _scaled(drawn, usual, times)})


def _scaled(drawn: dict, usual: dict, times: float) -> dict:
    """Numbers of nested mappings, `times` as far from the usual ones."""
    found = {}
    for key, value in drawn.items():
        nominal = usual.get(key)
        if isinstance(value, dict):
            found[key] = _scaled(value, nominal or {}, times)
        elif isinstance(value, str | bool | None) or any(part in key for part in _NO_ERRORS):
            found[key] = value
        else:
            base = np.array(nominal)
            found[key] = (base + times * (np.array(value) - base)).tolist()
    return found
