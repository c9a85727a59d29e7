"""Flies a campaign as a stage, and makes its entry of results.json."""

from __future__ import annotations

import dataclasses as dc
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from proxops.diagrams.flight import (
    Flight,
    Workers,
    make_transit_diagram,
    named_controller,
    provenance,
)
from proxops.diagrams.new_body import scaled_scenario, write_generated_body
from proxops.diagrams.scenario import (
    Body,
    Scenario,
    UnflyableWorldError,
    change_scenario,
    dump_scenario,
    load_body,
)
from proxops.studies.beyond.campaigns import Campaign
from proxops.studies.evaluation import (
    aggregate_all,
    describe_flight,
    fly_variants,
    told_from_chance,
    variant_flights,
    without_flights,
)
from proxops.studies.reproduction import Stage, Stages
from proxops.systems.common import InputError, Progress


def fly_campaign(
    stages: Stages, campaign: Campaign, scenario: Scenario, bodies: Path, workers: Workers
) -> Stage:
    """Flies what is left of a campaign.

    Args:
      stages: run it; it resumes after an interruption.
      scenario: the one that all campaigns share.
      bodies: a folder for the files of generated bodies.
      workers: fly.

    Returns:
      The stage. Its result has `results`, the figures of each controller by its name with the rows
      of the flights, as `aggregate_all` makes them; `refused`, the reason of each controller that
      refuses to fly there; `body`, the body's name; `arrival`, the fields of the `ArrivalConfig` by
      which flights were judged; and `dispersions`, as they were flown.

    Raises:
      InputError: see `fly_variants`.
    """
    flown = campaign_scenario(campaign, scenario, bodies)
    body = load_body(flown.body)

    def work(folder: Path, progress: Progress) -> dict[str, Any]:
        with workers.reporting(progress).kept() as fleet:
            refused = _refused(campaign, flown, fleet)
            rows = fly_variants(
                [each for each in campaign.variants if each.name not in refused],
                flown, campaign.seed, campaign.transits, folder,
                describe=describe_flight, workers=fleet,
            )  # fmt: skip
        return {
            "results": aggregate_all(rows),
            "refused": refused,
            "body": body.config.name,
            "arrival": dc.asdict(flown.arrival),
            "dispersions": flown.dispersions,
        }

    return stages.run(campaign.name, _inputs(campaign, flown, body), work)


def flown_campaign(
    stages: Stages, campaign: Campaign, scenario: Scenario, bodies: Path
) -> Stage | None:
    """The stage of a campaign that was flown just as `fly_campaign` would fly it; None without one.

    The arguments are those of `fly_campaign`.

    Raises:
      InputError: the record of the stage is damaged, or a file that the flights need is missing.
    """
    flown = campaign_scenario(campaign, scenario, bodies)
    return stages.ended(campaign.name, _inputs(campaign, flown, load_body(flown.body)))


def as_flown(campaign: Campaign, stage: Stage) -> Campaign:
    """The campaign with the dispersions with which its stage was flown."""
    return dc.replace(campaign, dispersions=stage.result["dispersions"])


def _inputs(campaign: Campaign, flown: Scenario, body: Body) -> dict[str, Any]:
    """Everything that a campaign's flights depend on.

    Policies count by their content, and bodies by theirs, not by where they lie.
    """
    policy = dc.replace(flown.policy, bundle=None)
    return {
        "scenario": dump_scenario(dc.replace(flown, policy=policy, body="")),
        "variants": [
            {
                "name": each.name,
                "changes": dict(each.changes),
                "controller": str(provenance(each.applied_to(flown), body, each.controller)),
            }
            for each in campaign.variants
        ],
        "seed": campaign.seed,
        "transits": campaign.transits,
    }


def campaign_scenario(campaign: Campaign, scenario: Scenario, bodies: Path) -> Scenario:
    """The scenario that a campaign's controllers share; writes a generated body's files.

    At another body the spacecraft is in proportion to it, as `proxops shape` scales it.

    Raises:
      InputError: see `change_scenario`, `load_body` and `scaled_scenario`.
    """
    if campaign.body is None:
        return change_scenario(scenario, campaign.changes)
    path = Path(campaign.body)
    numbers = re.fullmatch(r"(\d+):(\d+)", campaign.body)
    if numbers is not None:
        folder = bodies / campaign.body.replace(":", "-")
        write_generated_body(folder, *map(int, numbers.groups()))
        path = folder / "body.yaml"
    scaled = scaled_scenario(load_body(str(path)), str(path.resolve()))
    scaled = dc.replace(scaled, log_ranges=scenario.log_ranges, gravity=scenario.gravity)
    return change_scenario(scaled, campaign.changes)


def _refused(campaign: Campaign, flown: Scenario, workers: Workers) -> dict[str, str]:
    """The reason of each controller that refuses to fly, by its name.

    The policy refuses bodies outside its family, and assurance errors that thrust can't hold.
    """
    first = {each.name: variant_flights(each, flown, campaign.seed, [0])[0]
             for each in campaign.variants}  # fmt: skip
    reasons = dict(workers.results(list(first.values()), _refusal))
    return {
        name: reason
        for name, flight in first.items()
        if (reason := reasons[flight.name]) is not None
    }


def _refusal(flight: Flight) -> str | None:
    scenario = dc.replace(flight.scenario, gravity="exact")
    body = load_body(scenario.body)
    try:
        make_transit_diagram(
            scenario, named_controller(flight.controller, scenario, body), body=body
        )
    except UnflyableWorldError:
        return None  # That is of this one world.
    except InputError as error:
        return str(error)
    return None


def entry(campaign: Campaign, stage: Stage) -> dict[str, Any]:
    """A campaign's entry of results.json: figures without the flights that they were made from.

    Where worlds were dispersed, `drivers` has, for each output, what drives it by more than chance.

    Args:
      campaign: as its stage was flown: see `as_flown`.
      stage: what `fly_campaign` gives.
    """
    results: Mapping[str, Mapping[str, Any]] = stage.result["results"]
    return {
        "part": campaign.part,
        "title": campaign.title,
        "told": campaign.told,
        "command": f"proxops reproduce {campaign.name}",
        "body": stage.result["body"],
        "dispersions": campaign.dispersions,
        "seed": campaign.seed,
        "transits": campaign.transits,
        "wall_s": round(stage.wall_s),
        "refused": stage.result["refused"],
        "controllers": {
            name: {key: _rounded(value) for key, value in without_flights(result).items()}
            | ({"drivers": _drivers(result["sensitivity"])} if "sensitivity" in result else {})
            for name, result in results.items()
        },
    }


def _drivers(sensitivity: Mapping[str, Any]) -> dict[str, list[str]]:
    return {output: told_from_chance(ranked) for output, ranked in sensitivity.items() if ranked}


def _rounded(value: Any) -> Any:
    """Six digits are more than any figure is known to."""
    if isinstance(value, float):
        return float(f"{value:.6g}")
    return [_rounded(each) for each in value] if isinstance(value, list | tuple) else value
