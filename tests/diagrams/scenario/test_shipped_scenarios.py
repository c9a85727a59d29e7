"""Scenarios that ship under a name."""

import numpy as np
import pytest

from proxops.diagrams.flight.scenario_systems import make_backup
from proxops.diagrams.scenario import (
    draw_transit,
    load_body,
    load_scenario,
    load_spacecraft,
    scenario_remarks,
    shipped_scenarios,
)
from proxops.systems.assurance import AssuranceConfig
from proxops.systems.common import InputError

# Mean radii in m as published: Lauretta et al. 2019; Watanabe et al. 2019; Toutatis by its volume.
RADII = {"bennu": 245.0, "ryugu": 448.0, "toutatis": 1223.0}
CRAFT = {"bennu": "osiris_rex", "ryugu": "hayabusa2", "toutatis": "osiris_rex"}


def test_scenarios_ship_under_the_names_of_their_bodies() -> None:
    tasks = ["bennu_touch_and_go"]
    tasks += [f"{body}_mission" for body in ("bennu", "didymos", "kleopatra", "ryugu", "toutatis")]
    names = ["bennu", "didymos", "kleopatra", "ryugu", "toutatis"]
    assert sorted(shipped_scenarios()) == sorted(names + tasks)
    assert load_scenario("kleopatra") == load_scenario()


@pytest.mark.parametrize("name", RADII)
def test_shipped_scenario_fits_its_body(name: str) -> None:
    scenario = load_scenario(name, transit=2)
    assert scenario.body == name
    assert scenario.transit.index == 2
    body = load_body(name)
    assert scenario_remarks(scenario, body) == []
    drawn = [draw_transit(100, index, scenario, body) for index in range(10)]
    ends = [end for transit in drawn for end in (transit.start, transit.goal)]
    far = np.linalg.norm(ends, axis=1) / RADII[name]
    assert 1.4 < far.min() < 2.5
    assert 3.0 < far.max() < 6.5


def test_transits_at_didymos_are_outside_the_orbit_of_its_moon() -> None:
    """The ends are far from the moon at any time, and from two to seven radii of 390 m away."""
    scenario, body = load_scenario("didymos"), load_body("didymos")
    assert scenario_remarks(scenario, body) == []
    drawn = [draw_transit(100, index, scenario, body) for index in range(10)]
    ends = np.array([end for transit in drawn for end in (transit.start, transit.goal)])
    assert np.linalg.norm(ends, axis=1).min() / 390.0 > 2.0
    assert np.linalg.norm(ends, axis=1).max() / 390.0 < 9.0
    (moon,) = body.moons
    ring, height = np.hypot(ends[:, 0], ends[:, 1]), ends[:, 2]
    assert np.hypot(ring - 1146.0, height).min() > moon.config.radius_m + 0.03 * 1146.0


@pytest.mark.parametrize("name", [*RADII, "didymos"])
def test_runtime_assurance_keeps_out_in_all_worlds_of_after_survey(name: str) -> None:
    scenario = load_scenario(name, ["dispersions=after_survey"])
    backup = make_backup(scenario, load_body(name), AssuranceConfig())
    far, size = np.array([0.0, 0.0, 3.0 * RADII.get(name, 400.0)]), 2.0 * RADII.get(name, 400.0)
    # In flight the errors of the state that the navigation tells come on top.
    assert backup.can_hold(far, 2.5e-3 * size, 5e-3 * scenario.spacecraft.speed_limit_m_s)


def test_where_thrust_of_one_period_is_too_much_the_message_says_what_to_change() -> None:
    slow = load_scenario("ryugu", ["dispersions=after_survey", "spacecraft.speed_limit_m_s=1"])
    with pytest.raises(
        InputError, match=r"whole control period, .* raise spacecraft\.speed_limit_m_s to 2 "
    ):
        make_backup(slow, load_body("ryugu"), AssuranceConfig())


@pytest.mark.parametrize("name", RADII)
def test_spacecraft_is_as_its_model(name: str) -> None:
    craft, model = load_scenario(name).spacecraft, load_spacecraft(CRAFT[name])
    assert craft.mass_kg == pytest.approx(model.mass)
    assert craft.thrust_limit_n == pytest.approx(model.config.thrust_limit_n)


@pytest.mark.parametrize("name", ["itokawa", "x" * 300])
def test_a_scenario_that_does_not_ship(name: str) -> None:
    names = (
        "bennu, bennu_mission, bennu_touch_and_go, didymos, didymos_mission, kleopatra, "
        "kleopatra_mission, ryugu, ryugu_mission, toutatis, toutatis_mission"
    )
    with pytest.raises(InputError, match=rf"does not ship .*\({names} do"):
        load_scenario(name)
