"""`run_survey`: flies a survey, estimates the map, and writes all files into a folder."""

from __future__ import annotations

import dataclasses as dc
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from proxops.diagrams.flight import users_function
from proxops.diagrams.scenario import (
    Body,
    Scenario,
    SurveyConfig,
    World,
    dump_scenario,
    survey_errors,
)
from proxops.diagrams.surveys.survey_files import Surveyed, write_survey
from proxops.diagrams.surveys.survey_flight import (
    Flying,
    SurveyFlight,
    around_of,
    survey_world,
)
from proxops.systems.assurance import AssuranceConfig
from proxops.systems.common import InputError, Progress, make_folder, part_of, silent, write_whole
from proxops.systems.mapping import (
    Around,
    Estimated,
    Expected,
    MapUncertainty,
    Returns,
    estimated,
    map_uncertainty,
)

_FLIGHT = "survey.npz"
_FIGURES = ("orbit_time", "delta_v", "clearance", "entries", "interventions", "hours", "collided")
_HISTORIES = ("rays", "times", "states", "attitudes", "forces")
# It flies so much longer, first and if its map is not good enough yet, over the most time; half of
# that if it is short, of so many hours.
_LONGER, _SHORT = 0.25, 24.0
# Share of the surface without which there is no map.
_LEAST_SEEN = 0.9

OWN_ESTIMATOR = "survey"
"""Name of the batch least squares."""
Estimator = Callable[[Returns, Around, Expected, Progress], tuple[Estimated, MapUncertainty]]
"""Makes a map of the returns of a survey's flight, with what is known before and how wrong that may
be; a `Progress` may be called with the share done."""


def run_survey(
    scenario: Scenario,
    body: Body,
    folder: Path,
    progress: Progress = silent,
    visits: Scenario | None = None,
    estimator: str = OWN_ESTIMATOR,
) -> Surveyed:
    """Flies a survey and writes its map, its body, its errors and its scenario of visits.

    A flight that the folder has already, of the same scenario, is not flown again.

    Args:
      scenario: with a survey as its task. body: as believed; of its mesh, only the extents count.
      folder: is made if need be. progress: is called with the share done.
      visits: what flies on the map later, such as a touch-and-go at the same body; None: transits
        of `scenario`.
      estimator: makes the map; or `MODULE:FUNCTION`, the user's: see `named_estimator`.

    Returns:
      What it found, and its errors against the truth, which nobody on board has.

    Raises:
      InputError: the survey cannot be flown or saw too little; or the folder cannot be written.
    """
    make_folder(folder)
    task, estimate = scenario.task, named_estimator(estimator)
    assert isinstance(task, SurveyConfig)
    flight, flying, times = _kept(folder / _FLIGHT, scenario, body), None, [0.0, 0.0]
    done, leg = 0.0, max(_LONGER * task.hours, 0.5 * min(task.hours, _SHORT))
    hours = leg
    try:
        while True:
            started = time.perf_counter()
            if flight is None:
                flying = flying or Flying(scenario, body)
                flight = flying.fly(hours, part_of(progress, done, done + 0.2))
                _keep(folder / _FLIGHT, flight, scenario)
            flown = time.perf_counter()
            expected = told_errors(scenario, flight.world, body)
            part = part_of(progress, done + 0.2, done + 0.3)
            found, uncertainty = estimate(flight.returns, flight.around, expected, part)
            times = [times[0] + flown - started, times[1] + time.perf_counter() - flown]
            if _is_enough(flight, found, uncertainty, task):
                check_seen(uncertainty.covered, flight.hours)
                break
            flight, hours = None, flight.hours + leg
            done = min(done + 0.3, 0.7)
    finally:
        if flying is not None:
            flying.close()
    progress(0.99, "writing")
    wall = {"flight_s": times[0], "estimation_s": times[1]}
    visits = visits or dc.replace(scenario, task=Scenario().task, assurance=AssuranceConfig())
    return write_survey(folder, scenario, visits, flight, found, uncertainty, wall)


def named_estimator(name: str) -> Estimator:
    """The estimator of a name: `survey`, the batch least squares, or `MODULE:FUNCTION`.

    FUNCTION is the user's, an `Estimator`. MODULE may also be in the working directory.

    Raises:
      InputError: the name is unknown, or the function cannot be imported.
    """
    if name == OWN_ESTIMATOR:
        return _batch
    if ":" not in name:
        raise InputError(
            f"{name!r} makes no map: use {OWN_ESTIMATOR}, or MODULE:FUNCTION for an estimator of "
            "your own"
        )
    wanted = "take (returns, around, expected, progress) and return (Estimated, MapUncertainty)"
    estimate = users_function(name, 4, wanted)

    def checked(*given) -> tuple[Estimated, MapUncertainty]:
        match estimate(*given):
            case (Estimated() as found, MapUncertainty() as uncertainty):
                return found, uncertainty
        raise InputError(f"{name} should {wanted}")

    return checked


def _batch(
    returns: Returns, around: Around, expected: Expected, progress: Progress
) -> tuple[Estimated, MapUncertainty]:
    found = estimated(returns, around, expected, progress)
    return found, map_uncertainty(found.survey, found.solution, found.returns)


def _is_enough(
    flight: SurveyFlight, found: Estimated, uncertainty: MapUncertainty, task: SurveyConfig
) -> bool:
    """Whether the map is good enough, by what the survey says itself, or the time is over."""
    enough = task.enough
    if enough is None or flight.hours >= task.hours:
        return True
    size = float(np.ptp(found.survey.vertices, axis=0).max())
    return (
        uncertainty.covered >= enough.covered
        and uncertainty.rms <= enough.deviation_of_size * size
        and uncertainty.gravity <= enough.gravity
    )


def check_seen(covered: float, hours: float) -> None:
    """Refuses a map of which much was never seen: what it says of the rest is wrong, too."""
    if covered < _LEAST_SEEN:
        raise InputError(
            f"the survey saw {covered:.0%} of the surface in {hours:.3g} h in orbit: set "
            "task.hours higher"
        )


def told_errors(scenario: Scenario, world: World, body: Body) -> Expected:
    """What the estimator expects, with the lidar's noise as it is known on the day."""
    noise = world.scenario.lidar.noise_std_m
    return survey_errors(scenario, body)._replace(noise=noise)


def _read_by(scenario: Scenario) -> str:
    """The scenario of a survey without what its flight does not read."""
    usual = Scenario()
    unread = ["mpc", "policy", "hybrid", "arrival", "navigation"]
    return dump_scenario(dc.replace(scenario, **{name: getattr(usual, name) for name in unread}))


def _keep(path: Path, flight: SurveyFlight, scenario: Scenario) -> None:
    arrays = {name: getattr(flight, name) for name in (*_FIGURES, *_HISTORIES)}
    arrays |= {f"returns_{name}": values for name, values in flight.returns._asdict().items()}
    text = np.array(_read_by(scenario))

    def write(name: Path) -> None:
        with name.open("wb") as file:
            np.savez_compressed(file, scenario=text, body=np.array(scenario.body), **arrays)

    write_whole(path, write)


def _kept(path: Path, scenario: Scenario, body: Body) -> SurveyFlight | None:
    """The flight in a file; None: there is none, or it is of another scenario.

    Raises:
      InputError: the file is damaged, or of another body.
    """
    if not path.is_file():
        return None
    try:
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        returns = Returns(**{name: arrays[f"returns_{name}"] for name in Returns._fields})
        figures = {name: arrays[name].item() for name in _FIGURES}
        figures |= {name: arrays[name] for name in _HISTORIES}
        text, name = str(arrays["scenario"]), str(arrays["body"])
    except Exception as error:  # Damaged files raise errors of many types.
        raise InputError(f"{path} is no whole log of a survey: remove it to fly anew") from error
    if name != scenario.body:
        raise InputError(
            f"{path} has frames of another body, {name}, not of {scenario.body}: give another "
            "folder"
        )
    if text != _read_by(scenario):
        return None
    return SurveyFlight(
        returns, around=around_of(scenario, body), world=survey_world(scenario, body), **figures
    )
