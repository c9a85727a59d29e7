"""Transits of a seed."""

from proxops.diagrams.scenario import Scenario, Transit, draw_transit, load_body


def transit_set(seed: int, count: int, scenario: Scenario | None = None) -> list[Transit]:
    """Draws the first `count` transits of a seed, by default those of the default scenario."""
    scenario = scenario or Scenario()
    body = load_body(scenario.body)
    return [draw_transit(seed, index, scenario, body) for index in range(count)]
