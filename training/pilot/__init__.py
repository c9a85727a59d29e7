"""The pilot: our end-to-end network, from lidar frames to force, trained part by part.

Start with `train_pilot` in `recipe`, which reads from top to bottom, then read `network`. The parts
are `lidar_hits`, `coarse_position`, `geometry_layer`, `state_filter` and `guidance`; `tasks` has
their losses and `settings` their sizes. `run_dagger` lets the pilot fly, labels every state with
the expert's force, and trains the guidance again.
"""

from proxops.training.pilot.dagger import DaggerSettings, run_dagger
from proxops.training.pilot.examples import Hits, hits_of
from proxops.training.pilot.guidance import least_effort, way_round
from proxops.training.pilot.lidar_hits import HitSelection
from proxops.training.pilot.network import Pilot
from proxops.training.pilot.pilot_file import load_pilot
from proxops.training.pilot.recipe import train_pilot
from proxops.training.pilot.settings import PilotSettings, dimensions_of
from proxops.training.pilot.state_filter import MEMORY, measurement_noise
from proxops.training.pilot.surface_picture import plot_surface
from proxops.training.pilot.tasks import geometry_task

__all__ = [
    "MEMORY",
    "DaggerSettings",
    "HitSelection",
    "Hits",
    "Pilot",
    "PilotSettings",
    "dimensions_of",
    "geometry_task",
    "hits_of",
    "least_effort",
    "load_pilot",
    "measurement_noise",
    "plot_surface",
    "run_dagger",
    "train_pilot",
    "way_round",
]
