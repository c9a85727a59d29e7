"""Imports packages that come with an extra when they are needed."""

from __future__ import annotations

import importlib
from types import ModuleType

from proxops.systems.common.errors import InputError


def needed(name: str, extra: str) -> ModuleType:
    """Imports a module of a package that comes with an extra.

    Raises:
      InputError: it is not installed.
    """
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        package = name.partition(".")[0]
        raise InputError(
            f"the package {package} is not installed: pip install 'proxops[{extra}]'"
        ) from error
