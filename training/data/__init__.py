"""Data to learn from: collected flights, the expert's plans, packed arrays. No PyTorch.

Start with `collection_flights` (which flights are flown to learn from) and `pack_flights`, which
turns logs into memory maps; `expert_plans` and `labels_by_flight` add the expert's answers at other
states.
"""

from proxops.training.data.collection import collect, collection_flights, learned_lidar_of
from proxops.training.data.collection_report import histogram_rows, report_rows
from proxops.training.data.flight_labels import labels_by_flight, plans_along
from proxops.training.data.label_files import Labels, joined_labels, kept_labels
from proxops.training.data.normalisation import Normalisation
from proxops.training.data.packed_flights import PARTS, PackedFlights, part_rows
from proxops.training.data.packing import pack_flights
from proxops.training.data.plans import expert_plans, portions_of
from proxops.training.data.recovery import (
    MIXES,
    at_rest,
    check_disturbances,
    kind_of,
    parse_mix,
)
from proxops.training.data.scaling import (
    Scaling,
    body_length,
    keep_out_of,
    scaling_for,
    scaling_of,
)

__all__ = [
    "MIXES",
    "PARTS",
    "Labels",
    "Normalisation",
    "PackedFlights",
    "Scaling",
    "at_rest",
    "body_length",
    "check_disturbances",
    "collect",
    "collection_flights",
    "expert_plans",
    "histogram_rows",
    "joined_labels",
    "keep_out_of",
    "kept_labels",
    "kind_of",
    "labels_by_flight",
    "learned_lidar_of",
    "pack_flights",
    "parse_mix",
    "part_rows",
    "plans_along",
    "portions_of",
    "report_rows",
    "scaling_for",
    "scaling_of",
]
