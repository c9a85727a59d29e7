"""The report of a survey, of figures that are made up."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from proxops.studies.report import write_survey_report
from proxops.systems.gravity import ball


def test_a_report_has_coverage_residuals_and_uncertainty(tmp_path: Path) -> None:
    random, shape = np.random.default_rng(1), ball(100.0)
    size = len(shape.vertices)
    surveyed = SimpleNamespace(
        figures={"covered": 0.987},
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
    )
    write_survey_report(tmp_path, "Survey", cast(Any, surveyed), [("delta-v", "12 m/s")])
    page = (tmp_path / "report.html").read_text()
    for wanted in ("98.70% of the surface", "12 m/s", "What is uncertain where"):
        assert wanted in page
    pictures = {path.stem for path in (tmp_path / "figures").glob("*.png")}
    assert pictures == {"coverage", "residuals", "uncertainty", "errors"}
