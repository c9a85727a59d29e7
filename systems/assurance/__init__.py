"""Runtime assurance: a filter that changes any controller's force only where it must.

Start with `RuntimeAssurance`, the system, and `BackupBraking`, which decides whether a state still
has a way out. The compiled kernel in `_braking_kernel` follows the backup step by step. A change to
the backup's law is a change to the safety argument in docs/method/hybrid.md.
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
