"""How the body turns: steadily about an axis, or as a rigid body without torque.

`SteadySpin` and `TorqueFreeSpin` are functions of time; `BodyRotation` is the system. What is on
board is made from the spin as believed, the spacecraft and what it measures from the true one.
"""

from proxops.systems.rotation.body_rotation import BodyRotation
from proxops.systems.rotation.spin_models import (
    Spin,
    SpinErrors,
    SpinModel,
    SteadySpin,
    SteadySpinConfig,
    TorqueFreeSpin,
    TorqueFreeSpinConfig,
    spin_model,
)

__all__ = [
    "BodyRotation",
    "Spin",
    "SpinErrors",
    "SpinModel",
    "SteadySpin",
    "SteadySpinConfig",
    "TorqueFreeSpin",
    "TorqueFreeSpinConfig",
    "spin_model",
]
