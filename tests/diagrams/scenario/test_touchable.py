"""What touching takes of a scenario."""

import numpy as np

from proxops.diagrams.scenario import (
    load_body,
    load_scenario,
    load_spacecraft,
    site_world,
    touch_craft,
)
from proxops.systems.touch import Arm


def test_the_sun_goes_round_against_the_spin() -> None:
    scenario = load_scenario("bennu", {"sunlight": {"direction": [1.0, 0.0, 1.0]}})
    body = load_body("bennu")
    suns = site_world(scenario, body).suns
    np.testing.assert_allclose(np.linalg.norm(suns, axis=1), 1.0)
    np.testing.assert_allclose(suns[:, 2], np.sqrt(0.5), atol=1e-12)
    quarter = len(suns) // 4
    np.testing.assert_allclose(suns[quarter], np.array([0, -1, 1]) / np.sqrt(2.0), atol=1e-12)
    assert len(site_world(load_scenario("bennu"), body).suns) == 0


def test_solids_that_may_touch() -> None:
    model = load_spacecraft("osiris_rex")
    craft = touch_craft(model, Arm(np.array([0.0, 0, -2.84]), np.array([0.0, 0, -1.0])))
    assert craft.mass == model.mass
    edges = sorted(tuple(np.round(size, 6)) for _, size in craft.parts.values())
    assert edges == [(2.0, 2.1, 0.03), (2.0, 2.1, 0.03), (2.4, 2.4, 2.3)]
    middles = sorted(round(middle[1], 6) for middle, _ in craft.parts.values())
    assert middles == [-2.4, 0.0, 2.4]
