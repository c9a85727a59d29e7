"""Changes of single values: texts such as `mpc.intervals=10`, or a mapping of dotted keys."""

import typing

import numpy as np

from proxops.diagrams.scenario.plain_yaml import read_yaml
from proxops.systems.common import InputError

Overrides = typing.Sequence[str] | typing.Mapping[str, typing.Any]
"""Texts `key.subkey=value`, whose values are YAML, or a mapping of such keys to values."""


def overrides_of(overrides: Overrides) -> typing.Mapping[str, typing.Any]:
    """Gives overrides as a mapping of dotted keys to values.

    Raises:
      InputError: a text has another form, or its value is not YAML.
    """
    if isinstance(overrides, typing.Mapping):
        return overrides
    texts = [overrides] if isinstance(overrides, str) else overrides
    return dict(_split_override(text) for text in texts)


def given_keys(overrides: Overrides) -> list[str]:
    """Lists the dotted keys of the values that overrides give, those in nested mappings too.

    Raises:
      InputError: see `overrides_of`.
    """
    return [key for key, _ in dotted_leaves(overrides_of(overrides))]


def dotted_leaves(
    tree: typing.Mapping[str, typing.Any], prefix: str = ""
) -> typing.Iterator[tuple[str, typing.Any]]:
    """Yields the dotted keys of all values of nested mappings, with the values."""
    for key, value in tree.items():
        if isinstance(value, dict) and value:
            yield from dotted_leaves(value, f"{prefix}{key}.")
        else:
            yield prefix + key, value


def apply_overrides(tree: dict[str, typing.Any], values: typing.Mapping[str, typing.Any]) -> None:
    """Sets the values of dotted keys in nested dicts, in place."""
    for key, value in values.items():
        *parents, last = key.split(".")
        inner = tree
        for name in parents:
            child = inner.get(name)
            if not isinstance(child, dict):
                child = inner[name] = {}
            inner = child
        inner[last] = value.tolist() if isinstance(value, np.ndarray | np.generic) else value


def _split_override(text: str) -> tuple[str, typing.Any]:
    key, equals, value = text.partition("=")
    if not equals or not key.strip():
        raise InputError(f"override {text!r} is not of the form key.subkey=value")
    return key.strip(), read_yaml(f"value: {value}", f"override {text!r}: the value")["value"]
