"""Flights: a scenario and a controller go in, a log comes out, for one flight or many.

Start with `fly` for one flight, `make_transit_diagram` for its wiring, `add_transit` for a flight
in a diagram of one's own, `named_controller` for the controllers that have a name, `fly_many` for a
sweep on many processes, and `run_campaign` for flights that are stored. A new controller needs no
change here: it offers its own columns of the log and its own legend entry (see
docs/how_to/own_controller.md).
"""

from proxops.diagrams.flight.campaign import (
    Flight,
    Row,
    controller_label,
    file_label,
    fly_many,
    run_campaign,
    run_groups,
    transit_flights,
)
from proxops.diagrams.flight.hybrid_controller import make_hybrid
from proxops.diagrams.flight.named_controllers import (
    WITH_BUNDLE,
    bundle_of,
    named_controller,
    users_function,
)
from proxops.diagrams.flight.on_board import mended_map_of_flight
from proxops.diagrams.flight.origin import Provenance, body_sha256, made_with, provenance
from proxops.diagrams.flight.parallel import Workers
from proxops.diagrams.flight.recording import Flown, make_log
from proxops.diagrams.flight.scenario_systems import (
    bounded_backup,
    make_backup,
    make_events,
    make_lidar,
    make_mpc,
    make_navigation,
    surroundings,
)
from proxops.diagrams.flight.simulation import fly, let_go, make_simulator
from proxops.diagrams.flight.transit_diagram import (
    add_transit,
    diagram_of,
    make_transit_diagram,
)
from proxops.diagrams.flight.wiring import LIDAR_STREAM

__all__ = [
    "LIDAR_STREAM",
    "WITH_BUNDLE",
    "Flight",
    "Flown",
    "Provenance",
    "Row",
    "Workers",
    "add_transit",
    "body_sha256",
    "bounded_backup",
    "bundle_of",
    "controller_label",
    "diagram_of",
    "file_label",
    "fly",
    "fly_many",
    "let_go",
    "made_with",
    "make_backup",
    "make_events",
    "make_hybrid",
    "make_lidar",
    "make_log",
    "make_mpc",
    "make_navigation",
    "make_simulator",
    "make_transit_diagram",
    "mended_map_of_flight",
    "named_controller",
    "provenance",
    "run_campaign",
    "run_groups",
    "surroundings",
    "transit_flights",
    "users_function",
]
