"""Writes measured figures from where they are kept into README.md and the pages of docs/.

A page has the place of a table between two lines:

    <!-- from FILE: NAME -->
    <!-- end -->

What lies between the lines is replaced. `FILE` is one of

* `results.json`: docs/results.json, the campaigns of `proxops reproduce`. `NAME` is a campaign, or
  `bodies` (all campaigns at bodies that the policy never saw), `front` (the paper beside us in five
  lines), `headline` (the most telling line of each), `steps` (how long controllers compute),
  `versions` (by what they were flown), `paper` (the paper's figures and ours) or
  `paper-controllers` (who flew in the paper's setting). Of a campaign that is not there, the page
  says that it was not flown.
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
from importlib import metadata
from pathlib import Path
from typing import Any

from proxops.studies.campaigns import BODIES, PAPER_RECIPE, all_campaigns, campaign_name
from proxops.studies.figures import Result, exact_interval, results_from_json
from proxops.studies.scoring import ScoreRow, load_row, load_track, row_table
from proxops.systems.common import write_json, write_whole
from proxops.training.reports import DASH, interval_text, number_text

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "docs" / "results.json"
MEASURED = ROOT / "docs" / "measured.json"
SPEED = ROOT / "benchmarks" / "results.json"
ROWS = ROOT / "docs" / "benchmark"
_PLACE = re.compile(
    r"(^<!-- from ([\w./]+): ([\w-]+) -->\n)(.*?)(^<!-- end -->$)", re.DOTALL | re.MULTILINE
)

# Those that move the last bits of a flight.
_PACKAGES = ("drake", "numpy", "scipy", "numba", "embreex")

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


def take(folder: Path) -> None:
    """Copies the results of `proxops reproduce`, with this repository's commit and its packages.

    Campaigns of the same version that the folder does not have are kept, each with its own commit.
    Campaigns that were flown on other transits than the documentation tells of end the program.
    """
    content = json.loads((folder / "results.json").read_text())
    check_flown(content["campaigns"])
    known = json.loads(RESULTS.read_text())
    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"],
        cwd=ROOT,
        check=True,
        capture_output=True,
        text=True,
    ).stdout.strip()
    packages = {name: metadata.version(name) for name in _PACKAGES}
    taken = {**merged(known, content, commit), "packages": packages}
    write_json(RESULTS, taken, indent=1)


def check_flown(campaigns: Campaigns) -> None:
    """Ends the program if a campaign flew other transits than those of its definition."""
    for each in all_campaigns():
        for who, found in campaigns.get(each.name, {"controllers": {}})["controllers"].items():
            flown = campaigns[each.name]["seed"], found["transits"] + found["unflyable"]
            if flown != (each.seed, each.transits):
                raise SystemExit(
                    f"{each.name}, {who}: {flown[1]} transits of seed {flown[0]}, not "
                    f"{each.transits} of seed {each.seed}: run proxops reproduce {each.name} "
                    "without --quick, --transits and --seed"
                )


def merged(known: Mapping[str, Any], content: Mapping[str, Any], commit: str) -> Mapping[str, Any]:
    """Results with those of another run in them; each campaign has the commit that it was taken at.

    Campaigns of another version are left out: one table must not mix versions. The paper's tables
    are apart, and say by which version they are.
    """
    version = content["proxops_version"]
    campaigns = dict(known["campaigns"] if known["proxops_version"] == version else {})
    for name, each in content["campaigns"].items():
        before = campaigns.get(name)
        if before is None or before != {"commit": before["commit"], **each}:
            campaigns[name] = {"commit": commit, **each}
    return {
        "proxops_version": version,
        "paper": content["paper"] or known["paper"],
        "campaigns": {name: campaigns[name] for name in sorted(campaigns, key=_place)},
    }


def _place(name: str) -> tuple[int, list[int], str]:
    """Where a campaign stands: bodies last, by their numbers."""
    numbers = [int(each) for each in re.findall(r"\d+", name)]
    return int(bool(numbers)), numbers, name


# --- tables ---------------------------------------------------------------------------------------


def _results(campaigns: Campaigns, name: str) -> dict[str, Result]:
    """The results of a campaign by controller; none where it was not flown."""
    return results_from_json(campaigns[name]["controllers"]) if name in campaigns else {}


def _counts(*flown: Result) -> tuple[int, int]:
    """Of all flights of some controllers, how many succeed, and how many there are."""
    return sum(each.successes for each in flown), sum(each.transits for each in flown)


def _successes(*flown: Result) -> str:
    """Of all flights of some controllers, how many succeed."""
    return "{} of {}".format(*_counts(*flown))


def _entries(*flown: Result) -> str:
    """How often flights of some controllers enter the keep-out."""
    return str(sum(each.keep_out_violations for each in flown))


def _fuel(result: Result) -> str:
    """Δv over the MPC's."""
    return number_text(result.expert_delta_v_ratio, ".3f")


def _at_bodies(campaigns: Campaigns) -> dict[str, dict[str, Result]]:
    """The results of the campaigns at bodies that the policy never saw."""
    return {name: _results(campaigns, name) for name in campaigns if name.startswith("at-")}


def _of(who: str, flown: Mapping[str, Mapping[str, Result]]) -> list[Result]:
    """The results of a controller, from the campaigns that it did not refuse."""
    return [results[who] for results in flown.values() if who in results]


def _interval(*flown: Result) -> str:
    """The exact interval of 95 % of the probability of success."""
    return interval_text(exact_interval(*_counts(*flown)), " to ")


def _digits(value: float | None, digits: int, scale: float = 1.0) -> str:
    """A figure with this number of digits: bodies differ in size by a factor of thousands."""
    small = value is not None and abs(scale * value) < 10**digits
    return number_text(value, f".{digits}g" if small else ",.0f", scale)


def _table(head: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    rule = ["---", *["---:"] * (len(head) - 1)]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (head, rule, *lines))


# Controllers that are shown at bodies that the policy never saw.
_SHOWN = ("policy", "hybrid", "hybrid, assured")


def _bodies(results: Mapping[str, Any]) -> str:
    """Bodies that the policy never saw: one line each, and their sum."""
    flown, lines = _at_bodies(results["campaigns"]), []
    for name, results_there in flown.items():
        cells = [name.removeprefix("at-").replace("-", ":")]
        for who in _SHOWN:
            found = results_there.get(who)
            cells += (
                ["refused", "", ""]
                if found is None
                else [_successes(found), _entries(found), _fuel(found)]
            )
        lines.append([*cells, _successes(results_there["mpc"])])
    sums = [cell for who in _SHOWN
            for cell in (_successes(*_of(who, flown)), _entries(*_of(who, flown)), "")]  # fmt: skip
    head = [
        "body", *(each for who in _SHOWN for each in (who, "entries", "Δv / MPC's")), "MPC",
    ]  # fmt: skip
    missing = [name for body in BODIES if (name := campaign_name(body)) not in flown]
    told = [_table(head, [*lines, ["all", *sums, ""]]), _intervals(flown)] if lines else []
    told += [_missing(results, missing)] if missing else []
    return "\n\n".join(told)


def _intervals(flown: Mapping[str, Mapping[str, Result]]) -> str:
    """What the successes that are shown say of the probability of success."""
    shown = [found for who in (*_SHOWN, "mpc") for found in _of(who, flown)]
    known = {_counts(found): f"{_successes(found)}: {_interval(found)}" for found in shown}
    return f"Exact 95 % intervals: {'; '.join(known[each] for each in sorted(known))}."


# What moves an outcome, in words.
_OUTCOMES = {
    "failure": "failures",
    "terminal_position_error_m": "end error",
    "delta_v_m_s": "Δv",
}


def _drivers(results: Mapping[str, Result]) -> str:
    """What drives the outcomes of a dispersed campaign."""
    told = [
        f"{_OUTCOMES[output]} of {who}: {', '.join(f'`{each}`' for each in names)}"
        for who, found in results.items()
        for output, names in (found.drivers or {}).items()
        if names
    ]
    return (
        "Quantities whose association with an outcome is told from chance, strongest first: "
        f"{'; '.join(told) if told else 'nothing that was drawn'}."
    )


def _percentile(result: Result) -> list[str]:
    """The 99th percentile of delta-v and its bound; from too few flights for a bound, neither."""
    if result.delta_v_99_m_s_bound is None:
        return [DASH, DASH]
    return [_digits(result.delta_v_99_m_s, 4), _digits(result.delta_v_99_m_s_bound, 4)]


def _controllers(campaign: Campaign) -> str:
    """The controllers of one campaign, a line each."""
    results = results_from_json(campaign["controllers"])
    lines = [
        [
            who,
            _successes(found),
            _interval(found),
            number_text(found.success_shown_90, ".2f", 100.0),
            _entries(found),
            _digits(found.min_clearance_m, 3, 1e-3),
            _digits(found.terminal_position_error_m_median, 3),
            _digits(found.terminal_position_error_m_max, 3),
            _digits(found.delta_v_m_s_median, 4),
            _digits(found.delta_v_m_s_max, 4),
            *_percentile(found),
            _fuel(found),
            number_text(found.policy_share, ".1f", 100.0),
        ]
        for who, found in results.items()
    ]
    head = [
        "", "success", "exact 95 % interval", "shown with 90 % confidence (%)", "entries",
        "least clearance (km)", "end error, median (m)", "greatest", "Δv, median (m/s)",
        "Δv, greatest (m/s)", "Δv99 (m/s)", "at most (m/s)", "Δv / MPC's", "policy's share (%)",
    ]  # fmt: skip
    command = (
        f"`{campaign['command']}` (seed {campaign['seed']}, taken at commit {campaign['commit']})"
    )
    ranked = any(found.drivers is not None for found in results.values())
    told = [_table(head, lines), *([_drivers(results)] if ranked else [])]
    return "\n\n".join([*told, f"Flown by {command}."])


# The campaigns that show how long controllers compute, and the navigation's step in their worlds,
# which `make bench` measures: all fly with the gravity table.
_STEPS = {
    "navigation": "a navigation step, following, gravity: table (ms)",
    "after-survey": "a navigation step, following, after_survey (ms)",
    "true-state": None,
}


def _latest(speed: Sequence[Mapping[str, Any]], key: str) -> float:
    """A figure of the last version that has it."""
    return next(each["figures"][key] for each in reversed(speed) if key in each["figures"])


def _steps(sources: Sources) -> str:
    """How long controllers compute a step, without the navigation and with it."""
    campaigns, lines = sources.results["campaigns"], []
    for name, key in _STEPS.items():
        if name not in campaigns:
            continue
        own = 0.0 if key is None else _latest(sources.speed, key)
        flown = _results(campaigns, name)
        steps = {who: each.control_ms_mean or 0.0 for who, each in flown.items()}
        expert = steps["mpc"]
        for who in ("mpc", "policy", "hybrid", "hybrid, adaptive"):
            step = steps[who]
            both = [DASH, DASH] if key is None else [
                f"{step + own:.2f}", f"{(expert + own) / (step + own):.1f}"
            ]  # fmt: skip
            lines.append([f"`{name}`: {who}", f"{step:.2f}", f"{expert / step:.1f}", *both])
    head = [
        "", "a step without the navigation (ms)", "the MPC's step over this one",
        "with it (ms)", "the MPC's step over this one",
    ]  # fmt: skip
    missing = [name for name in _STEPS if name not in campaigns]
    told = [_table(head, lines)] if lines else []
    told += [_missing(sources.results, missing)] if missing else []
    return "\n\n".join(told)


def _missing(results: Mapping[str, Any], names: Sequence[str]) -> str:
    commands = ", ".join(f"`proxops reproduce {name}`" for name in names)
    return f"Not flown with version {results['proxops_version']} yet: {commands}."


# World, campaign and controller of each line that the front has.
_HEADLINE = (
    ("after the survey of the body, drawn anew for each flight", "flagship", "hybrid, assured"),
    ("before the survey, drawn from wider dispersions", "before-survey", "hybrid, assured"),
    ("at first look, drawn from wider ones still", "first-look", "hybrid"),
    ("before the survey", "before-survey", "end-to-end pilot"),
    ("as believed, Kleopatra", "navigation", "mpc"),
    ("as believed, Kleopatra", "navigation", "policy"),
    ("as believed, Kleopatra", "navigation", "hybrid"),
    ("as believed, Kleopatra", "navigation", "hybrid, adaptive"),
    ("as believed, Kleopatra", "navigation", "end-to-end pilot"),
    ("as believed, Kleopatra", PAPER_RECIPE, "paper's recipe"),
)


def _headline(results: Mapping[str, Any]) -> str:
    """The most telling line of each campaign, and the sum over bodies."""
    campaigns = results["campaigns"]
    lines = []
    for world, name, who in _HEADLINE:
        found = _results(campaigns, name).get(who)
        if found is not None:
            cells = [_successes(found), _interval(found), _entries(found), _fuel(found)]
            lines.append([world, who, *cells])
    for who in _SHOWN:
        flown = _of(who, _at_bodies(campaigns))
        if flown:
            world = f"as believed, {len(flown)} bodies that the policy never saw"
            # No interval: transits of one number are alike at all bodies.
            lines.append([world, who, _successes(*flown), DASH, _entries(*flown), ""])
    head = ["world", "controller", "success", "exact 95 % interval", "entries", "Δv / MPC's"]
    shown = [_table(head, lines)] if lines else []
    missing = [name for name in dict.fromkeys(each[1] for each in _HEADLINE)
               if name not in campaigns and name != PAPER_RECIPE]  # fmt: skip
    if missing:
        shown.append(_missing(results, missing))
    return "\n\n".join(shown)


def _front(results: Mapping[str, Any]) -> str:
    """The paper beside us in five lines, for the first page."""
    found = _results(results["campaigns"], "flagship").get("hybrid, assured")
    if results["paper"] is None or found is None:
        return _missing(results, ["paper", "flagship"])
    told = {line["what"]: line for line in results["paper"]["paper_and_ours"]}
    lines = [
        [words, told[what]["paper"], told[what]["ours"]]
        for words, what in (
            ("a policy alone", "pure policy, ours"),
            ("hybrid: steps flown by the policy (%)", "hybrid, adaptive: flown by the policy (%)"),
            ("a step of the MPC, median (s)", "MPC, a step, median (s)"),
        )
    ]
    lines[0][1] = told["pure policy, paper's recipe"]["paper"]
    of_all = f"{_successes(found)} ({_interval(found)})"
    lines.append(["hybrid on lidar navigation, a drawn world for each flight", "–", of_all])
    missions = json.loads(MEASURED.read_text(encoding="utf-8"))["missions-alone"]["columns"][0]
    lines.append(["from first sight of Bennu to a touch, on a map of its own", "–", missions])
    return _table(["", "paper", "ours"], lines)


def _paper(results: Mapping[str, Any]) -> str:
    """The paper's figures, and ours."""
    if results["paper"] is None:
        return _missing(results, ["paper"])
    lines = [[line[key] for key in ("what", "paper", "ours")]
             for line in results["paper"]["paper_and_ours"]]  # fmt: skip
    return f"{_table(['', 'paper', 'ours'], lines)}\n\n{_paper_flown(results)}"


def _paper_controllers(results: Mapping[str, Any]) -> str:
    """Who flew in the paper's setting, and how."""
    if results["paper"] is None:
        return _missing(results, ["paper"])
    controllers = results["paper"]["controllers"]
    costs = {who: each["costs"] for who, each in controllers.items()}
    lines = [
        [
            who,
            _successes(found),
            _interval(found),
            _entries(found),
            _fuel(found),
            number_text(found.policy_share, ".1f", 100.0),
            number_text(costs[who].get("saved"), ".1f", 100.0),
            number_text(costs[who].get("step_s"), ".2f", 1e3),
        ]
        for who, found in results_from_json(controllers).items()
    ]
    head = [
        "", "success", "exact 95 % interval", "entries", "Δv / MPC's", "policy's share (%)",
        "solves saved (%)", "a step, mean (ms)",
    ]  # fmt: skip
    return f"{_table(head, lines)}\n\n{_paper_flown(results)}"


def _paper_flown(results: Mapping[str, Any]) -> str:
    paper = results["paper"]
    return (
        f"Flown by `proxops reproduce paper` (seed {paper['seed']}, version "
        f"{paper['proxops_version']})."
    )


def _versions(results: Mapping[str, Any]) -> str:
    """By what the campaigns were flown."""
    flown = {"proxops": results["proxops_version"], **results.get("packages", {})}
    return f"Flown by {', '.join(f'{name} {version}' for name, version in flown.items())}."


# Tables of several campaigns.
_TOGETHER: dict[str, Callable[[Mapping[str, Any]], str]] = {
    "front": _front,
    "headline": _headline,
    "bodies": _bodies,
    "paper": _paper,
    "paper-controllers": _paper_controllers,
    "versions": _versions,
}


def _of_campaigns(sources: Sources, name: str) -> str:
    campaigns = sources.results["campaigns"]
    if name in _TOGETHER:
        return _TOGETHER[name](sources.results)
    if name == "steps":
        return _steps(sources)
    if name not in {PAPER_RECIPE, *(each.name for each in all_campaigns())}:
        raise KeyError(name)
    if name not in campaigns:
        return _missing(sources.results, [name])
    return _controllers(campaigns[name])


def _of_measured(sources: Sources, name: str) -> str:
    """An entry of docs/measured.json: its table, and where it is from."""
    entry = sources.measured[name]
    text = _table(entry["columns"], entry["rows"])
    commands = ", ".join(f"`{command}`" for command in entry["commands"])
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
    lines = [
        [each, *(f"{entry['figures'].get(each, DASH)}" for entry in entries)] for each in names
    ]
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
            write_whole(page, lambda path, text=new: path.write_text(text))


if __name__ == "__main__":
    main()
