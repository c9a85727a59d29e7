"""The tables of README and docs that say they come from docs/results.json do."""

import importlib.util
import json
from types import ModuleType

import pytest
from pages import ROOT


def _module() -> ModuleType:
    path = ROOT / "docs" / "render_results.py"
    spec = importlib.util.spec_from_file_location("render_results", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


render = _module()
CAMPAIGNS = json.loads(render.RESULTS.read_text())["campaigns"]


@pytest.mark.parametrize("page", list(render.pages()), ids=lambda page: str(page.relative_to(ROOT)))
def test_tables_are_those_of_the_results(page) -> None:
    text = page.read_text()
    assert render.rendered(text, CAMPAIGNS) == text, "run: python docs/render_results.py"


def test_a_changed_figure_is_found() -> None:
    page = "# A page\n\n<!-- from results.json: bodies -->\n<!-- end -->\n"
    before = render.rendered(page, CAMPAIGNS)
    assert before.count("\n| ") > 3
    changed = json.loads(json.dumps(CAMPAIGNS))
    changed["at-20-0"]["controllers"]["policy"]["keep_out_violations"] += 7
    assert render.rendered(before, changed) != before
    assert render.rendered(before, CAMPAIGNS) == before


def test_results_of_two_runs_become_one() -> None:
    """Campaigns of the same version are kept, with their own commits; those of another are not."""
    known = {
        "proxops_version": "1.2.0",
        "paper": {"figure": 1},
        "campaigns": {"at-20-10": {"commit": "old"}, "flagship": {"commit": "old"}},
    }
    new = {"proxops_version": "1.2.0", "paper": None, "campaigns": {"at-20-9": {}, "flagship": {}}}
    both = render.merged(known, new, "new")
    assert list(both["campaigns"]) == ["flagship", "at-20-9", "at-20-10"]
    assert [each["commit"] for each in both["campaigns"].values()] == ["new", "new", "old"]
    assert both["paper"] == {"figure": 1}
    later = render.merged(known, new | {"proxops_version": "1.3.0"}, "new")
    assert list(later["campaigns"]) == ["flagship", "at-20-9"]
    assert later["paper"] is None


def test_no_path_of_a_machine_is_in_the_results() -> None:
    text = render.RESULTS.read_text()
    assert "/home" not in text
    assert "/tmp" not in text
