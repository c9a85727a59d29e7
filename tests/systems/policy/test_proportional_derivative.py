"""The PD baseline: its law in each regime, and where it comes to rest."""

import numpy as np
import pytest
from one_system import evaluated
from short_flights import short_scenario

from proxops.diagrams.flight.simulation import fly
from proxops.systems import ProportionalDerivative

# λ = 7 / (2 · 100 · 40) = 8.75e-4 1/s and m k = 100 / (2 · 10) = 5 kg/s.
RATE, GAIN = 8.75e-4, 5.0


def force(state: list[float], target: list[float]) -> np.ndarray:
    controller = ProportionalDerivative(100.0, 7.0, 40.0, 10.0)
    return evaluated(controller, "force", state=state, target=target)


def test_near_the_goal_it_is_linear() -> None:
    state = [100.0, -200.0, 0.0, 0.01, 0.0, -0.3]
    target = [150.0, 0.0, 50.0, 0.0, 0.0, 0.0]
    wanted = GAIN * (RATE * np.array([50.0, 200.0, 50.0]) - np.array([0.01, 0.0, -0.3]))
    assert force(state, target) == pytest.approx(wanted, rel=1e-12)


def test_far_off_it_asks_for_the_speed_limit() -> None:
    # 160 km off, λ e would be 140 m/s. At the speed limit nothing pushes, above it brakes.
    goal = [0.0] * 6
    assert force([-160e3, 0, 0, 40.0, 0, 0], goal) == pytest.approx([0.0, 0.0, 0.0])
    assert force([-160e3, 0, 0, 41.0, 0, 0], goal) == pytest.approx([-GAIN, 0.0, 0.0])
    assert force([-160e3, 160e3, 0, 0, 0, 0], goal) == pytest.approx([7.0, -7.0, 0.0])


def test_braking_takes_half_of_the_limit() -> None:
    """Along velocity = λ e the deceleration is λ² e, at most λ v = F / 2m, where λ e = v."""
    half = 100.0 * RATE * 40.0
    assert half == pytest.approx(7.0 / 2.0)
    far = 40.0 / RATE
    assert force([-far, 0, 0, 40.0, 0, 0], [0.0] * 6) == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)


def test_hangs_beside_the_goal_by_its_weight() -> None:
    """At rest m k λ (goal - position) carries gravity and the centrifugal force."""
    goal = [160e3, 100.0, 0.0]
    scenario = short_scenario(
        transit__goal_m=goal, arrival__dwell_s=6000.0, arrival__deadline_s=10.0, log_ranges=False
    )
    log = fly(scenario, "pd")
    end = log.dataset["state"].values[-1]
    spin = np.array([0.0, 0.0, log.body.spin_rate])
    gravity = log.body.gravity_field.evaluate(end[None, :3]).acceleration[0]
    pull = gravity - np.cross(spin, np.cross(spin, end[:3]))
    assert GAIN * RATE * (goal - end[:3]) == pytest.approx(-100.0 * pull, abs=0.01)
    assert np.linalg.norm(end[3:]) < 0.01
    assert log.summary["controller"] == "pd"
    assert log.summary["control_ms_median"] is None
    assert (log.dataset["decision"] == 0).all()
