"""`RuntimeAssurance`: a filter on commanded forces that keeps out of the keep-out ellipsoid."""

from __future__ import annotations

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import LeafSystem, ValueProducer

from proxops.systems.assurance.backup_braking import Assured, BackupBraking, InterventionReason


class RuntimeAssurance(LeafSystem):
    """Changes a commanded force by the least that keeps the spacecraft safe.

    ```
    state (6) ──►┌──────────────────┐
                 │ RuntimeAssurance ├─► force (3), N
    force (3) ──►│                  ├─► intervention (2): size of the change in N,
                 └──────────────────┘                     InterventionReason
    ```

    All vectors are in K, in m, m/s and N. Keeping out of the ellipsoid has priority over the speed
    limit; the thrust limit always holds. A safe command passes bit for bit. `BackupBraking`
    explains how this is decided, and why it is enough.

    From a state that `BackupBraking` admits, the flight stays out whatever is commanded, under
    these
    conditions: the true state is known, the output force acts unchanged from each control step to
    the next, and mass, gravity and spin are the assumed ones, up to what the margin covers. From
    any other state the backup brakes as hard as it can, unless a force is found that leads to an
    admitted state.

    The outputs depend on the inputs alone. A command that is not finite passes unchanged; the
    thrusters refuse it. If the state is not finite, because the navigation has none, every command
    passes unchanged: without a state nothing can be said of a command, nor of another.
    """

    def __init__(self, backup: BackupBraking):
        """Takes the backup, which holds body, spacecraft, limits and control period."""
        super().__init__()
        self.backup = backup
        self._state_port = self.DeclareVectorInputPort(name="state", size=6)
        self._command_port = self.DeclareVectorInputPort(name="force", size=3)
        nothing = Assured(np.zeros(3), InterventionReason.NONE)
        # One cache entry, so that both outputs share one computation.
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
        command, state = self._command_port.Eval(context), self._state_port.Eval(context)
        if np.isfinite(command).all() and np.isfinite(state).all():
            value.set_value(self.backup.assure(state, command))
        else:
            value.set_value(Assured(command, InterventionReason.NONE))

    def _calc_intervention(self, context, output):
        assured = self._assured.Eval(context)
        changed = assured.reason != InterventionReason.NONE
        change = assured.force - self._command_port.Eval(context) if changed else np.zeros(3)
        output.SetFromVector([np.linalg.norm(change), assured.reason])
