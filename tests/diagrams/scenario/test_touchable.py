"""What touching takes of a scenario."""

import numpy as np

from proxops.diagrams.scenario import (
    load_body,
    load_scenario,
    load_spacecraft,
    site_world,
    touch_craft,
    with_site,
)
from proxops.diagrams.scenario.touchable import touch_ends
from proxops.systems.shapes import clearances
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


def test_a_place_is_chosen_to_which_a_transit_leads() -> None:
    """The best of all has its home too near the keep-out ellipsoid: it is another."""
    body, homes = load_body("bennu"), []
    for margin in (0.0, None):
        more = (
            margin if margin is not None else clearances(body.keep_out_semi_axes, homes[0])[0] + 1
        )
        changes = {"task.transit": True, "mpc.keep_out_margin_m": float(more)}
        scenario = with_site(load_scenario("bennu_touch_and_go", changes), body)
        homes.append(touch_ends(scenario, body)[1][None])
    near, far = (float(clearances(body.keep_out_semi_axes, home)[0]) for home in homes)
    assert far >= near + 1.0
    # No place is so far out: then it is the best of all, and a flight says what is wrong.
    changes = {"task.transit": True, "mpc.keep_out_margin_m": 500.0}
    scenario = with_site(load_scenario("bennu_touch_and_go", changes), body)
    np.testing.assert_array_equal(touch_ends(scenario, body)[1], homes[0][0])


def test_solids_that_may_touch() -> None:
    model = load_spacecraft("osiris_rex")
    craft = touch_craft(model, Arm(np.array([0.0, 0, -2.84]), np.array([0.0, 0, -1.0])))
    assert craft.mass == model.mass
    edges = sorted(tuple(np.round(size, 6)) for _, size in craft.parts.values())
    assert edges == [(2.0, 2.1, 0.03), (2.0, 2.1, 0.03), (2.4, 2.4, 2.3)]
    middles = sorted(round(middle[1], 6) for middle, _ in craft.parts.values())
    assert middles == [-2.4, 0.0, 2.4]
