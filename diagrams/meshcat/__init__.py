"""Flights in 3D: live in the browser, as a replay page, and in notebooks.

Start with `write_replay`, which makes a page from a log, or `show_flight`, which draws in a
notebook. `meshcat_scene` defines the objects of the scene and their places; the other modules add
views, panels, a rigid spacecraft, lidar returns and paths to it.
"""

from proxops.diagrams.meshcat.live_view import LiveView, prepare_live_view
from proxops.diagrams.meshcat.meshcat_page import PLAYBACK_SPEED
from proxops.diagrams.meshcat.meshcat_scene import Scene
from proxops.diagrams.meshcat.movie import check_film, write_frames, write_movie
from proxops.diagrams.meshcat.notebook_view import show_body, show_flight, show_lidar
from proxops.diagrams.meshcat.path_scene import paths_page
from proxops.diagrams.meshcat.replay import add_flight, write_replay
from proxops.diagrams.meshcat.rigid_scene import RigidView
from proxops.diagrams.meshcat.site_scene import add_site, part_shown

__all__ = [
    "PLAYBACK_SPEED",
    "LiveView",
    "RigidView",
    "Scene",
    "add_flight",
    "add_site",
    "check_film",
    "part_shown",
    "paths_page",
    "prepare_live_view",
    "show_body",
    "show_flight",
    "show_lidar",
    "write_frames",
    "write_movie",
    "write_replay",
]
