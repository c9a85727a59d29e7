"""The report of a survey, of figures that are made up."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from PIL import Image

from proxops.diagrams.meshcat import check_film
from proxops.studies.report import write_survey_report
from proxops.studies.report.survey_report import first_seen, write_survey_film
from proxops.systems.common import InputError
from proxops.systems.gravity import ball


def test_a_report_has_coverage_residuals_and_uncertainty(tmp_path: Path) -> None:
    random, shape = np.random.default_rng(1), ball(100.0)
    size = len(shape.vertices)
    surveyed = SimpleNamespace(
        figures={
            "covered": 0.987, "mass_kg": 7.3e10, "gravity_error": -0.0013,
            "gravity_deviation": 0.002, "rotation_period_h": 4.3, "rate_error": 1e-6,
            "rate_deviation": 2e-6, "length_m": 200.0, "length_error": 0.01,
            "map_rms_of_size": 0.001, "deviation_of_size": 0.002,
        },
        flight=SimpleNamespace(
            world=SimpleNamespace(
                scenario=SimpleNamespace(dispersed=["truth.gravity"]),
                true_body=SimpleNamespace(gravity_field=SimpleNamespace(mass=1.29e10)),
                body=SimpleNamespace(
                    gravity_field=SimpleNamespace(mass=1e10), config=SimpleNamespace(name="Pea")
                ),
            )
        ),
        made=SimpleNamespace(shape=shape),
        uncertainty=SimpleNamespace(
            counts=random.uniform(0.0, 50.0, size), deviations=np.ones(size)
        ),
        found=SimpleNamespace(
            solution=SimpleNamespace(
                residuals=random.standard_normal(600), deviations=np.ones(600)
            ),
            returns=SimpleNamespace(
                times=np.arange(60.0) * 600.0, frames=np.repeat(np.arange(60), 10)
            ),
        ),
        errors=random.standard_normal(500),
        deviations=np.ones(500),
    )  # fmt: skip
    write_survey_report(tmp_path, "Survey", cast(Any, surveyed), [("delta-v", "12 m/s")])
    page = (tmp_path / "report.html").read_text()
    for wanted in (
        "98.70% of the surface", "12 m/s", "What is uncertain where",
        "its true mass is 1.29 times that of Pea", "7.3e+10 kg", "-0.13%", "4.3 h", "-1.0e-06",
        "200 m", "0.2 m, rms", "0.4 m, rms",
    ):  # fmt: skip
        assert wanted in page
    pictures = {path.stem for path in (tmp_path / "figures").glob("*.png")}
    assert pictures == {"coverage", "residuals", "uncertainty", "errors"}


def test_a_film_shows_what_was_seen_by_then(tmp_path: Path) -> None:
    """Two halves of a ball, the upper one an hour after the lower one; one place is never seen."""
    shape, shift = ball(100.0), np.array([5.0, 0.0, 0.0])
    turn = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # R_KB.
    points, hidden = shape.vertices[1:], 0
    upper = points[:, 2] > 0.0
    placed = SimpleNamespace(points=1.02 * points @ turn + shift)
    returns = SimpleNamespace(times=np.array([7200.0, 10800.0]), frames=upper.astype(int))
    surveyed: Any = SimpleNamespace(
        made=SimpleNamespace(shape=shape, rotation=turn, centre=shift),
        found=SimpleNamespace(survey=SimpleNamespace(placed=lambda given: placed), returns=returns),
    )
    seen = first_seen(surveyed)
    assert np.isinf(seen[hidden])
    np.testing.assert_array_equal(seen[1:], returns.times[returns.frames])
    write_survey_film(tmp_path / "map.webp", surveyed, frames=3)
    with Image.open(tmp_path / "map.webp") as film:
        assert getattr(film, "n_frames", 1) == 3
        dark = []
        for k in range(3):
            film.seek(k)
            dark.append(float((np.asarray(film.convert("L"))[60:] < 250).mean()))
    assert dark[0] > 0.02
    assert dark[2] > 1.2 * dark[0]


def test_a_film_is_no_other_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"a film is a \.webp, \.gif or \.mp4 file"):
        check_film(tmp_path / "map.png")
