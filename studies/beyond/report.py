"""The report: what was asked, what the paper showed, where that broke, and what holds now."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import metadata
from typing import Any

from proxops.diagrams.scenario import ArrivalConfig
from proxops.studies.beyond.campaigns import (
    FLAGSHIP,
    PAPER_POLICY,
    PAPER_RECIPE,
    PILOT,
    Campaign,
)
from proxops.studies.evaluation import (
    arrival_text,
    driver_sections,
    figure_rows,
    successes_text,
)
from proxops.studies.reproduction import Stage
from proxops.training.reports import Block, Link, Section, Table, Text, interval_text, number_text

Flown = Sequence[tuple[Campaign, Stage]]


@dataclass(frozen=True)
class Story:
    """Everything that the report is made from."""

    command: str
    flown: Flown
    """The campaigns that have ended, as they were flown, in the order in which they are told."""
    missing: Sequence[str]
    """Names of campaigns that have not been flown."""
    others: Sequence[str]
    """Names of campaigns that were flown with other settings than these."""
    paper: Mapping[str, Any] | None
    """The content of the report.json of the paper's reproduction, if it was run."""
    paper_page: str
    """Its report, relative to the folder of this one."""
    arrival: ArrivalConfig


def story_sections(story: Story) -> list[Section]:
    """Makes the report, which `write_report` writes."""
    return [
        _asked(story),
        _paper(story),
        Section("Failure modes of the baseline", [Text(_broke(story))]),
        _holds(story.flown),
        *(_campaign(each, stage) for each, stage in story.flown),
    ]


def _asked(story: Story) -> Section:
    arrival = story.arrival
    blocks: list[Block] = [
        Text(story.command, code=True),
        Text(
            "A spacecraft with weak thrusters is to go from one point to another close to an "
            f"asteroid, and arrive within {arrival_text(arrival)} of the goal by "
            f"{arrival.deadline_s:g} s, to stay there for {arrival.dwell_s:g} s. It must not enter "
            "the keep-out ellipsoid round the body. That is a success; at other bodies, lengths "
            "and times are in proportion. Each controller of a campaign flies the same transits, "
            "on which nothing was trained. Intervals of 95 % are Wilson's, unless they are called "
            f"exact (Clopper and Pearson's). proxops {metadata.version('proxops')}."
        ),
        Table(
            ["campaign", "flights of each controller", "folder", "wall time (s)"],
            [
                [each.name, str(each.transits), stage.folder.name, f"{stage.wall_s:.0f}"]
                for each, stage in story.flown
            ],
        ),
    ]
    if story.missing:
        blocks.append(Text(f"Not run: {', '.join(story.missing)}."))
    if story.others:
        names = ", ".join(story.others)
        blocks.append(Text(f"Flown with other settings, and so not shown: {names}."))
    return Section("Question", blocks)


def _paper(story: Story) -> Section:
    if story.paper is None:
        return Section("What the paper showed", [Text("Not run: proxops reproduce paper.")])
    lines = [[line[key] for key in ("what", "paper", "ours")]
             for line in story.paper["paper_and_ours"]]  # fmt: skip
    blocks: list[Block] = [
        Text(
            "An MPC that is told the true state flies the transits; a network that learned from "
            "its flights flies most of the steps of a hybrid, and the MPC checks it now and then."
        ),
        Table(["", "paper", "ours"], lines),
        Table(["all of it", ""], [["report", Link(story.paper_page, story.paper_page)]]),
    ]
    return Section("What the paper showed", blocks)


def _broke(story: Story) -> str:
    """Says what leaves the paper's world, and how often it still arrives."""
    told = [
        f"In the paper's world {who} succeeds in {successes_text(result)} transits"
        for who, result in _paper_controllers(story.paper)
    ]
    places = (
        (PAPER_RECIPE, "in a world that is as believed"),
        ("navigation", "in a world that is as believed"),
        ("after-survey", "after a survey that leaves errors"),
        ("before-survey", "before the survey"),
    )
    results = {each.name: stage.result["results"] for each, stage in story.flown}
    for name, place in places:
        for controller in (PAPER_POLICY, PILOT):
            if controller in results.get(name, {}):
                found = successes_text(results[name][controller])
                told.append(f"{place} the {controller} succeeds in {found}")
    if not told:
        return "Nothing of it was run."
    return (
        "The paper's network maps frames to force, and knows one body, which is exactly its map. "
        f"{'; '.join(told)}."
    )


def _paper_controllers(paper: Mapping[str, Any] | None) -> list[tuple[str, Mapping[str, Any]]]:
    controllers = {} if paper is None else paper["controllers"]
    names = {"policy, paper's recipe": "the paper's recipe", "policy": "our policy"}
    return [(text, controllers[name]) for name, text in names.items() if name in controllers]


def _holds(flown: Flown) -> Section:
    lines = []
    for each, stage in flown:
        for name, result in stage.result["results"].items():
            lines.append(
                [
                    f"{each.title}: {name}",
                    successes_text(result),
                    interval_text(result["success_rate_exact_interval"]),
                    str(result["keep_out_violations"]),
                    number_text(result.get("expert_delta_v_ratio"), ".3f"),
                    f"proxops reproduce {each.name}",
                ]
            )
    head = ["", "success", "95 %, exact", "violations", "Δv / MPC's", "command for it alone"]
    return Section("Results", [Table(head, lines)])


def _campaign(campaign: Campaign, stage: Stage) -> Section:
    results = stage.result["results"]
    arrival = ArrivalConfig(**stage.result["arrival"])
    lines = [[label, *cells] for label, cells in figure_rows(results, arrival)]
    blocks: list[Block] = [
        Text(f"proxops reproduce {campaign.name}", code=True),
        Text(
            f"{campaign.told} Seed {campaign.seed}; {stage.result['body']}"
            + (f"; worlds are drawn from {campaign.dispersions}." if campaign.dispersions else ".")
        ),
        Table(["", *results], lines),
    ]
    blocks += [
        Text(f"{name} refuses to fly: {reason}.")
        for name, reason in stage.result["refused"].items()
    ]
    if campaign.name == FLAGSHIP:
        for section in driver_sections(results):
            blocks += section.blocks
    return Section(campaign.title, blocks)
