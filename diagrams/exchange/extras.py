"""Imports packages of the extra `exchange` when they are needed."""

from __future__ import annotations

import importlib
from types import ModuleType

from proxops.systems.common import InputError


def needed(name: str) -> ModuleType:
    """A module of a package that comes with the extra `exchange`.

    Raises:
      InputError: it is not installed.
    """
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        package = name.partition(".")[0]
        raise InputError(
            f"the package {package} is not installed: pip install 'proxops[exchange]'"
        ) from error
