"""`EnabledValue`: a vector that is evaluated only while it is enabled."""

from __future__ import annotations

import numpy as np
from pydrake.systems.framework import LeafSystem


class EnabledValue(LeafSystem):
    """Passes a vector on while it is enabled; otherwise gives NaN without evaluating it.

    ```
    enable (1) ───►┌──────────────┐
    value (size) ─►│ EnabledValue ├─► value (size)
                   └──────────────┘
    ```

    A logger at the output then causes computations upstream only where `enable` is not 0.
    """

    def __init__(self, size: int):
        """Takes the vector's size."""
        super().__init__()
        self._enable_port = self.DeclareVectorInputPort("enable", 1)
        self._value_port = self.DeclareVectorInputPort("value", size)
        self._nothing = np.full(size, np.nan)
        self.DeclareVectorOutputPort(
            "value", size, self._calc_value, {self.all_input_ports_ticket()}
        )

    def _calc_value(self, context, output):
        enabled = self._enable_port.Eval(context)[0] != 0.0
        output.SetFromVector(self._value_port.Eval(context) if enabled else self._nothing)
