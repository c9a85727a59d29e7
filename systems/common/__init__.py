"""What every other room uses: the error for bad input, random numbers by counter, files.

`InputError` says what was wrong, where, and what to do. Random numbers are pure functions of a seed
and a counter (`generator`, `derived_seed`), so that no generator has to be kept in a Context. Files
appear under their names only when they are whole (`write_whole`). Read `errors` and `counter_noise`
first. This room imports nothing of proxops; whatever is added here, every room sees.
"""

from proxops.systems.common.counter_noise import derived_seed, generator
from proxops.systems.common.errors import InputError, SolverFailure
from proxops.systems.common.files import file_sha256, make_folder, write_whole
from proxops.systems.common.onnx_bundle import MODEL_FILE, BundleKind, open_session, read_bundle
from proxops.systems.common.progress import Progress, part_of, silent

__all__ = [
    "MODEL_FILE",
    "BundleKind",
    "InputError",
    "Progress",
    "SolverFailure",
    "derived_seed",
    "file_sha256",
    "generator",
    "make_folder",
    "open_session",
    "part_of",
    "read_bundle",
    "silent",
    "write_whole",
]
