"""The campaigns that go beyond the paper: which are flown, and what report and results tell."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

from proxops.diagrams.flight import Workers
from proxops.diagrams.scenario import ArrivalConfig, Scenario, load_body
from proxops.studies.campaigns import (
    FLAGSHIP,
    MAPS,
    PAPER_POLICY,
    PAPER_RECIPE,
    PARTS,
    PILOT,
    Campaign,
    FlownCampaign,
    Stages,
    all_campaigns,
    campaign_name,
    flown_campaign,
    fly_campaign,
)
from proxops.studies.figures import arrival_text, results_from_json
from proxops.studies.report import driver_blocks, figure_blocks
from proxops.systems.common import InputError, write_json
from proxops.training.reports import (
    Block,
    Link,
    Section,
    Table,
    Text,
    interval_text,
    number_text,
    write_report,
)

PAPER = "paper"
"""Name of the part that reproduces the paper, and of its folder."""


def chosen_campaigns(names: Sequence[str], known: Sequence[Campaign]) -> list[Campaign]:
    """Picks campaigns by the names of parts or their own; without names, all of them.

    Raises:
      InputError: a name is neither a part nor a campaign, or of a campaign that can't be flown yet.
    """
    campaigns = [each.name for each in known]
    for name in names:
        if name == PAPER_RECIPE and name not in campaigns:
            raise InputError(
                f"{name} flies the policy that the paper's recipe gives, and none was trained in "
                f"this folder by this version: train it first: proxops reproduce {PAPER}"
            )
        if name not in (PAPER, *PARTS, *campaigns):
            raise InputError(
                f"there is no {name!r}: name {', '.join((PAPER, *PARTS))}, or one of the campaigns "
                f"{', '.join(campaigns)}"
            )
    return [each for each in known if not names or {each.name, each.part} & set(names)]


def own_bodies(folder: Path) -> list[Path]:
    """The bodies' files in a folder of the user's.

    Raises:
      InputError: there is none, one cannot be read, or two campaigns would have the same name.
    """
    paths = sorted([*folder.glob("*.yaml"), *folder.glob("*.yml")])
    if not paths:
        raise InputError(
            f"--bodies {folder} holds no body's YAML file; proxops shape FILE --body "
            f"{folder / 'NAME.yaml'} with --mass and --period writes one"
        )
    names = [each.name for each in all_campaigns(own_bodies=paths)]
    for path in paths:
        load_body(str(path))
        name = campaign_name(str(path))
        if names.count(name) > 1:
            raise InputError(f"{path}: another campaign is named {name}, too: rename the file")
    return paths


def fly_and_tell(
    known: Sequence[Campaign],
    wanted: Sequence[Campaign],
    scenario: Scenario,
    out: Path,
    *,
    command: str = "proxops reproduce",
    workers: Workers = Workers(),
    tell: Callable[[str, float, str], Any] | None = None,
) -> dict[str, Any]:
    """Flies what is left of some campaigns, and writes report.html, report.md and results.json.

    These tell of all campaigns that have ended in the folder, now or earlier with this version and
    the same settings, and of the paper's reproduction by this version, if it is in `out`/paper. Of
    campaigns that were flown with other settings they tell the names alone. They are written anew
    after each campaign.

    Args:
      known: all campaigns, in the order in which they are told.
      wanted: those of them that are flown; each is a stage that resumes.
      scenario: the one that all share.
      out: folder for everything.
      command: as it was typed, for the report.
      workers: fly; what they report goes to `tell`.
      tell: is called with the stage's name, the share of it that is done, and a text.

    Returns:
      What results.json holds.
    """
    stages, bodies = Stages(out, tell), out / "bodies"
    ended = [each for each in known if stages.latest(each.name) is not None]
    found = {each.name: flown_campaign(stages, each, scenario, bodies) for each in ended}

    def told() -> dict[str, Any]:
        flown = [each for campaign in known if (each := found.get(campaign.name)) is not None]
        others = [name for name, each in found.items() if each is None]
        missing = [each.name for each in known if each.name not in found]
        paper = _paper_record(out)
        sections = [
            Section("Question", _asked(command, scenario.arrival, flown, missing, others)),
            Section("What the paper showed", _paper(paper)),
            Section("Failure modes of the baseline", [Text(_broke(paper, flown))]),
            Section("Results", [_holds(flown)]),
            *(Section(each.campaign.title, _campaign(each)) for each in flown),
        ]
        write_report(out, "Close to an asteroid, and nobody on board sees the truth", sections)
        content = {
            "proxops_version": metadata.version("proxops"),
            "paper": paper,
            "campaigns": {each.campaign.name: each.entry for each in flown},
        }
        write_json(out / "results.json", content, indent=1)
        return content

    content = told()
    for each in wanted:
        found[each.name] = fly_campaign(stages, each, scenario, bodies, workers)
        content = told()
    return content


def success_lines(content: Mapping[str, Any]) -> list[tuple[str, str]]:
    """A line for each controller of each campaign in what results.json holds: name and success."""
    return [
        (f"{campaign['title']}: {name}", result.succeeded())
        for campaign in content["campaigns"].values()
        for name, result in results_from_json(campaign["controllers"]).items()
        if result.transits
    ]


def _paper_record(out: Path) -> dict[str, Any] | None:
    """The content of the report.json of the paper's reproduction, if this version ran it."""
    record = out / PAPER / "report.json"
    paper = json.loads(record.read_text()) if record.is_file() else {"proxops_version": None}
    return paper if paper["proxops_version"] == metadata.version("proxops") else None


# --- the report -----------------------------------------------------------------------------------


def _asked(
    command: str,
    arrival: ArrivalConfig,
    flown: Sequence[FlownCampaign],
    missing: Sequence[str],
    others: Sequence[str],
) -> list[Block]:
    """Says what the task is, and which campaigns are told.

    Args:
      missing: names of campaigns that have not been flown.
      others: names of campaigns that were flown with other settings than these.
    """
    lines = [
        [each.campaign.name, str(each.campaign.transits), each.stage.folder.name,
         f"{each.stage.wall_s:.0f}"]
        for each in flown
    ]  # fmt: skip
    blocks: list[Block] = [
        Text(command, code=True),
        Text(
            "A spacecraft with weak thrusters is to go from one point to another close to an "
            f"asteroid, and arrive within {arrival_text(arrival)} of the goal by "
            f"{arrival.deadline_s:g} s, to stay there for {arrival.dwell_s:g} s. It must not enter "
            "the keep-out ellipsoid round the body. That is a success; at other bodies, lengths "
            "and times are in proportion, and real missions, touches, maps and missions have "
            "limits of their own. Each controller of a campaign flies the same transits, "
            "on which nothing was trained. Intervals of 95 % are Wilson's, unless they are called "
            f"exact (Clopper and Pearson's). proxops {metadata.version('proxops')}."
        ),
        Table(["campaign", "flights of each controller", "folder", "wall time (s)"], lines),
    ]
    if missing:
        blocks.append(Text(f"Not run: {', '.join(missing)}."))
    if others:
        names = ", ".join(others)
        blocks.append(Text(f"Flown with other settings, and so not shown: {names}."))
    return blocks


def _paper(paper: Mapping[str, Any] | None) -> list[Block]:
    if paper is None:
        return [Text("Not run: proxops reproduce paper.")]
    page = f"{PAPER}/report.html"
    lines = [[line[key] for key in ("what", "paper", "ours")] for line in paper["paper_and_ours"]]
    return [
        Text(
            "An MPC that is told the true state flies the transits; a network that learned from "
            "its flights flies most of the steps of a hybrid, and the MPC checks it now and then."
        ),
        Table(["", "paper", "ours"], lines),
        Table(["all of it", ""], [["report", Link(page, page)]]),
    ]


def _broke(paper: Mapping[str, Any] | None, flown: Sequence[FlownCampaign]) -> str:
    """Says what leaves the paper's world, and how often it still arrives."""
    told = []
    papers = results_from_json({} if paper is None else paper["controllers"])
    for name, who in (("policy, paper's recipe", "the paper's recipe"), ("policy", "our policy")):
        if name in papers:
            found = papers[name].succeeded()
            told.append(f"In the paper's world {who} succeeds in {found} transits")
    results = {each.campaign.name: each.results for each in flown}
    for name, place in (
        (PAPER_RECIPE, "in a world that is as believed"),
        ("navigation", "in a world that is as believed"),
        ("after-survey", "after a survey that leaves errors"),
        ("before-survey", "before the survey"),
    ):
        for controller in (PAPER_POLICY, PILOT):
            if controller in results.get(name, {}):
                found = results[name][controller].succeeded()
                told.append(f"{place} the {controller} succeeds in {found}")
    if not told:
        return "Nothing of it was run."
    return (
        "The paper's network maps frames to force, and knows one body, which is exactly its map. "
        f"{'; '.join(told)}."
    )


def _holds(flown: Sequence[FlownCampaign]) -> Table:
    lines = [
        [
            f"{each.campaign.title}: {name}",
            result.succeeded(),
            interval_text(result.success_rate_exact_interval),
            number_text(result.keep_out_violations, ".0f"),
            number_text(result.expert_delta_v_ratio, ".3f"),
            f"proxops reproduce {each.campaign.name}",
        ]
        for each in flown
        for name, result in each.results.items()
    ]
    head = ["", "success", "95 %, exact", "violations", "Δv / MPC's", "command for it alone"]
    return Table(head, lines)


def _campaign(flown: FlownCampaign) -> list[Block]:
    campaign = flown.campaign
    arrival = None if campaign.part == MAPS else flown.arrival
    drawn = f"; worlds are drawn from {campaign.dispersions}." if campaign.dispersions else "."
    return [
        Text(f"proxops reproduce {campaign.name}", code=True),
        Text(f"{campaign.told} Seed {campaign.seed}; {flown.body}{drawn}"),
        *figure_blocks(flown.results, arrival),
        *(Text(f"{name} refuses to fly: {reason}.") for name, reason in flown.refused.items()),
        *(driver_blocks(flown.results) if campaign.name == FLAGSHIP else []),
    ]
