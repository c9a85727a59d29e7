"""Writes measured figures from where they are kept into README.md and the pages of docs/.

A page has the place of a table between two lines:

    <!-- from FILE: NAME -->
    <!-- end -->

What lies between the lines is replaced. `FILE` is one of

* `results.json`: docs/results.json, the campaigns of `proxops reproduce`. `NAME` is a campaign, or
  `bodies` (all campaigns at bodies that the policy never saw), `headline` (the most telling line
  of each) or `paper` (the paper's figures and ours). A campaign that is not there is said not to
  be flown.
* `measured.json`: docs/measured.json, what other commands measured; `NAME` is an entry there.
* `benchmark`: the rows in docs/benchmark; `NAME` is a track.
* `benchmarks/results.json`: what `make bench` measured; `NAME` is `speed`.

    python docs/render_results.py            # renders all pages
    python docs/render_results.py FOLDER     # first takes FOLDER/results.json of proxops reproduce
"""

from __future__ import annotations

import dataclasses as dc
import json
import re
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from proxops.studies.beyond import BODIES, all_campaigns
from proxops.studies.scoring import ScoreRow, load_row, load_track, row_table

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "docs" / "results.json"
MEASURED = ROOT / "docs" / "measured.json"
SPEED = ROOT / "benchmarks" / "results.json"
ROWS = ROOT / "docs" / "benchmark"
_PLACE = re.compile(
    r"(^<!-- from ([\w./]+): ([\w-]+) -->\n)(.*?)(^<!-- end -->$)", re.DOTALL | re.MULTILINE
)

Campaign = Mapping[str, Any]
Campaigns = Mapping[str, Campaign]


@dc.dataclass(frozen=True)
class Sources:
    """Everything that is measured."""

    results: Mapping[str, Any]
    """Content of docs/results.json."""
    measured: Mapping[str, Mapping[str, Any]]
    """Content of docs/measured.json."""
    speed: Sequence[Mapping[str, Any]]
    """Content of benchmarks/results.json."""
    rows: Sequence[ScoreRow]
    """Those of docs/benchmark."""


def load_sources() -> Sources:
    """Reads them all."""
    rows = [load_row(path) for path in sorted(ROWS.glob("*.json"))]
    contents = [json.loads(path.read_text()) for path in (RESULTS, MEASURED, SPEED)]
    return Sources(*contents, rows)


def pages() -> Iterator[Path]:
    """The pages that may have places for tables."""
    yield ROOT / "README.md"
    yield from sorted((ROOT / "docs").rglob("*.md"))


def rendered(text: str, sources: Sources) -> str:
    """A page's text with its tables as the sources have them.

    Raises:
      KeyError: there is no file or no table of a name.
    """

    def made(found: re.Match[str]) -> str:
        return f"{found[1]}{_MAKERS[found[2]](sources, found[3])}\n{found[5]}"

    return _PLACE.sub(made, text)


def own_text(text: str) -> str:
    """A page's text with blank lines in place of what is rendered."""
    return _PLACE.sub(lambda found: "\n" * found[0].count("\n"), text)


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


def _bodies(results: Mapping[str, Any]) -> str:
    """Bodies that the policy never saw: one line each, and their sum."""
    campaigns = results["campaigns"]
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
    bodies = [f"at-{name.replace(':', '-')}" for name in BODIES]
    missing = [name for name in bodies if name not in campaigns]
    told = [_table(head, [*lines, ["all", *sums, ""]])] if lines else []
    told += [_missing(results, missing)] if missing else []
    return "\n\n".join(told)


def _controllers(campaign: Campaign) -> str:
    """The controllers of one campaign, a line each."""
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
        for who, found in campaign["controllers"].items()
    ]
    head = [
        "", "success", "95 % interval", "shown with 90 % confidence (%)", "entries",
        "least clearance (km)", "end error, median (m)", "greatest", "Δv, median (m/s)",
        "Δv / MPC's", "policy's share (%)",
    ]  # fmt: skip
    command = f"`{campaign['command']}` (seed {campaign['seed']}, commit {campaign['commit']})"
    return f"{_table(head, lines)}\n\nFlown by {command}."


def _missing(results: Mapping[str, Any], names: Sequence[str]) -> str:
    commands = ", ".join(f"`proxops reproduce {name}`" for name in names)
    return f"Not flown with version {results['proxops_version']} yet: {commands}."


# World, campaign and controller of each line that the front has.
_HEADLINE = (
    ("after the survey of the body, drawn anew for each flight", "flagship", "hybrid, assured"),
    ("before the survey, drawn from wider dispersions", "before-survey", "hybrid, assured"),
    ("as believed, Kleopatra", "navigation", "mpc"),
    ("as believed, Kleopatra", "navigation", "policy"),
    ("as believed, Kleopatra", "navigation", "hybrid"),
    ("as believed, Kleopatra", "navigation", "hybrid, adaptive"),
    ("as believed, Kleopatra", "navigation", "paper's recipe"),
)


def _headline(results: Mapping[str, Any]) -> str:
    """The most telling line of each campaign, and the sum over bodies."""
    campaigns = results["campaigns"]
    lines = []
    for world, name, who in _HEADLINE:
        found = campaigns.get(name, {"controllers": {}})["controllers"].get(who)
        if found is not None:
            entries = str(found["keep_out_violations"])
            ratio = _number(found, "expert_delta_v_ratio", ".3f")
            lines.append([world, who, _successes(found), _interval(found), entries, ratio])
    bodies = [each for name, each in campaigns.items() if name.startswith("at-")]
    for who in ("policy", "hybrid, assured"):
        flown = [each["controllers"][who] for each in bodies if who in each["controllers"]]
        if flown:
            world = f"as believed, {len(flown)} bodies that the policy never saw"
            good = sum(round(each["success_rate"] * each["transits"]) for each in flown)
            transits = sum(each["transits"] for each in flown)
            entries = sum(each["keep_out_violations"] for each in flown)
            lines.append([world, who, f"{good} of {transits}", "", str(entries), ""])
    head = ["world", "controller", "success", "95 % interval", "entries", "Δv / MPC's"]
    told = [_table(head, lines)] if lines else []
    missing = [name for name in dict.fromkeys(each[1] for each in _HEADLINE)
               if name not in campaigns]  # fmt: skip
    if missing:
        told.append(_missing(results, missing))
    return "\n\n".join(told)


def _paper(results: Mapping[str, Any]) -> str:
    """The paper's figures, and ours."""
    if results["paper"] is None:
        return _missing(results, ["paper"])
    lines = [[line[key] for key in ("what", "paper", "ours")]
             for line in results["paper"]["paper_and_ours"]]  # fmt: skip
    return _table(["", "paper", "ours"], lines)


def _of_campaigns(sources: Sources, name: str) -> str:
    campaigns = sources.results["campaigns"]
    if name == "headline":
        return _headline(sources.results)
    if name == "paper":
        return _paper(sources.results)
    if name == "bodies":
        return _bodies(sources.results)
    if name not in {each.name for each in all_campaigns()}:
        raise KeyError(name)
    if name not in campaigns:
        return _missing(sources.results, [name])
    return _controllers(campaigns[name])


def _of_measured(sources: Sources, name: str) -> str:
    """An entry of docs/measured.json: its table, and where it is from."""
    entry = sources.measured[name]
    text = _table(entry["columns"], entry["rows"])
    commands = ", ".join(f"`{command}`" for command in entry["commands"])
    commands = commands or "a program that was not kept"
    told = [f"recorded with version {entry['version']}"]
    told += [] if entry["machine"] is None else [entry["machine"]]
    return f"{text}\n\nMeasured by {commands} ({', '.join(told)})."


def _of_benchmark(sources: Sources, name: str) -> str:
    """The rows of a track."""
    rows = [row for row in sources.rows if row.track == name]
    head, *lines = row_table(load_track(name), rows)
    return _table(head, lines)


def _of_speed(sources: Sources, name: str) -> str:
    """What `make bench` measured, a column for each version and machine."""
    if name != "speed":
        raise KeyError(name)
    entries = sources.speed
    names = dict.fromkeys(name for entry in entries for name in entry["figures"])
    head = ["", *(f"{entry['version']}, {entry['machine']}" for entry in entries)]
    lines = [[each, *(f"{entry['figures'].get(each, '–')}" for entry in entries)] for each in names]
    packages = ", ".join(f"{each} {found}" for each, found in entries[-1]["packages"].items())
    return f"{_table(head, lines)}\n\nPackages of the last column: {packages}."


_MAKERS: Mapping[str, Callable[[Sources, str], str]] = {
    "results.json": _of_campaigns,
    "measured.json": _of_measured,
    "benchmark": _of_benchmark,
    "benchmarks/results.json": _of_speed,
}


def main() -> None:
    """Renders all pages, after it has taken the results of a folder if one is named."""
    if len(sys.argv) > 1:
        take(Path(sys.argv[1]))
    sources = load_sources()
    for page in pages():
        text = page.read_text()
        new = rendered(text, sources)
        if new != text:
            page.write_text(new)


if __name__ == "__main__":
    main()
