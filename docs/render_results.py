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

from proxops.studies.beyond import BODIES, all_campaigns, campaign_name
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
    campaigns = dict(known["campaigns"] if same else {})
    for name, each in content["campaigns"].items():
        before = campaigns.get(name)
        if before is None or before != {"commit": before["commit"], **each}:
            campaigns[name] = {"commit": commit, **each}
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


def _successes(*flown: Mapping[str, Any]) -> str:
    """Of all flights of some controllers, how many succeed."""
    good = sum(round(each["success_rate"] * each["transits"]) for each in flown)
    return f"{good} of {sum(each['transits'] for each in flown)}"


def _entries(*flown: Mapping[str, Any]) -> str:
    """How many flights of some controllers enter the keep-out."""
    return str(sum(each["keep_out_violations"] for each in flown))


def _at_bodies(campaigns: Campaigns) -> dict[str, Campaign]:
    """The campaigns at bodies that the policy never saw."""
    names = {campaign_name(body) for body in BODIES}
    return {name: each for name, each in campaigns.items() if name in names}


def _of(who: str, campaigns: Campaigns) -> list[Mapping[str, Any]]:
    """The figures of a controller, from the campaigns that it did not refuse."""
    return [each["controllers"][who] for each in campaigns.values() if who in each["controllers"]]


def _interval(figures: Mapping[str, Any]) -> str:
    low, high = figures["success_rate_exact_interval"]
    return f"{100 * low:.1f} to {100 * high:.1f} %"


def _number(figures: Mapping[str, Any], name: str, form: str, scale: float = 1.0) -> str:
    value = figures.get(name)
    return "–" if value is None else format(scale * value, form)


def _table(head: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    rule = ["---", *["---:"] * (len(head) - 1)]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (head, rule, *lines))


# Controllers that are shown at bodies that the policy never saw.
_SHOWN = ("policy", "hybrid", "hybrid, assured")


def _bodies(results: Mapping[str, Any]) -> str:
    """Bodies that the policy never saw: one line each, and their sum."""
    flown, lines = _at_bodies(results["campaigns"]), []
    for name, campaign in flown.items():
        cells = [name.removeprefix("at-").replace("-", ":")]
        for who in _SHOWN:
            found = campaign["controllers"].get(who)
            if found is None:
                cells += ["refused", "", ""]
            else:
                ratio = _number(found, "expert_delta_v_ratio", ".3f")
                cells += [_successes(found), _entries(found), ratio]
        lines.append([*cells, _successes(campaign["controllers"]["mpc"])])
    sums = [cell for who in _SHOWN
            for cell in (_successes(*_of(who, flown)), _entries(*_of(who, flown)), "")]  # fmt: skip
    head = [
        "body", *(each for who in _SHOWN for each in (who, "entries", "Δv / MPC's")), "MPC",
    ]  # fmt: skip
    bodies = [f"at-{name.replace(':', '-')}" for name in BODIES]
    missing = [name for name in bodies if name not in flown]
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
            _entries(found),
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
    command = (
        f"`{campaign['command']}` (seed {campaign['seed']}, taken at commit {campaign['commit']})"
    )
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
            ratio = _number(found, "expert_delta_v_ratio", ".3f")
            lines.append([world, who, _successes(found), _interval(found), _entries(found), ratio])
    for who in _SHOWN:
        flown = _of(who, _at_bodies(campaigns))
        if flown:
            world = f"as believed, {len(flown)} bodies that the policy never saw"
            lines.append([world, who, _successes(*flown), "", _entries(*flown), ""])
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
