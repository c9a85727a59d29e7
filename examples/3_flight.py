"""A flight and its plot: one transit by the hybrid, in a world that is not as it is believed.

python examples/3_flight.py
"""

from proxops.diagrams.flight import fly
from proxops.diagrams.meshcat import write_replay
from proxops.diagrams.plots import plot_flight
from proxops.diagrams.scenario import load_scenario

log = fly(load_scenario(transit=1, dispersions="after_survey"), "hybrid")
for name in ("success", "arrival_time_s", "delta_v_m_s", "min_clearance_m"):
    print(name, log.summary[name])
print(log.dataset)  # an xarray.Dataset: each column with its unit and meaning

plot_flight(log).savefig("flight.png")
write_replay(log, "flight.html")
