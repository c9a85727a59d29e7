"""`Thrusters`: what the thrusters make of a command."""

from __future__ import annotations

import numpy as np
from pydrake.systems.framework import LeafSystem

from proxops.systems.common import InputError


class Thrusters(LeafSystem):
    """Clips a command to the thrusters' limits, whoever gave it.

    ```
                ┌───────────┐
    force ─────►│ Thrusters ├─► force (3), N: clip(force, ± limit)
      (3), N    └───────────┘
    ```

    The output depends on the input alone. A command that is not finite ends the simulation with an
    `InputError`: an integrator would search for a step that copes with it, for ever.
    """

    def __init__(self, limit: float):
        """Takes the greatest force per axis in N."""
        super().__init__()
        self.limit = limit
        self._command_port = self.DeclareVectorInputPort(name="force", size=3)
        self.DeclareVectorOutputPort(
            name="force",
            size=3,
            calc=self._calc_force,
            prerequisites_of_calc={self._command_port.ticket()},
        )

    def _calc_force(self, context, output):
        command = self._command_port.Eval(context)
        if not np.isfinite(command).all():
            raise InputError(
                f"the controller commands {command.tolist()} N at {context.get_time():g} s; "
                "a force must be finite"
            )
        output.SetFromVector(np.clip(command, -self.limit, self.limit))
