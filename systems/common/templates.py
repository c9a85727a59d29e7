"""`make_for_floats`: makes the class of a Drake template quickly."""

from __future__ import annotations

import inspect
import threading
import typing

from pydrake.common.cpp_template import TemplateBase


def make_for_floats(template: TemplateBase) -> type:
    """Makes the class that a `TemplateSystem` has for float, with the signature of `_construct`.

    Drake looks at all calls that led to where a class is made. In the midst of imports they are
    so many that it takes a second for three classes. A thread has no calls before its own.
    """
    thread = threading.Thread(target=template.get_instantiation, args=((float,),))
    thread.start()
    thread.join()
    made: typing.Any = template[float]
    own = list(inspect.signature(made._construct).parameters.values())[1:]
    made.__signature__ = inspect.Signature([each for each in own if each.name != "converter"])
    return made
