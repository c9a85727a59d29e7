"""All state of a flight is in its Context: a clone goes on as the flight does, bit for bit."""

from pathlib import Path

import numpy as np
import pytest
from known_policies import DeadReckoning, write_policy
from pydrake.systems.framework import Context
from short_flights import flown_and_taken_up, kleopatra, on_lidar

from proxops.diagrams.flight import make_transit_diagram, named_controller

# All that remembers anything. It is at its goal from the start, and the flight ends 300 s later.
EVERYTHING = {
    "disturbance": {}, "force_noise": {}, "kicks": {"mean_interval_s": 50.0}, "noise_seed": 3,
    "truth__lidar__latency_steps": 1, "truth__attitude__constant_deg": [0.3, 0.2, -0.1],
    "truth__specific_impulse_s": 220.0, "arrival__radius_m": 1e6, "arrival__speed_m_s": 30.0,
    "arrival__dwell_s": 300.0, "sunlight": {"direction": [-1.0, 0.0, 0.0], "area_m2": 1e3},
}  # fmt: skip


@pytest.mark.parametrize(
    ("controller", "changes"),
    [
        ("mpc", {"mpc__estimator_gain": 0.2}),
        ("mpc", {"mpc__solve_delay_s": 4.0}),
        ("policy", {}),
        ("hybrid", {"hybrid__state_noise_velocity_m_s": 0.1}),
        ("hybrid", {"hybrid__period_rule": "adaptive"}),
    ],
)
def test_a_cloned_context_goes_on_alike(
    controller: str, changes: dict[str, object], tmp_path: Path
) -> None:
    bundle = write_policy(tmp_path / "policy", DeadReckoning())
    scenario = on_lidar(**EVERYTHING, **changes, policy__bundle=str(bundle))
    flown = named_controller(controller, scenario, kleopatra())
    diagram = make_transit_diagram(scenario, flown, body=kleopatra())
    # At 92 s a command of a solve that takes 4 s still waits.
    one, other = flown_and_taken_up(diagram, scenario, 92.0, 1000.0)
    assert one.get_time() == other.get_time() == pytest.approx(300.0, abs=10.0)
    assert state_of(one).size > 300
    np.testing.assert_array_equal(state_of(one), state_of(other))


def state_of(context: Context) -> np.ndarray:
    """All numbers that a flight's systems remember."""
    assert context.num_abstract_states() == 0
    groups = context.get_discrete_state()
    memory = [groups.get_vector(k).CopyToVector() for k in range(groups.num_groups())]
    return np.concatenate([*memory, context.get_continuous_state_vector().CopyToVector()])
