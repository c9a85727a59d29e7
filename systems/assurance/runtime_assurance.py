"""`RuntimeAssurance`: a filter on commanded forces that keeps out of the keep-out ellipsoid."""

from __future__ import annotations

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import LeafSystem, ValueProducer

from proxops.systems.assurance.assurance_bounds import AssuranceBounds
from proxops.systems.assurance.backup_braking import Assured, BackupBraking, InterventionReason
from proxops.systems.common import check_not_negative, config, error_bounds, number


@config
class AssuranceConfig:
    """The safety filter that keeps any controller out of the keep-out ellipsoid.

    See `proxops.systems.RuntimeAssurance`. Of the scenario's `truth` the filter knows no more
    than these bounds. A survey, which has no map, is kept out of a sphere by `SphereAssurance`;
    there the scenario's dispersions are the bounds, and of these keys `deviations` alone counts.
    """

    # The errors for which it does so. Either their values, or the name of dispersions that ship
    # with proxops, or the path of a YAML file of dispersions or of these values; a path in a
    # scenario file is relative to that file. Of dispersions, the ends count: a normal number ends
    # at 3 sigma. null: what the scenario declares: its own dispersions, truth, disturbance, force
    # noise and kicks; without any, no errors.
    bounds: str | AssuranceBounds | None = None
    # Position and velocity are taken to err by up to this many standard deviations of the
    # navigation's covariance, along its longest axis, in addition to the bounds.
    deviations: float = number(4.0, at_least=0.0, at_most=1e3)


class RuntimeAssurance(LeafSystem):
    """Changes a commanded force by the least that keeps the spacecraft safe.

    ```
    state (6) ───────►┌──────────────────┐
                      │                  ├─► force (3), N
    force (3) ───────►│ RuntimeAssurance ├─► intervention (2): size of the change in N,
                      │                  │                     InterventionReason
    covariance (81) ─►│                  ├─► margin (3): the command's margin in m, and bounds of
                      └──────────────────┘               the state's errors in m and m/s
    ```

    All vectors are in K, in m, m/s and N. Keeping out of the ellipsoid has priority over the speed
    limit; the thrust limit always holds. A safe command within both limits passes bit for bit.
    `BackupBraking` explains how this is decided, and why it is enough.

    From a state that `BackupBraking` admits, the flight stays out whatever is commanded, as long
    as all errors are within the bounds. From any other state the backup brakes as hard as it can,
    unless a force is found that leads to an admitted state.

    `covariance` (9, 9) is that of `LidarNavigation`: of position, velocity and attitude. The errors
    of the state are then bounded by those of the box plus so many standard deviations along the
    longest axis, of position and of velocity. Along one axis, a normal error is beyond 4 of them
    once in 16,000 steps; the length of an error that is alike in all directions, once in 900. That
    of the attitude is not used. Without this input the errors are those of the box.

    The outputs depend on the inputs alone. A command that is not finite passes unchanged; the
    thrusters refuse it. If the state is not finite, because the navigation has none, every command
    passes unchanged: without a state nothing can be said of a command, nor of another. The same
    holds while the errors of the state are so great that the backup would not settle even from
    rest: in the first steps of a navigation, which has seen few frames, when frames are missing for
    long, and in the steps after something acted that the navigation did not expect.
    """

    def __init__(self, backup: BackupBraking, deviations: float = 4.0):
        """Takes the backup and the bound of the state's errors.

        Args:
          backup: holds body, spacecraft, limits, bounds and control period.
          deviations: number of standard deviations of `covariance` that count.
        """
        super().__init__()
        check_not_negative("RuntimeAssurance", deviations=deviations)
        self.backup, self.deviations = backup, float(deviations)
        self._state_port = self.DeclareVectorInputPort("state", 6)
        self._command_port = self.DeclareVectorInputPort("force", 3)
        self._covariance_port = self.DeclareVectorInputPort("covariance", 81)
        nothing = Assured(np.zeros(3), InterventionReason.NONE)
        blank = nothing, 0.0, 0.0
        # One cache entry, so that all outputs share one computation.
        self._assured = self.DeclareCacheEntry(
            "assured",
            ValueProducer(allocate=lambda: AbstractValue.Make(blank), calc=self._calc_assured),
            {self.all_input_ports_ticket()},
        )
        self.DeclareVectorOutputPort(
            "force",
            3,
            lambda context, output: output.SetFromVector(self._assured.Eval(context)[0].force),
            {self._assured.ticket()},
        )
        self.DeclareVectorOutputPort(
            "intervention",
            2,
            self._calc_intervention,
            {self._assured.ticket(), self._command_port.ticket()},
        )
        self.DeclareVectorOutputPort("margin", 3, self._calc_margin, {self._assured.ticket()})

    def _calc_assured(self, context, value):
        command, state = self._command_port.Eval(context), self._state_port.Eval(context)
        errors = self._errors(context)
        assured = Assured(command, InterventionReason.NONE)
        if all(np.isfinite(values).all() for values in (state, command, errors)):
            judged = self.backup.assure(state, command, *errors)
            # If it is the errors of the state that let nothing settle, nothing is known of it.
            if judged.margin > -np.inf or self.backup.can_hold(state[:3], *errors):
                assured = judged
        value.set_value((assured, *errors))

    def _errors(self, context) -> tuple[float, float]:
        """Bounds of the errors of position and velocity, in m and m/s."""
        bounds = self.backup.bounds
        if not self._covariance_port.HasValue(context):
            return bounds.position_m, bounds.velocity_m_s
        covariance = self._covariance_port.Eval(context)
        return error_bounds(covariance, self.deviations, bounds.position_m, bounds.velocity_m_s)

    def _calc_intervention(self, context, output):
        assured, _, _ = self._assured.Eval(context)
        changed = assured.reason != InterventionReason.NONE
        change = assured.force - self._command_port.Eval(context) if changed else np.zeros(3)
        output.SetFromVector([np.linalg.norm(change), assured.reason])

    def _calc_margin(self, context, output):
        assured, position, velocity = self._assured.Eval(context)
        output.SetFromVector([assured.margin, position, velocity])
