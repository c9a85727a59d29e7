"""Runtime assurance: a filter that changes any controller's force only where safety needs it.

Start with `RuntimeAssurance`, the system. `BackupBraking` decides whether a command is safe:
whether a backup law could still keep the spacecraft out of the keep-out ellipsoid after it.
`least_change` searches the safe command that is nearest to the given one. `_braking_kernel` is the
compiled part; it predicts the backup's flight step by step, with gravity from a `GravityTable`.
Whoever changes the backup's law changes the safety argument in docs/method/hybrid.md, too.
"""

from proxops.systems.assurance.backup_braking import (
    AssuranceLimits,
    BackupBraking,
    InterventionReason,
)
from proxops.systems.assurance.runtime_assurance import RuntimeAssurance

__all__ = [
    "AssuranceLimits",
    "BackupBraking",
    "InterventionReason",
    "RuntimeAssurance",
]
