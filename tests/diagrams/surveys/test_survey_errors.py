"""How far a survey's map is from the truth, beside balls."""

from typing import Any, cast

import numpy as np
import pytest

from proxops.diagrams.surveys.survey_files import surface_errors
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
