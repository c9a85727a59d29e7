"""`Thrusters`: the limits of the force that acts."""

from __future__ import annotations

import numpy as np
from pydrake.systems.framework import LeafSystem

from proxops.systems.common import InputError, check_positive


class Thrusters(LeafSystem):
    """Clips a commanded force to the thrusters' limits.

    ```
                ┌───────────┐
    force ─────►│ Thrusters ├─► force (3), N: clip(force, ± limit)
      (3), N    └───────────┘
    ```

    The output depends on the input alone. A command that is not finite ends the simulation with an
    `InputError`, because an integrator would shorten its steps without end.
    """

    def __init__(self, limit: float):
        """Takes the greatest force per axis in N."""
        super().__init__()
        check_positive("Thrusters", limit=limit)
        self.limit = limit
        self._command_port = self.DeclareVectorInputPort("force", 3)
        self.DeclareVectorOutputPort("force", 3, self._calc_force, {self._command_port.ticket()})

    def _calc_force(self, context, output):
        command = self._command_port.Eval(context)
        if not np.isfinite(command).all():
            raise InputError(
                f"the controller commands {command.tolist()} N at {context.get_time():g} s; "
                "a force must be finite"
            )
        output.SetFromVector(np.clip(command, -self.limit, self.limit))
