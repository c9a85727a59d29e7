"""`BodyRotation`: the body's frame K turns in the inertial frame N."""

from __future__ import annotations

from pydrake.systems.framework import LeafSystem

from proxops.systems.rotation.spin_models import Spin, spin_model


class BodyRotation(LeafSystem):
    """How K turns, as a function of time alone.

    ```
    ┌──────────────┐─► attitude (4): R_NK as a unit quaternion (w, x, y, z)
    │ BodyRotation │─► angular_velocity (3), rad/s, K: w of K in N
    └──────────────┘─► angular_acceleration (3), rad/s^2, K
    ```
    """

    def __init__(self, spin: Spin):
        """Takes a `SpinModel`, or the rate in rad/s of a steady spin: about z, or a vector (3,).

        Raises:
          InputError: it is not finite.
        """
        super().__init__()
        self.spin = spin_model(spin)
        for name, size in (("attitude", 4), ("angular_velocity", 3), ("angular_acceleration", 3)):
            value = getattr(self.spin, name)

            def calc(context, output, value=value):
                output.SetFromVector(value(context.get_time()))

            self.DeclareVectorOutputPort(name, size, calc, {self.time_ticket()})
