"""An asteroid of one's own: from a mesh to a flight, at a contact binary of 2 km.

    python examples/5_own_asteroid.py

`proxops shape FILE --fix NEW --body BODY.yaml --scenario SCENARIO.yaml` does it from the command
line, for any mesh; `proxops shape --help` says for which forms.
"""

import subprocess

import trimesh

from proxops.diagrams.flight import fly
from proxops.diagrams.meshcat import write_replay
from proxops.diagrams.scenario import load_scenario

lobes = [trimesh.creation.icosphere(subdivisions=4, radius=radius) for radius in (700.0, 450.0)]
lobes[0].apply_scale([1.2, 1.0, 0.8])
lobes[1].apply_translation([1100.0, 0.0, 0.0])
trimesh.boolean.union(lobes, engine="manifold").export("lobes.obj")

command = "proxops shape lobes.obj --unit m --density 1200 --period 6 --fix binary.obj"
subprocess.run([*command.split(), "--body", "binary.yaml", "--scenario", "visit.yaml"], check=True)

log = fly(load_scenario("visit.yaml"), "mpc")
print("arrived:", log.summary["success"], "for", log.summary["delta_v_m_s"], "m/s")
write_replay(log, "own_asteroid.html")
