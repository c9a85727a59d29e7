"""Runtime assurance: a filter that changes any controller's force only where safety needs it.

Start with `RuntimeAssurance`, the system. `BackupBraking` decides whether a command is safe:
whether a backup law could still keep the spacecraft out of the keep-out ellipsoid after it.
`AssuranceBounds` are the errors within which that holds. `least_change` searches the safe command
that is nearest to the given one. `_braking_kernel` is the compiled part; it predicts step by step
where the backup's flight may be, with gravity from a `TabulatedField`. Whoever changes the backup's
law changes the safety argument in docs/method/safety.md, too. `SphereAssurance` is for a survey,
which has no map: it brakes along one line.
"""

from proxops.systems.assurance.assurance_bounds import AssuranceBounds
from proxops.systems.assurance.backup_braking import BackupBraking, InterventionReason
from proxops.systems.assurance.runtime_assurance import AssuranceConfig, RuntimeAssurance
from proxops.systems.assurance.sphere_assurance import SphereAssurance, SphereLimits

__all__ = [
    "AssuranceBounds",
    "AssuranceConfig",
    "BackupBraking",
    "InterventionReason",
    "RuntimeAssurance",
    "SphereAssurance",
    "SphereLimits",
]
