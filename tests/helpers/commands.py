"""The commands of proxops, run in the process of the tests."""

import sys
from collections.abc import Mapping
from typing import NamedTuple

import pytest

from proxops.cli.main import main


def proxops(*arguments: object) -> int:
    """Runs `proxops ARGUMENTS` and returns its exit code."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["proxops", *map(str, arguments)])
        try:
            main()
        except SystemExit as end:
            return end.code if isinstance(end.code, int) else 0 if end.code is None else 1
    return 0


class Ran(NamedTuple):
    """Exit code and output of one run."""

    code: int
    out: str
    err: str


def settings(changes: Mapping[str, object]) -> list[str]:
    """The options that change values of the scenario: `--set KEY=VALUE` for each."""
    return [word for key, value in changes.items() for word in ("--set", f"{key}={value}")]
