"""What each key of a scenario is: for the documentation, for completion, and as a scenario's text.

Defaults, units and limits are those of the dataclasses, meanings the comments above their fields.
"""

from __future__ import annotations

import dataclasses as dc
import functools
import inspect
import re
import textwrap
import typing
from collections.abc import Iterator, Mapping, Sequence

from proxops.diagrams.scenario.scenario_config import Scenario
from proxops.diagrams.yaml_files import in_words, sections_of, write_yaml
from proxops.systems.common import choices_of, limits_in_words, unit_of

_FIELD = re.compile(r"((?:^    #.*\n)*)^    (\w+): ", re.MULTILINE)
_WIDTH = 100


class DescribedKey(typing.NamedTuple):
    """A key of a scenario, or of one of its sections."""

    name: str
    default: str
    """As YAML; of a section: `null`, or its tag if it takes several."""
    unit: str
    limits: str
    """In words; of a value without limits, its type."""
    meaning: str
    choices: Sequence[str]
    """All values that it takes, if they are few; of a section, its tags."""
    sections: Mapping[str, Sequence[DescribedKey]]
    """The keys of each section that may stand here, by their tags; of a value there are none."""


@functools.cache
def described_keys(schema: type = Scenario) -> tuple[DescribedKey, ...]:
    """Describes the keys of a scenario, or of the dataclass of a section."""
    meanings = {
        name: " ".join(line.strip("# ") for line in comment.splitlines())
        for comment, name in _FIELD.findall(inspect.getsource(schema))
    }
    return tuple(_described(field, meanings[field.name]) for field in dc.fields(schema))


def _described(field: dc.Field, meaning: str) -> DescribedKey:
    sections = {tag: described_keys(each) for tag, each in sections_of(field.type).items()}
    made = field.default if field.default_factory is dc.MISSING else field.default_factory()
    choices = choices_of(field) or (("true", "false") if field.type is bool else ())
    limits = limits_in_words(field) or " or ".join(choices)
    if not limits and not sections:
        limits = in_words(field.type)
    return DescribedKey(
        field.name, _text(made, len(sections) > 1), unit_of(field), limits, meaning,
        (*sections, *choices), sections,
    )  # fmt: skip


def _text(value: object, tagged: bool) -> str:
    """A value as YAML; of a section, its tag if it has one."""
    if dc.is_dataclass(value):
        return f"!{type(value).__name__.removesuffix('Config')}" if tagged else ""
    text = write_yaml(value if isinstance(value, list) else [value]).strip()
    return text if isinstance(value, list) else text[1:-1]


def dotted(
    keys: Sequence[DescribedKey] | None = None, prefix: str = ""
) -> Iterator[tuple[str, DescribedKey]]:
    """Yields the dotted name and the description of each key, those of all sections included."""
    for key in described_keys() if keys is None else keys:
        yield prefix + key.name, key
        for inner in key.sections.values():
            yield from dotted(inner, f"{prefix}{key.name}.")


def commented_scenario(scenario: Scenario | None = None) -> str:
    """Gives a scenario as YAML, the default one if None, with what each key means in comments.

    Sections that it does not have are there as comments.
    """
    return "\n".join(_lines(described_keys(), "", scenario or Scenario())) + "\n"


def _lines(keys: Sequence[DescribedKey], indent: str, config: object = None) -> Iterator[str]:
    """The lines of a section; without one, those of its defaults."""
    for key in keys:
        lines = textwrap.wrap(key.meaning, _WIDTH - len(indent), break_on_hyphens=False)
        yield from (f"{indent}# {line}" for line in lines)
        note = ", ".join(filter(None, (key.unit, key.limits)))
        given = getattr(config, key.name, None)
        text = key.default if config is None else _text(given, len(key.sections) > 1)
        bare = text.startswith("!") and not key.sections[text[1:]]
        value = f"{indent}{key.name}: {text}{' {}' if bare else ''}".rstrip()
        yield value + (f"  # {note}" if note else "")
        for tag, inner in key.sections.items():
            if text in ("", f"!{tag}"):
                yield from _lines(inner, f"{indent}  ", given)
            else:
                tagged = f" !{tag}" if len(key.sections) > 1 else ""
                yield f"{indent}# {key.name}:{tagged}{'' if inner else ' {}'}"
                yield from (f"{indent}# {line}" for line in _lines(inner, "  "))
