"""Keys of a scenario that had other names in earlier versions."""

from __future__ import annotations

import typing

from proxops.systems.common import InputError

Tree = dict[str, typing.Any]

RENAMED = {
    "mpc.knots": "mpc.intervals",  # 0.3.0
    "mpc.knot_growth": "mpc.interval_growth",  # 0.3.0
}
"""The new name of each key, by its old name. The comments give the version that renamed it."""


def refuse_renamed(tree: Tree, source: str) -> None:
    """Refuses old names in what a user writes.

    Raises:
      InputError: the tree has a key by its old name; the message gives the new name.
    """
    for old, new in RENAMED.items():
        section, key = _section(tree, old)
        if key in section:
            raise InputError(f"{source}: {old} is called {new} now")


def translate_renamed(tree: Tree) -> None:
    """Renames the old keys of a tree that an earlier version wrote, in place."""
    for old, new in RENAMED.items():
        section, key = _section(tree, old)
        if key in section:
            value = section.pop(key)
            section, key = _section(tree, new)
            section.setdefault(key, value)


def _section(tree: Tree, dotted: str) -> tuple[Tree, str]:
    """Gives the section that holds a dotted key, and the key's last part; {} if there is none."""
    *parents, last = dotted.split(".")
    for name in parents:
        child = tree.get(name)
        if not isinstance(child, dict):
            return {}, last
        tree = child
    return tree, last
