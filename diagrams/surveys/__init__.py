"""Surveys: a body that is known as an ellipsoid becomes a map, a body file and a scenario.

Start with `fly_survey`, which flies it, and `run_survey`, which also estimates and writes all files
into a folder. `survey_files` says what is written. What flies and estimates sees no truth: only
`visit.yaml`, under `truth`, and the figures of `survey.json` hold it.
"""

from proxops.diagrams.surveys.survey_flight import SurveyFlight, fly_survey
from proxops.diagrams.surveys.survey_run import run_survey

__all__ = ["SurveyFlight", "fly_survey", "run_survey"]
