"""What a survey says of its map: how far it is from the truth, beside balls, and its phase."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from proxops.diagrams.scenario import load_body, load_scenario
from proxops.diagrams.surveys.survey_files import expected_entries, surface_errors
from proxops.systems.gravity import ball


def test_errors_of_a_ball_that_is_too_large() -> None:
    true, wide = ball(100.0), ball(101.0)

    class Said:
        deviations = np.full(len(wide.vertices), 2.0)

    off, sigma, shares = surface_errors(wide, true, cast(Any, Said))
    assert shares.sum() == pytest.approx(1.0)
    np.testing.assert_allclose(sigma, 2.0)
    np.testing.assert_allclose(off, 1.0, atol=0.01)
    off, *_ = surface_errors(true, wide, cast(Any, Said))
    np.testing.assert_allclose(off, -1.0, atol=0.01)


def test_the_phase_of_a_map_is_as_uncertain_as_the_star_tracker() -> None:
    """Turned about z, map and star tracker's constant error look the same to a survey."""
    body = load_body("bennu")
    scenario = load_scenario("bennu", {"dispersions": "mission"})
    said: Any = SimpleNamespace(
        rms=0.2, correlation=10.0, centre=np.zeros(3), gravity=1e-3, pole=1e-4, rate=1e-6
    )
    made: Any = SimpleNamespace(shape=body.shape, centre=np.zeros(3))
    entries: Any = expected_entries(scenario, said, cast(Any, None), made, body)
    tracker = entries["truth.attitude.constant_deg"]["three_sigma"]
    phase = entries["truth.phase_deg"]["three_sigma"]
    assert tracker == pytest.approx(0.1)
    assert tracker < phase == pytest.approx(np.hypot(tracker, 0.06))
