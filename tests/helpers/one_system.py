"""One system by itself: a Context with what it is told, and what its ports say then."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from pydrake.systems.framework import Context


def context_of(
    system: Any, time: float = 0.0, seed: int | None = None, **inputs: ArrayLike
) -> Context:
    """A Context at a time, in s, with these values at input ports, by their names."""
    context = system.CreateDefaultContext()
    context.SetTime(time)
    if seed is not None:
        system.set_seed(context, seed)
    for name, value in inputs.items():
        system.GetInputPort(name).FixValue(context, np.array(value, dtype=float))
    return context


def evaluated(
    system: Any, port: str, time: float = 0.0, seed: int | None = None, **inputs: ArrayLike
) -> np.ndarray:
    """What an output port says in such a Context."""
    return system.GetOutputPort(port).Eval(context_of(system, time, seed, **inputs)).copy()
