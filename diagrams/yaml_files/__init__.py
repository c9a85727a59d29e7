"""YAML files: read as plain values by YAML 1.2, strictly, and made into dataclasses and back.

Start with `load_typed`. What is wrong in a file is an `InputError` that says how to correct it. A
dataclass that a file fills has defaults for all fields; its limits are checked by `check_limits`.
"""

from proxops.diagrams.yaml_files.plain_yaml import TAG, read_yaml, write_yaml
from proxops.diagrams.yaml_files.typed_yaml import (
    dump_typed,
    file_of,
    fits,
    in_words,
    is_number,
    is_yaml_path,
    leaves,
    load_typed,
    parse_mapping,
    read_mapping,
    sections_of,
    tree_of,
)

__all__ = [
    "TAG",
    "dump_typed",
    "file_of",
    "fits",
    "in_words",
    "is_number",
    "is_yaml_path",
    "leaves",
    "load_typed",
    "parse_mapping",
    "read_mapping",
    "read_yaml",
    "sections_of",
    "tree_of",
    "write_yaml",
]
