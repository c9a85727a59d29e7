"""Flies a campaign as a stage, and gives its entry of results.json."""

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
from proxops.diagrams.scenario import (
    ArrivalConfig,
    Body,
    Scenario,
    UnflyableWorldError,
    change_scenario,
    dump_scenario,
    load_body,
    load_scenario,
    with_site,
)
from proxops.studies.campaigns.describing import describe_flight
from proxops.studies.campaigns.stages import Stage, Stages
from proxops.studies.campaigns.table import Campaign
from proxops.studies.campaigns.tasks import fly_tasks, makes_a_map
from proxops.studies.campaigns.variants import fly_variants, variant_flights
from proxops.studies.figures import Results, aggregate_all, results_from_json
from proxops.systems.common import InputError, Progress


@dc.dataclass(frozen=True)
class FlownCampaign:
    """A campaign that has ended, and what it shows."""

    campaign: Campaign
    """With the dispersions with which it was flown."""
    stage: Stage
    results: Results
    refused: Mapping[str, str]
    """Why a controller refuses to fly there, by its name."""
    body: str
    """The body's name."""
    arrival: ArrivalConfig
    """The limits by which flights were judged."""

    @property
    def entry(self) -> dict[str, Any]:
        """Its entry of results.json: figures without the flights that they were made from."""
        campaign = self.campaign
        return {
            "part": campaign.part,
            "title": campaign.title,
            "told": campaign.told,
            "command": f"proxops reproduce {campaign.name}",
            "body": self.body,
            "dispersions": campaign.dispersions,
            "seed": campaign.seed,
            "transits": campaign.transits,
            "wall_s": round(self.stage.wall_s),
            "refused": self.refused,
            "controllers": {
                name: {key: _rounded(value) for key, value in result.figures.items()}
                for name, result in self.results.items()
            },
        }


def fly_campaign(
    stages: Stages, campaign: Campaign, scenario: Scenario, bodies: Path, workers: Workers
) -> FlownCampaign:
    """Flies what is left of a campaign.

    Args:
      stages: run it; it resumes after an interruption.
      scenario: the one that all campaigns share.
      bodies: a folder for the files of generated bodies.
      workers: fly.
    """
    shared = campaign_scenario(campaign, scenario, bodies)
    body = load_body(shared.body)

    def work(folder: Path, progress: Progress) -> dict[str, Any]:
        with workers.reporting(progress).kept() as fleet:
            flown = shared, campaign.seed, campaign.transits, folder
            if makes_a_map(shared):
                refused, rows = {}, fly_tasks(campaign.variants, *flown, workers=fleet)
            else:
                refused = _refused(campaign, shared, fleet)
                wanted = [each for each in campaign.variants if each.name not in refused]
                rows = fly_variants(wanted, *flown, describe=describe_flight, workers=fleet)
        return {
            "results": {name: dc.asdict(each) for name, each in aggregate_all(rows).items()},
            "refused": refused,
            "body": body.config.name,
            "arrival": dc.asdict(shared.arrival),
            "dispersions": shared.dispersions,
        }

    return _told(campaign, stages.run(campaign.name, _inputs(campaign, shared, body), work))


def flown_campaign(
    stages: Stages, campaign: Campaign, scenario: Scenario, bodies: Path
) -> FlownCampaign | None:
    """A campaign that was flown just as `fly_campaign` would fly it; None without one.

    The arguments are those of `fly_campaign`.

    Raises:
      InputError: the record of the stage is damaged, or a file that the flights need is missing.
    """
    shared = campaign_scenario(campaign, scenario, bodies)
    inputs = _inputs(campaign, shared, load_body(shared.body))
    stage = stages.ended(campaign.name, inputs)
    return None if stage is None else _told(campaign, stage)


def _told(campaign: Campaign, stage: Stage) -> FlownCampaign:
    found = stage.result
    return FlownCampaign(
        dc.replace(campaign, dispersions=found["dispersions"]),
        stage,
        results_from_json(found["results"]),
        found["refused"],
        found["body"],
        ArrivalConfig(**found["arrival"]),
    )


def _inputs(campaign: Campaign, shared: Scenario, body: Body) -> dict[str, Any]:
    """Everything that a campaign's flights depend on.

    Policies count by their content, and bodies by theirs, not by where they lie.
    """
    policy = dc.replace(shared.policy, bundle=None)
    return {
        "scenario": dump_scenario(dc.replace(shared, policy=policy, body="")),
        "variants": [
            {
                "name": each.name,
                "changes": dict(each.changes),
                "controller": str(provenance(each.applied_to(shared), body, each.controller)),
            }
            for each in campaign.variants
        ],
        "seed": campaign.seed,
        "transits": campaign.transits,
    }


def campaign_scenario(campaign: Campaign, scenario: Scenario, bodies: Path) -> Scenario:
    """The scenario that a campaign's controllers share; writes a generated body's files.

    At another body the spacecraft is in proportion to it, as `proxops shape` scales it.
    """
    # It imports matplotlib, which is slow, and each worker imports this module.
    from proxops.diagrams.new_body import scaled_scenario, write_generated_body

    if campaign.scenario is not None:
        own = dc.replace(load_scenario(campaign.scenario), log_ranges=scenario.log_ranges)
        own = change_scenario(own, campaign.changes)
        return with_site(own, load_body(own.body))
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


def _refused(campaign: Campaign, shared: Scenario, workers: Workers) -> dict[str, str]:
    """The reason of each controller that refuses to fly, by its name.

    The policy refuses bodies outside its family, and assurance errors that thrust can't hold.
    """
    first = {each.name: variant_flights(each, shared, campaign.seed, [0])[0]
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


def _rounded(value: Any) -> Any:
    """Six digits are more than any figure is known to."""
    if isinstance(value, float):
        return float(f"{value:.6g}")
    return [_rounded(each) for each in value] if isinstance(value, list | tuple) else value
