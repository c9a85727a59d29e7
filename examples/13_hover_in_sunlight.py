"""Hovering at Bennu in sunlight: what it takes, against the least that gravity and light ask for.

    python examples/13_hover_in_sunlight.py [HOURS]

The hybrid holds a spacecraft like OSIRIS-REx over one place, on lidar navigation, in a world that
differs from what is believed as after a survey.
"""

import sys

import numpy as np

from proxops.diagrams.flight import fly
from proxops.diagrams.scenario import load_body, load_scenario
from proxops.systems.vehicle import light_acceleration

PLACE = np.array([0.0, 500.0, 0.0])
HOURS = float(sys.argv[1]) if len(sys.argv) > 1 else 0.5

scenario = load_scenario("bennu", {
    "transit.start_m": PLACE.tolist(), "transit.goal_m": PLACE.tolist(),
    "arrival.deadline_s": 60.0, "arrival.dwell_s": 3600.0 * HOURS,
    "sunlight": {"direction": [1.0, 0.3, 0.2], "distance_au": 1.13, "area_m2": 12.0},
    "dispersions": "after_survey", "log_ranges": False,
})  # fmt: skip
log = fly(scenario, "hybrid")

craft, data = log.scenario.spacecraft, log.dataset
away = np.linalg.norm(data["state"].values[:, :3] - PLACE, axis=1)
forces = data["force"].values[:-1]
spent = np.abs(forces).sum() * scenario.control_period_s / craft.mass_kg

body = load_body("bennu")
pull = body.gravity_field.evaluate(PLACE[None]).acceleration[0]
pull -= np.cross(body.spin.rate, np.cross(body.spin.rate, PLACE))
assert scenario.sunlight is not None
light = light_acceleration(scenario.sunlight, craft.mass_kg) * data["sun_direction"].values[:-1]
least = np.abs(pull - light).sum() * scenario.control_period_s

print(f"held within {away.max():.2f} m of the place for {HOURS:g} h")
print(f"delta-v {spent:.3f} m/s, {spent / least:.3f} of the least")
