"""The networks of the policies, and their parts; the recipes train them.

Start with `Pilot`, which is end-to-end: from lidar frames to force. Its parts are `HitSelection`,
`CoarsePosition`, `GeometryLayer` (with the `SurfaceField` that it learns), `StateFilter` (with the
`Motion`) and `Guidance`. `AnyBodyGuidance` flies at any body of a family, from state and goal to
force, and `DescentCorrection` corrects the law of a descent. `PaperPolicy` is the paper's:
convolutions, an LSTM and a perceptron.
"""

from proxops.training.networks.coarse_position import CoarsePosition
from proxops.training.networks.descent import DescentCorrection
from proxops.training.networks.geometry_layer import GeometryLayer
from proxops.training.networks.guidance import AnyBodyGuidance, Guidance
from proxops.training.networks.lidar_hits import HitSelection
from proxops.training.networks.paper_policy import PaperPolicy
from proxops.training.networks.pilot_network import (
    PILOT_FILE,
    Pilot,
    PilotDimensions,
    load_pilot,
    save_pilot,
)
from proxops.training.networks.state_filter import (
    MEMORY,
    Motion,
    StateFilter,
    measurement_noise,
)
from proxops.training.networks.surface_picture import plot_surface

__all__ = [
    "MEMORY",
    "PILOT_FILE",
    "AnyBodyGuidance",
    "CoarsePosition",
    "DescentCorrection",
    "GeometryLayer",
    "Guidance",
    "HitSelection",
    "Motion",
    "PaperPolicy",
    "Pilot",
    "PilotDimensions",
    "StateFilter",
    "load_pilot",
    "measurement_noise",
    "plot_surface",
    "save_pilot",
]
