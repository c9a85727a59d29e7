"""`CommandAxes`: a command that is meant in the body's axes, in the spacecraft's own axes."""

from __future__ import annotations

from pydrake.systems.framework import LeafSystem

from proxops.systems.common import check_positive, quaternion_inverse, rotated


class CommandAxes(LeafSystem):
    """Turns a force from K into S, as the attitude is believed, and clips it to the thrust limit.

    ```
                    ┌─────────────┐
    force ─────────►│             │
      (3), N, K     │ CommandAxes ├─► force (3), N, S: clip(R_KS^T force, ± limit)
    attitude ──────►│             │
      (4)           │             │
    body_attitude ─►│             │
      (4)           └─────────────┘
    ```

    `attitude` is R_KS as a unit quaternion (w, x, y, z), as the navigation believes it to be. The
    limit holds along each axis of S, because the thrusters point along them, so a command at the
    limit may lose a little. A command that is not finite passes on as NaN, which the thrusters
    refuse. The output depends on the inputs alone.

    `body_attitude` may remain open. It is R_KS as it was measured, with which a rigid spacecraft
    turns forces into S itself. Then the output is along K's axes as that measurement takes them to
    be.
    """

    def __init__(self, limit: float):
        """Takes the greatest force per axis in N."""
        super().__init__()
        check_positive("CommandAxes", limit=limit)
        self.limit = limit
        self._command_port = self.DeclareVectorInputPort("force", 3)
        self._attitude_port = self.DeclareVectorInputPort("attitude", 4)
        self._body_port = self.DeclareVectorInputPort("body_attitude", 4)
        self.DeclareVectorOutputPort("force", 3, self._calc_force, {self.all_input_ports_ticket()})

    def _calc_force(self, context, output):
        x, y, z = self._command_port.Eval(context).tolist()
        a, b, c, d = self._attitude_port.Eval(context).tolist()
        force = rotated(quaternion_inverse((a, b, c, d)), (x, y, z))
        if self._body_port.HasValue(context):
            a, b, c, d = self._body_port.Eval(context).tolist()
            force = rotated((a, b, c, d), force)
        # The comparisons let NaN through.
        limit = self.limit
        output.SetFromVector([limit if f > limit else -limit if f < -limit else f for f in force])
