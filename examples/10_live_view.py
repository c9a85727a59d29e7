"""A live view: a flight in the browser while it is flown, and its replay afterwards.

    python examples/10_live_view.py

Open the address that it prints. It flies at 160 times real time, so that a person can follow.
"""

import sys

from pydrake.geometry import Meshcat

from proxops.diagrams.flight import fly
from proxops.diagrams.scenario import load_scenario

meshcat = Meshcat()
print("open", meshcat.web_url())
log = fly(load_scenario(transit=1), "hybrid", meshcat=meshcat)
print("arrived:", log.summary["success"])
if sys.stdin.isatty():
    input("press Enter to end")
