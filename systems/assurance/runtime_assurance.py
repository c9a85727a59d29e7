"""`RuntimeAssurance`: the filter that keeps whatever is commanded out of the keep-out ellipsoid."""

from __future__ import annotations

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import LeafSystem, ValueProducer

from proxops.systems.assurance.backup_braking import Assured, BackupBraking, InterventionReason


class RuntimeAssurance(LeafSystem):
    """Changes a force by the least that keeps the spacecraft safe, whoever commands it.

    ```
    state (6) ──►┌──────────────────┐
                 │ RuntimeAssurance ├─► force (3), N
    force (3) ──►│                  ├─► intervention (2): size of the change in N,
                 └──────────────────┘                     InterventionReason
    ```

    All vectors are in K, in m, m/s and N. First comes keeping out of the ellipsoid, then the speed
    limit; thrust limits are kept in any case. What is safe passes bit for bit. How that is decided,
    and why it is enough, `BackupBraking` says. From a state that it admits, the flight stays out
    whatever is commanded, as long as its outputs are what acts, from each control step to the next,
    on a spacecraft of that mass near that body; from one that it doesn't, the backup flies and
    brakes as hard as it can, unless a force is found that leads back to one that it admits.

    The outputs depend on the inputs alone. A command that is not finite passes as it is, for the
    thrusters to refuse.
    """

    def __init__(self, backup: BackupBraking):
        """Takes the backup, which knows body, spacecraft, limits and control period."""
        super().__init__()
        self.backup = backup
        self._state_port = self.DeclareVectorInputPort(name="state", size=6)
        self._command_port = self.DeclareVectorInputPort(name="force", size=3)
        nothing = Assured(np.zeros(3), InterventionReason.NONE)
        # One entry, so that both outputs share the work.
        self._assured = self.DeclareCacheEntry(
            "assured",
            ValueProducer(allocate=lambda: AbstractValue.Make(nothing), calc=self._calc_assured),
            {self._state_port.ticket(), self._command_port.ticket()},
        )
        self._force_port = self.DeclareVectorOutputPort(
            name="force",
            size=3,
            calc=lambda context, output: output.SetFromVector(self._assured.Eval(context).force),
            prerequisites_of_calc={self._assured.ticket()},
        )
        self._intervention_port = self.DeclareVectorOutputPort(
            name="intervention",
            size=2,
            calc=self._calc_intervention,
            prerequisites_of_calc={self._assured.ticket(), self._command_port.ticket()},
        )

    def _calc_assured(self, context, value):
        command = self._command_port.Eval(context)
        if np.isfinite(command).all():
            value.set_value(self.backup.assure(self._state_port.Eval(context), command))
        else:
            value.set_value(Assured(command, InterventionReason.NONE))

    def _calc_intervention(self, context, output):
        assured = self._assured.Eval(context)
        changed = assured.reason != InterventionReason.NONE
        change = assured.force - self._command_port.Eval(context) if changed else np.zeros(3)
        output.SetFromVector([np.linalg.norm(change), assured.reason])
