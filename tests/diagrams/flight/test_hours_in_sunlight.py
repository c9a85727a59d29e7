"""A flight at Bennu through its shadow, against DOP853 in N with gravity, shadow and tide by hand.

The reference shares no code: polyhedral gravity as printed, rays of trimesh, both pulls of the Sun.
"""

import numpy as np
import pytest
from plain_polyhedral_gravity import PlainPolyhedralGravity
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from proxops.diagrams.flight import fly
from proxops.diagrams.scenario import load_body, load_scenario

AU, SUN, MASS = 149597870700.0, 1.3271244e20, 1400.0
# As strong as to be seen within the hour: a sail, near to the Sun.
DISTANCE, AREA, REFLECTIVITY = 0.3, 1e4, 1.3
PERIOD, STEPS = 20.0, 180
WAY = np.array([1.0, 0.2, -0.1]) / np.linalg.norm([1.0, 0.2, -0.1])
START, VELOCITY = np.array([-700.0, 340.0, 30.0]), np.array([0.03, -0.25, 0.02])


@pytest.mark.slow
def test_an_hour_through_the_shadow() -> None:
    told = {
        "navigation": "TrueState", "control_period_s": PERIOD, "spacecraft.speed_limit_m_s": 5.0,
        "sunlight": {
            "direction": WAY.tolist(), "distance_au": DISTANCE, "area_m2": AREA,
            "reflectivity": REFLECTIVITY,
        },
        "transit.start_m": START.tolist(), "transit.goal_m": [0.0, 900.0, 0.0],
        "transit.start_velocity_m_s": VELOCITY.tolist(),
        "arrival.deadline_s": PERIOD * STEPS - 100.0, "arrival.dwell_s": 100.0,
    }  # fmt: skip
    log = fly(load_scenario("bennu", told), "zero")
    found = log.dataset["position_inertial"].values
    assert len(found) == STEPS + 1

    body = load_body("bennu")
    gravity = PlainPolyhedralGravity(
        body.shape.vertices, body.shape.facets, body.config.mass_kg / body.shape.volume
    )
    spin, rays = body.spin.rate, body.shape.to_trimesh().ray
    sun = (DISTANCE * AU * WAY).astype(np.longdouble)
    push = -1361.0 / 299792458.0 / DISTANCE**2 * REFLECTIVITY * AREA / MASS * WAY

    def rates(time: float, y: np.ndarray, lit: bool) -> np.ndarray:
        turn = Rotation.from_rotvec(time * spin).as_matrix()
        pull = turn @ gravity.at(turn.T @ y[:3]).acceleration
        away = sun - y[:3]
        tide = away / np.sum(away**2) ** 1.5 - sun / np.sum(sun**2) ** 1.5
        return np.concatenate([y[3:], pull + SUN * tide.astype(float) + lit * push])

    state = np.concatenate([START, VELOCITY + np.cross(spin, START)])
    scale, shadows = np.repeat([700.0, 0.3], 3), []
    for step in range(STEPS):
        now = PERIOD * step
        turn = Rotation.from_rotvec(now * spin).as_matrix()
        lit = not rays.intersects_any((turn.T @ state[:3])[None], (turn.T @ WAY)[None])[0]
        shadows.append(not lit)
        span = (now, now + PERIOD)
        state = solve_ivp(
            rates, span, state, "DOP853", first_step=PERIOD, rtol=1e-10, atol=1e-10 * scale,
            args=(lit,),
        ).y[:, -1]  # fmt: skip
    assert 20 < sum(shadows) < STEPS - 20
    assert np.linalg.norm(0.5 * push * (PERIOD * STEPS) ** 2) > 1000.0
    np.testing.assert_allclose(found[-1], state[:3], atol=1e-4)
