"""Light turns a rigid spacecraft, and what is on board copes with it."""

import numpy as np
import pytest

from proxops.diagrams.flight import fly, make_transit_diagram
from proxops.diagrams.scenario import World, facets_of, load_scenario, load_spacecraft

SETTINGS = {
    "spacecraft": "RigidBody",
    "navigation": "TrueState",
    "sunlight": {"direction": [0.6, 0.0, 0.8], "distance_au": 1.0},
    "arrival.deadline_s": 250.0,
    "arrival.dwell_s": 50.0,
}


@pytest.mark.slow
def test_the_torque_of_light_reaches_the_spacecraft_and_is_found() -> None:
    """Of a light as strong as to be seen: nearer to the Sun than any spacecraft has been."""
    strong = SETTINGS | {"sunlight": {"direction": [0.6, 0.0, 0.8], "distance_au": 0.1}}
    strong["truth.rigid_body.centre_of_mass_m"] = [0.0, 0.3, 0.0]
    scenario = load_scenario(None, strong)
    log = fly(scenario, "zero")
    momentum = log.dataset["wheel_momentum"].values
    diagram = make_transit_diagram(scenario)
    torque = diagram.GetSubsystemByName("sunlight").GetOutputPort("torque")
    context = diagram.CreateDefaultContext()
    given = torque.Eval(diagram.GetSubsystemByName("sunlight").GetMyContextFromRoot(context))
    assert np.linalg.norm(given) > 3e-4
    # It holds its attitude, so the wheels take up the torque.
    model_axes = diagram.GetSubsystemByName("spacecraft").wheel_axes
    taken = (momentum[-1] - momentum[0]) @ model_axes
    held = log.dataset["time"].values[-1] * given
    assert np.linalg.norm(taken - held) < 0.15 * np.linalg.norm(held)


def test_the_star_tracker_is_told_where_the_sun_is() -> None:
    """Only in sunlight; by the system itself, not by what is believed."""
    without = {key: value for key, value in SETTINGS.items() if key != "sunlight"}
    for settings in (SETTINGS, without):
        diagram = make_transit_diagram(load_scenario(None, settings))
        tracker = diagram.GetSubsystemByName("star_tracker")
        port = tracker.GetInputPort("sun_direction")
        own = tracker.GetMyContextFromRoot(diagram.CreateDefaultContext())
        assert port.HasValue(own) == ("sunlight" in settings)
        if "sunlight" in settings:
            np.testing.assert_allclose(port.Eval(own), [0.6, 0.0, 0.8], atol=1e-12)


def test_bounds_count_the_facets() -> None:
    """The worst of 2,000 ways, by the sum over the facets, is below the bound and near it."""
    without = {key: value for key, value in SETTINGS.items() if key != "sunlight"}
    told, plain = (
        World.of(load_scenario(None, each | {"assurance": {}})).uncertainty_set
        for each in (SETTINGS, without)
    )
    shape, random, worst = facets_of(load_spacecraft("smallsat")), np.random.default_rng(1), 0.0
    for way in random.normal(size=(2000, 3)):
        sun = way / np.linalg.norm(way)
        force = np.zeros(3)
        for normal, area in zip(shape.normals, shape.areas, strict=True):
            cosine = max(normal @ sun, 0.0)
            force -= area * cosine * (0.8 * sun + 2.0 * (0.2 * cosine + 0.1 / 3.0) * normal)
        worst = max(worst, float(np.linalg.norm(force)))
    most = 1361.0 / 299792458.0 * worst / 100.0
    more = told.acceleration_m_s2 - plain.acceleration_m_s2
    # The tide adds 2 GM / d^3 times 280 km.
    assert most < more < 1.03 * most + 2.0 * 1.33e20 / 1.496e11**3 * 281e3
