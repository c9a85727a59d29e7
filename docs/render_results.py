"""Writes what docs/results.json says into README.md and the pages of docs/.

A page has the place of a table between two lines:

    <!-- from results.json: NAME -->
    <!-- end -->

`NAME` is a function of `TABLES`. What lies between the lines is replaced.

    python docs/render_results.py            # renders all pages
    python docs/render_results.py FOLDER     # first takes FOLDER/results.json of proxops reproduce
"""

import json
import re
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "docs" / "results.json"
_PLACE = re.compile(
    r"(^<!-- from results\.json: ([\w-]+) -->\n)(.*?)(^<!-- end -->$)", re.DOTALL | re.MULTILINE
)

Campaign = Mapping[str, Any]
Campaigns = Mapping[str, Campaign]


def pages() -> Iterator[Path]:
    """The pages that may have places for tables."""
    yield ROOT / "README.md"
    yield from sorted((ROOT / "docs").rglob("*.md"))


def rendered(text: str, campaigns: Campaigns) -> str:
    """A page's text with its tables as the campaigns have them.

    Raises:
      KeyError: there is no table of a name, or a campaign that it needs was not flown.
    """
    return _PLACE.sub(lambda found: f"{found[1]}{TABLES[found[2]](campaigns)}\n{found[4]}", text)


def take(folder: Path) -> None:
    """Copies the results of `proxops reproduce`, with the commit of this repository.

    Campaigns of the same version that the folder does not have are kept, each with its own commit.
    """
    content = json.loads((folder / "results.json").read_text())
    known = json.loads(RESULTS.read_text())
    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"],
        cwd=ROOT,
        check=True,
        capture_output=True,
        text=True,
    ).stdout.strip()
    RESULTS.write_text(json.dumps(merged(known, content, commit), indent=1) + "\n")


def merged(known: Mapping[str, Any], content: Mapping[str, Any], commit: str) -> Mapping[str, Any]:
    """Results with those of another run in them; each campaign has the commit that it was taken at.

    Figures of another version are left out: one table must not mix versions.
    """
    version = content["proxops_version"]
    same = known["proxops_version"] == version
    new = {name: {"commit": commit, **each} for name, each in content["campaigns"].items()}
    campaigns = (known["campaigns"] if same else {}) | new
    paper = content["paper"] or (known["paper"] if same else None)
    return {
        "proxops_version": version,
        "paper": paper,
        "campaigns": {name: campaigns[name] for name in sorted(campaigns, key=_place)},
    }


def _place(name: str) -> tuple[int, list[int], str]:
    """Where a campaign stands: bodies last, by their numbers."""
    numbers = [int(each) for each in re.findall(r"\d+", name)]
    return int(bool(numbers)), numbers, name


# --- tables ---------------------------------------------------------------------------------------


def _successes(figures: Mapping[str, Any]) -> str:
    return f"{round(figures['success_rate'] * figures['transits'])} of {figures['transits']}"


def _interval(figures: Mapping[str, Any]) -> str:
    low, high = figures["success_rate_exact_interval"]
    return f"{100 * low:.1f} to {100 * high:.1f} %"


def _number(figures: Mapping[str, Any], name: str, form: str, scale: float = 1.0) -> str:
    value = figures.get(name)
    return "–" if value is None else format(scale * value, form)


def _table(head: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    rule = ["---", *["---:"] * (len(head) - 1)]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (head, rule, *lines))


def _bodies(campaigns: Campaigns) -> str:
    """Bodies that the policy never saw: one line each, and their sum."""
    lines = []
    names = ("policy", "hybrid, assured")
    total = {name: [0, 0, 0] for name in names}
    for name, campaign in campaigns.items():
        if not name.startswith("at-"):
            continue
        cells = [name.removeprefix("at-").replace("-", ":")]
        for who in names:
            found = campaign["controllers"].get(who)
            if found is None:
                cells += ["refused", "", ""]
                continue
            cells += [
                _successes(found),
                str(found["keep_out_violations"]),
                _number(found, "expert_delta_v_ratio", ".3f"),
            ]
            counted = (round(found["success_rate"] * found["transits"]), found["transits"],
                       found["keep_out_violations"])  # fmt: skip
            total[who] = [a + b for a, b in zip(total[who], counted, strict=True)]
        lines.append([*cells, _successes(campaign["controllers"]["mpc"])])
    sums = [
        cell
        for who in names
        for cell in (f"{total[who][0]} of {total[who][1]}", str(total[who][2]), "")
    ]
    head = [
        "body", "policy", "entries", "Δv / MPC's", "hybrid, assured", "entries", "Δv / MPC's",
        "MPC",
    ]  # fmt: skip
    return _table(head, [*lines, ["all", *sums, ""]])


def _controllers(name: str) -> Callable[[Campaigns], str]:
    """The controllers of one campaign, a line each."""

    def made(campaigns: Campaigns) -> str:
        lines = [
            [
                who,
                _successes(found),
                _interval(found),
                _number(found, "success_shown_90", ".2f", 100.0),
                str(found["keep_out_violations"]),
                _number(found, "min_clearance_m", ".2f", 1e-3),
                _number(found, "terminal_position_error_m_median", ".0f"),
                _number(found, "terminal_position_error_m_max", ",.0f"),
                _number(found, "delta_v_m_s_median", ".1f"),
                _number(found, "expert_delta_v_ratio", ".3f"),
                _number(found, "policy_share", ".1f", 100.0),
            ]
            for who, found in campaigns[name]["controllers"].items()
        ]
        head = [
            "", "success", "95 % interval", "shown with 90 % confidence (%)", "entries",
            "least clearance (km)", "end error, median (m)", "greatest", "Δv, median (m/s)",
            "Δv / MPC's", "policy's share (%)",
        ]  # fmt: skip
        return _table(head, lines)

    return made


TABLES: Mapping[str, Callable[[Campaigns], str]] = {
    "bodies": _bodies,
    **{
        name: _controllers(name)
        for name in ("navigation", "true-state", "flagship", "after-survey", "before-survey",
                     "first-look")
    },
}  # fmt: skip


def main() -> None:
    """Renders all pages, after it has taken the results of a folder if one is named."""
    if len(sys.argv) > 1:
        take(Path(sys.argv[1]))
    campaigns = json.loads(RESULTS.read_text())["campaigns"]
    for page in pages():
        text = page.read_text()
        new = rendered(text, campaigns)
        if new != text:
            page.write_text(new)


if __name__ == "__main__":
    main()
