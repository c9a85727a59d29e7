"""`for_floats`: the class of a Drake template, made quickly."""

from __future__ import annotations

import threading
from typing import Any

from pydrake.common.cpp_template import TemplateBase


def for_floats(template: TemplateBase) -> Any:
    """The class that a `TemplateSystem` has for float.

    Drake looks at all calls that led to where a class is made. In the midst of imports they are
    so many that it takes a second for three classes. A thread has no calls before its own.
    """
    made: list[Any] = []
    thread = threading.Thread(target=lambda: made.append(template[float]))
    thread.start()
    thread.join()
    return made[0]
