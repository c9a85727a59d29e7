"""Keys of a scenario that had other names in earlier versions, or were not there."""

from __future__ import annotations

import typing
from collections.abc import Callable

from proxops.systems.common import InputError

Tree = dict[str, typing.Any]

RENAMED = {
    "mpc.knots": "mpc.intervals",  # 0.3.0
    "mpc.knot_growth": "mpc.interval_growth",  # 0.3.0
    "mismatch.gravity": "truth.gravity",  # 0.4.0, and all below
    "mismatch.mass": "truth.mass",
    "mismatch.thrust": "truth.thrusters.scale",
    "lidar.bias_m": "truth.lidar.bias_m",
    "lidar.scale_error": "truth.lidar.scale_error",
    "lidar.dropout": "truth.lidar.dropout",
    "lidar.false_returns": "truth.lidar.false_returns",
    "lidar.attitude_error_deg": "truth.attitude.constant_deg",
    "assurance.margin_m": "assurance.bounds.surface_m",  # 0.6.0
}
"""The new name of each key, by its old name. The comments give the version that renamed it."""


def _turned(value: float) -> list[float]:
    """The axis of the old attitude error was drawn, and thrust did not turn with it."""
    if value != 0.0:
        raise InputError(
            "a scenario of an earlier version has lidar.attitude_error_deg above 0, which this "
            "version cannot fly in the same way: truth.attitude turns the thrust as well"
        )
    return [0.0] * 3


# What becomes of the value, where the new key needs another form.
_CONVERTED: dict[str, Callable[[typing.Any], typing.Any]] = {
    "mismatch.thrust": lambda value: [value] * 3,
    "lidar.attitude_error_deg": _turned,
}


def refuse_renamed(tree: Tree, source: str) -> None:
    """Refuses old names in what a user writes.

    Raises:
      InputError: the tree has a key by its old name; the message gives the new name.
    """
    for old, new in RENAMED.items():
        section, key = _section(tree, old)
        if key in section:
            raise InputError(f"{source}: {old} is called {new} now")
    if "mismatch" in tree:
        raise InputError(f"{source}: mismatch is called truth now")


def translate_renamed(tree: Tree) -> None:
    """Renames the old keys of a tree that an earlier version wrote, in place.

    A tree without `navigation` is of a version before 0.5.0, in which controllers knew the true
    state.

    Raises:
      InputError: a value cannot be flown any more.
    """
    for old, new in RENAMED.items():
        section, key = _section(tree, old)
        if key in section:
            value = section.pop(key)
            value = _CONVERTED.get(old, lambda same: same)(value)
            section, key = _section(tree, new, make=True)
            section.setdefault(key, value)
    tree.pop("mismatch", None)
    tree.setdefault("navigation", {"_tag": "!TrueState"})


def _section(tree: Tree, dotted: str, make: bool = False) -> tuple[Tree, str]:
    """Gives the section that holds a dotted key, and the key's last part; {} if there is none.

    With `make`, sections that are not there are made.
    """
    *parents, last = dotted.split(".")
    for name in parents:
        child = tree.setdefault(name, {}) if make else tree.get(name)
        if not isinstance(child, dict):
            return {}, last
        tree = child
    return tree, last
