"""What every other room uses: errors for bad input, random numbers, files, bundles.

`InputError` says what was wrong, where, and what to do. The `check_…` functions raise it for
arguments that make no sense. Random numbers are pure functions of a seed and a step (`generator`,
`derived_seed`), so that no generator has to be kept in a Context; `SeededSystem` is the base of the
systems that draw them. `write_whole` and `write_json` give a file its name only when all of it is
written. `decoded` gives the text of a file in any encoding. `kernel` compiles functions.
`keep_arrays` puts what took long to compute into the user's cache folder, and `kept_arrays` finds
it there. `Vector3`, `States` and the like say the shape of an array in signatures. A `BundleKind`
reads and writes the folders of trained networks, and `offers_of` says what a controller offers to a
flight and its log. Read `errors` and `counter_noise` first. This room imports nothing else of
proxops, and every other room depends on it.
"""

from proxops.systems.common.array_types import (
    Matrix3,
    State,
    States,
    Values,
    Vector3,
    Vectors3,
)
from proxops.systems.common.bundles import (
    BundleKind,
    open_session,
    packed_arrays,
    unpacked_arrays,
)
from proxops.systems.common.checks import (
    LARGEST,
    Vector,
    check_finite,
    check_inertia,
    check_not_negative,
    check_positive,
    check_type,
    checked_semi_axes,
    finite_vector,
    vector_of,
)
from proxops.systems.common.controller_offers import (
    LegendEntry,
    LoggedPort,
    check_port_size,
    force_port,
    offers_of,
)
from proxops.systems.common.counter_noise import derived_seed, generator
from proxops.systems.common.deviations import error_bounds
from proxops.systems.common.directions import directions_of, spread_directions
from proxops.systems.common.errors import InputError, SolverFailure
from proxops.systems.common.extras import needed
from proxops.systems.common.files import (
    file_sha256,
    last_change,
    make_folder,
    whole_folder,
    write_json,
    write_whole,
)
from proxops.systems.common.html_tables import html_table
from proxops.systems.common.kernels import compilation_timed, compiling_told, kernel
from proxops.systems.common.machine import processor
from proxops.systems.common.progress import Progress, part_of, silent
from proxops.systems.common.rotations import (
    Quaternion,
    cross_matrix,
    inverse_matrix,
    quaternion_inverse,
    quaternion_of,
    quaternion_product,
    rotated,
    rotation_matrix,
    turned_vector,
)
from proxops.systems.common.seeded_system import SeededSystem
from proxops.systems.common.settings import (
    FAR,
    LONG,
    check_limits,
    choices_of,
    config,
    limits_in_words,
    limits_of,
    number,
    one_of,
    unit_of,
    values_in_words,
    vector,
)
from proxops.systems.common.templates import make_for_floats
from proxops.systems.common.text_files import decoded
from proxops.systems.common.threads import one_thread, threads_to_use
from proxops.systems.common.user_cache import keep_arrays, kept_arrays, name_of
from proxops.systems.common.user_folders import cache_folder

__all__ = [
    "FAR",
    "LARGEST",
    "LONG",
    "BundleKind",
    "InputError",
    "LegendEntry",
    "LoggedPort",
    "Matrix3",
    "Progress",
    "Quaternion",
    "SeededSystem",
    "SolverFailure",
    "State",
    "States",
    "Values",
    "Vector",
    "Vector3",
    "Vectors3",
    "cache_folder",
    "check_finite",
    "check_inertia",
    "check_limits",
    "check_not_negative",
    "check_port_size",
    "check_positive",
    "check_type",
    "checked_semi_axes",
    "choices_of",
    "compilation_timed",
    "compiling_told",
    "config",
    "cross_matrix",
    "decoded",
    "derived_seed",
    "directions_of",
    "error_bounds",
    "file_sha256",
    "finite_vector",
    "force_port",
    "generator",
    "html_table",
    "inverse_matrix",
    "keep_arrays",
    "kept_arrays",
    "kernel",
    "last_change",
    "limits_in_words",
    "limits_of",
    "make_folder",
    "make_for_floats",
    "name_of",
    "needed",
    "number",
    "offers_of",
    "one_of",
    "one_thread",
    "open_session",
    "packed_arrays",
    "part_of",
    "processor",
    "quaternion_inverse",
    "quaternion_of",
    "quaternion_product",
    "rotated",
    "rotation_matrix",
    "silent",
    "spread_directions",
    "threads_to_use",
    "turned_vector",
    "unit_of",
    "unpacked_arrays",
    "values_in_words",
    "vector",
    "vector_of",
    "whole_folder",
    "write_json",
    "write_whole",
]
