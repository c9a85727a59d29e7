"""Surveys: a body that is known as an ellipsoid becomes a map, a body file and a scenario.

Start with `run_survey`, which flies it, estimates, and writes all files into a folder; `Flying` is
its flight alone, and `run_mission` flies on from it to a touch. `survey_files` says what is
written. What flies and estimates sees no truth: only `visit.yaml`, under `truth`, and the figures
of `survey.json` hold it.
"""

from proxops.diagrams.surveys.mission import MissionFlown, begin_mission, run_mission, whole_log
from proxops.diagrams.surveys.survey_files import Surveyed
from proxops.diagrams.surveys.survey_flight import Flying, SurveyFlight, known_ellipsoid
from proxops.diagrams.surveys.survey_run import OWN_ESTIMATOR, named_estimator, run_survey

__all__ = [
    "OWN_ESTIMATOR",
    "Flying",
    "MissionFlown",
    "SurveyFlight",
    "Surveyed",
    "begin_mission",
    "known_ellipsoid",
    "named_estimator",
    "run_mission",
    "run_survey",
    "whole_log",
]
