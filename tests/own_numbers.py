"""Finds measured figures that a page has of its own, outside the places that are rendered.

The rule. Outside rendered places, code and links,

* a table with digits must be a specification: its head is in `SPECIFICATIONS`;
* a sentence may not have a count (`198 of 200`, `50/50`), a share in per cent, a time of computing
  (`1.5 ms`, `took 20 minutes`), a factor (`1.03 times`, `× real time`) or a small error (`3e-11`),
  unless the phrase is in `DEFINITIONS`.

Lengths, speeds and seconds are not looked for: most of them are settings. A figure of them that
was measured belongs into docs/measured.json all the same.
"""

import re
from collections.abc import Collection
from typing import NamedTuple

SPECIFICATIONS = {
    "| file | content |",
    "| port | | size | unit | what it is |",
    "| term | meaning |",
    "| key | what it does |",
    "| error | key | default |",
    "| symbol | what it is |",
    "| quantity | size | unit | varies |",
    "| phase | `state` | what happens with a frame |",
    "| gate | u and v agree if |",
    "| bound | of dispersions |",
    "| bound | what is between − and + this, at any time and in any manner |",
    "| step | it is |",
    "| kind | flight | share of `paper`, `full` |",
    "| in the paper | module | command |",
    "| file | how proxops reads it | protection |",
    "| file | what it has | opens in |",
    "| part | examples | loss |",
    # The words of docs/concepts.md, and what an environment of Gymnasium takes and gives.
    "| | |",
    "| | what it is |",
    "| | how often | how |",
    # Of the formulas of the paper's gate, which are computed by hand.
    "| angle between u and v | printed | right |",
    # The networks' sizes.
    "| part | prescribed | learned | learned numbers |",
    # What dispersions declare.
    "| | gravity | thrust | direction | mass | acceleration | surface | position | velocity |",
    # What others published, with references.
    "| mission or method | sensors | accuracy | over size |",
}
"""Heads of tables that hold settings, definitions or what others published."""

DEFINITIONS = {
    "docs/agreement.md": {"0.5 % of the thrust limit", "tolerance of 1e-13"},
    "docs/errata.md": {'"70 % flown by the policy"'},
    "docs/first_hour_gymnasium.md": {"A step takes 10 s"},
    "docs/how_to/collect_and_train.md": {
        "60, 20 and 20 % of the transits",
        "differs by more than 1e-4 of its size",
    },
    "docs/how_to/evaluate.md": {
        "Wilson's 95 % interval",
        "Wilson's interval of 95 %",
        "*shown with 90 % confidence*",
        "a chance below 10 %",
        # Closed forms of the number of flights.
        "show 99.73 %, which is the 3σ of a requirement; 200 show 98.9 %, 50 show 95.5 %",
        "below it with 90 % confidence",
    },
    "docs/limits.md": {"a turn rate of 3.2e-4 rad/s", "size is uncertain by 25 %"},
    "docs/method/expert.md": {"of at most 10 % a"},
    "docs/method/gravity.md": {
        "at most 1e-4 of the body's length",
        "a bound of 1e-9",
        "a relative error of 1e-4",
    },
    "docs/method/hybrid.md": {"21.6 % and 29.2 % of the MPC's energy"},  # The paper's.
    "docs/method/navigation.md": {"more than 2 % of half", "98.5 % of the variance"},
    "docs/method/pilot.md": {
        "less than 5 % of the thrust limit",
        "perceptrons (69.1 %)",
        "a map of the surface (30.9 %)",
    },
    "docs/method/truth.md": {"5 % of the size off", "10 % of contrast"},
    "docs/results.md": {"differ by 10 or 20 per cent"},
}
"""Phrases by page: settings, definitions, what others published. No result of a flight or a run."""

_NUMBER = r"(?<![\w.,/])\d[\d,]*(?:\.\d+)?"
_MEASURED = re.compile(
    "|".join(
        (
            rf"{_NUMBER} of (?:the |all |some )?\d[\d,]*(?![\w-])",
            rf"{_NUMBER}/\d\d+(?![\w/])",
            rf"{_NUMBER} ?(?:%|per cent)",
            rf"{_NUMBER} (?:ms|µs|ns)\b",
            rf"\b(?:took|takes) (?:about |some )?{_NUMBER} (?:s|min|minutes|hours|h)\b",
            r"\d+\.\d+ ?(?:times\b|×)",
            r"[×x] real time",
            r"\d(?:\.\d+)?e-\d+",
        )
    )
)


class OwnFigure(NamedTuple):
    """A figure that seems to be measured."""

    line: int
    """Where its table or paragraph begins."""
    text: str


def own_figures(text: str, definitions: Collection[str] = ()) -> list[OwnFigure]:
    """The figures of a page from which rendered places are taken out.

    Args:
      text: of the page.
      definitions: phrases that are no measurement.
    """
    text = re.sub(
        r"^```.*?^```$",
        lambda found: "\n" * found[0].count("\n"),
        text,
        flags=re.DOTALL | re.MULTILINE,
    )
    found, number = [], 1
    for block in re.split(r"(\n\s*\n)", text):
        lines = block.splitlines()
        if lines and lines[0].startswith("|"):
            found += [OwnFigure(number, lines[0])] if _has_figures(lines) else []
        else:
            found += [OwnFigure(number, each) for each in _in_prose(block, definitions)]
        number += block.count("\n")
    return found


def _has_figures(table: list[str]) -> bool:
    cells = re.sub(r"`[^`]*`|\]\([^)]*\)", "", "\n".join(table[2:]))
    return table[0] not in SPECIFICATIONS and re.search(r"\d", cells) is not None


def _in_prose(block: str, definitions: Collection[str]) -> list[str]:
    prose = " ".join(block.split())
    for phrase in definitions:
        prose = prose.replace(phrase, "…")
    prose = re.sub(r"`[^`]*`|\]\([^)]*\)|\$[^$]*\$|<[^>]*>", "…", prose)
    return [match[0] for match in _MEASURED.finditer(prose)]
