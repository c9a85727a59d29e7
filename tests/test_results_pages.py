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


def test_no_path_of_a_machine_is_in_the_results() -> None:
    text = render.RESULTS.read_text()
    assert "/home" not in text
    assert "/tmp" not in text
