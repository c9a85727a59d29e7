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


@pytest.mark.parametrize("page", render.pages(), ids=lambda page: str(page.relative_to(ROOT)))
def test_tables_are_those_of_the_results(page) -> None:
    text = page.read_text()
    assert render.rendered(text, CAMPAIGNS) == text, "run: python docs/render_results.py"


def test_a_changed_figure_is_found() -> None:
    (name,) = list(CAMPAIGNS)[:1]
    page = f"# A page\n\n<!-- from results.json: {name} -->\n<!-- end -->\n"
    render.TABLES[name]
    before = render.rendered(page, CAMPAIGNS)
    changed = json.loads(json.dumps(CAMPAIGNS))
    next(iter(changed[name]["controllers"].values()))["keep_out_violations"] = 77
    assert render.rendered(before, changed) != before
    assert render.rendered(before, CAMPAIGNS) == before
