"""All of the evidence in one sequence: the paper, then flights on navigation, then other worlds."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

from proxops.diagrams.flight import Workers
from proxops.diagrams.scenario import Scenario, load_body
from proxops.studies.beyond.campaigns import (
    PAPER_RECIPE,
    PARTS,
    Campaign,
    all_campaigns,
    campaign_name,
)
from proxops.studies.beyond.flying import as_flown, entry, flown_campaign, fly_campaign
from proxops.studies.beyond.report import Story, story_sections
from proxops.studies.evaluation import successes_text
from proxops.studies.reproduction import Stage, Stages
from proxops.systems.common import InputError, write_json
from proxops.training.reports import write_report

PAPER = "paper"
"""Name of the part that reproduces the paper, and of its folder."""


def chosen_campaigns(names: Sequence[str], known: Sequence[Campaign]) -> list[Campaign]:
    """Picks campaigns by the names of parts or their own; without names, all of them.

    Raises:
      InputError: a name is neither a part nor a campaign, or of a campaign that can't be flown yet.
    """
    for name in names:
        if name == PAPER_RECIPE and all(name != each.name for each in known):
            raise InputError(
                f"{name} flies the policy that the paper's recipe gives, and none was trained in "
                f"this folder by this version: train it first: proxops reproduce {PAPER}"
            )
        if name not in (PAPER, *PARTS) and all(name != each.name for each in known):
            raise InputError(
                f"there is no {name!r}: name {', '.join((PAPER, *PARTS))}, or one of the campaigns "
                f"{', '.join(each.name for each in known)}"
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

    Raises:
      InputError: see `fly_campaign`.
    """
    stages = Stages(out, tell)
    flown: dict[str, Stage] = {}
    others: list[str] = []
    for each in known:
        if stages.latest(each.name) is None:
            continue
        stage = flown_campaign(stages, each, scenario, out / "bodies")
        if stage is None:
            others.append(each.name)
        else:
            flown[each.name] = stage
    content = _write(out, known, flown, others, scenario, command)
    for each in wanted:
        flown[each.name] = fly_campaign(stages, each, scenario, out / "bodies", workers)
        content = _write(out, known, flown, others, scenario, command)
    return content


def success_lines(content: Mapping[str, Any]) -> list[tuple[str, str]]:
    """A line for each controller of each campaign in what results.json holds: name and success."""
    return [
        (f"{campaign['title']}: {name}", successes_text(figures))
        for campaign in content["campaigns"].values()
        for name, figures in campaign["controllers"].items()
        if figures["transits"]
    ]


def _write(
    out: Path,
    known: Sequence[Campaign],
    flown: Mapping[str, Stage],
    others: Sequence[str],
    scenario: Scenario,
    command: str,
) -> dict[str, Any]:
    """Writes the report in all its forms; returns what results.json holds.

    Args:
      others: names of campaigns that were flown with other settings, before.
    """
    record = out / PAPER / "report.json"
    paper = json.loads(record.read_text()) if record.is_file() else None
    if paper is not None and paper["proxops_version"] != metadata.version("proxops"):
        paper = None
    told = [
        (as_flown(each, flown[each.name]), flown[each.name]) for each in known if each.name in flown
    ]
    left = [each.name for each in known if each.name not in flown]
    missing = [name for name in left if name not in others]
    others = [name for name in left if name in others]
    story = Story(command, told, missing, others, paper, f"{PAPER}/report.html", scenario.arrival)
    write_report(out, "Close to an asteroid, and nobody on board sees the truth",
                 story_sections(story))  # fmt: skip
    content = {
        "proxops_version": metadata.version("proxops"),
        "paper": paper,
        "campaigns": {each.name: entry(each, stage) for each, stage in told},
    }
    write_json(out / "results.json", content, indent=1)
    return content
