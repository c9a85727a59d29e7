"""The figures of README and docs come from the files that they name, and from nowhere else."""

import dataclasses
import json
from pathlib import Path

import pytest
from pages import ROOT
from scripts import load_script
from whole_results import results_with_all

from proxops.studies.campaigns import all_campaigns

render = load_script("docs/render_results.py")
SOURCES = render.load_sources()


def _place(file: str, name: str) -> str:
    return f"# A page\n\n<!-- from {file}: {name} -->\n<!-- end -->\n"


@pytest.mark.parametrize("page", list(render.pages()), ids=lambda page: str(page.relative_to(ROOT)))
def test_tables_are_those_of_the_sources(page: Path) -> None:
    text = page.read_text()
    assert render.rendered(text, SOURCES) == text, "run: python docs/render_results.py"


def test_a_changed_figure_is_found() -> None:
    page = _place("results.json", "bodies")
    sources = dataclasses.replace(SOURCES, results=results_with_all())
    before = render.rendered(page, sources)
    assert before.count("\n| ") > 3
    changed = json.loads(json.dumps(sources.results))
    changed["campaigns"]["at-22-0"]["controllers"]["policy"]["keep_out_violations"] += 7
    assert render.rendered(before, dataclasses.replace(sources, results=changed)) != before
    assert render.rendered(before, sources) == before


def test_every_campaign_can_be_shown_and_be_missing() -> None:
    names = ["headline", "bodies", "paper", "paper-controllers"]
    names += [each.name for each in all_campaigns()]
    page = "".join(_place("results.json", name) for name in names)
    empty = SOURCES.results | {"campaigns": {}, "paper": None}
    nothing = dataclasses.replace(SOURCES, results=empty)
    told = render.rendered(page, nothing)
    assert "| " not in told
    assert told.count("Not flown with version") == len(names)
    everything = dataclasses.replace(SOURCES, results=results_with_all())
    told = render.rendered(page, everything)
    assert "Not flown" not in told
    for each in all_campaigns():
        assert f"`proxops reproduce {each.name}`" in told


@pytest.mark.parametrize(
    ("file", "name"),
    [
        ("results.json", "flag-ship"),
        ("elsewhere.json", "speed"),
    ],
)
def test_unknown_places_are_refused(file: str, name: str) -> None:
    with pytest.raises(KeyError):
        render.rendered(_place(file, name), SOURCES)


@pytest.mark.parametrize("name", SOURCES.measured)
def test_measured_entries_are_whole(name: str) -> None:
    entry = SOURCES.measured[name]
    assert set(entry) == {"commands", "version", "commit", "date", "machine", "columns", "rows"}
    assert entry["rows"]
    assert {len(row) for row in entry["rows"]} == {len(entry["columns"])}


# --- results.json ---------------------------------------------------------------------------------


def test_results_of_two_runs_become_one() -> None:
    """Campaigns of the same version are kept, with their own commits; those of another are not.

    The paper's figures are kept until there are new ones.
    """
    old = {"commit": "old", "seed": 1}
    known = {
        "proxops_version": "1.2.0",
        "paper": {"figure": 1},
        "campaigns": {"at-20-10": old, "flagship": old, "navigation": old},
    }
    campaigns = {"at-20-9": {"seed": 1}, "flagship": {"seed": 2}, "navigation": {"seed": 1}}
    new = {"proxops_version": "1.2.0", "paper": None, "campaigns": campaigns}
    both = render.merged(known, new, "new")
    assert list(both["campaigns"]) == ["flagship", "navigation", "at-20-9", "at-20-10"]
    commits = [each["commit"] for each in both["campaigns"].values()]
    assert commits == ["new", "old", "new", "old"], "what did not change keeps its commit"
    assert both["paper"] == {"figure": 1}
    later = render.merged(known, new | {"proxops_version": "1.3.0"}, "new")
    assert list(later["campaigns"]) == ["flagship", "navigation", "at-20-9"]
    assert later["paper"] == {"figure": 1}, "it has a version of its own"


def test_flights_on_other_transits_are_not_taken() -> None:
    campaigns = results_with_all()["campaigns"]
    render.check_flown(campaigns)
    campaigns["flagship"]["controllers"]["hybrid, assured"]["transits"] = 2
    with pytest.raises(
        SystemExit, match=r"flagship, hybrid, assured: 2 transits of seed .* not 852"
    ):
        render.check_flown(campaigns)
