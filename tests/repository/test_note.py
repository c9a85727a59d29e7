"""The technical note builds, with whatever campaigns were flown, and says what the files say."""

import copy
import json
from typing import Any

import typst
from pages import ROOT
from scripts import load_script
from whole_results import results_with_all

build = load_script("docs/note/build.py")
SOURCES = build.sources()


def pages(told: dict[str, Any]) -> int:
    made = typst.compile(
        build.SOURCE, root=ROOT, format="svg", sys_inputs=build.inputs(SOURCES | told)
    )
    return len(made) if isinstance(made, list) else 1


def words(told: dict[str, Any]) -> str:
    """What stands in the tables and their captions."""
    found = typst.query(build.SOURCE, "figure", root=ROOT, sys_inputs=build.inputs(SOURCES | told))
    return " ".join(_texts(json.loads(found)))


def _texts(element: Any) -> list[str]:
    if isinstance(element, dict):
        own = [element["text"]] if isinstance(element.get("text"), str) else []
        return own + [text for each in element.values() for text in _texts(each)]
    if isinstance(element, list):
        return [text for each in element for text in _texts(each)]
    return []


def test_it_builds_with_all_campaigns_and_without_any() -> None:
    nothing = copy.deepcopy(SOURCES["results"]) | {"campaigns": {}}
    for told in ({"results": results_with_all()}, {}, {"results": nothing, "rows": {}}):
        assert pages(told) >= 4


def test_its_figures_are_those_of_the_files() -> None:
    results = results_with_all()
    flown = results["campaigns"]["flagship"]["controllers"]["hybrid, assured"]
    flown |= {"transits": 7654, "success_rate": 7653 / 7654}
    text = words({"results": results})
    assert "7653" in text
    assert "7654" in text
    assert "proxops reproduce first-look" in text
    flights = SOURCES["rows"]["lidar-after-survey-pd"]
    good = sum(flight["success"] for flight in flights)
    assert f"{good} of {len(flights)}" in text.replace("  ", " ")
    nothing = results | {"campaigns": {}}
    assert "proxops reproduce flagship" not in words({"results": nothing})
