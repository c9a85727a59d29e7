"""A controller of one's own: any system with an output port `force` flies.

    python examples/4_own_controller.py

Its input ports are connected by their names. It flies on what the navigation knows, as the others
do, and aims at a speed that falls with the distance (a PD law with gravity fed forward).
"""

import numpy as np
from pydrake.systems.framework import LeafSystem

from proxops.diagrams.flight import fly
from proxops.diagrams.plots import plot_flight
from proxops.diagrams.scenario import load_body, load_scenario


class Homing(LeafSystem):
    def __init__(self, craft, body):
        super().__init__()
        self.craft, self.body = craft, body
        self.state = self.DeclareVectorInputPort("state", 6)
        self.target = self.DeclareVectorInputPort("target", 6)
        self.DeclareVectorOutputPort("force", 3, self.calc_force)

    def calc_force(self, context, output):
        state, target = self.state.Eval(context), self.target.Eval(context)
        if np.isnan(state).any():
            return output.SetFromVector(np.zeros(3))  # No position is known yet.
        spin = np.array([0.0, 0.0, self.body.spin_rate])
        felt = self.body.gravity_field.evaluate(state[None, :3]).acceleration[0]
        felt -= 2.0 * np.cross(spin, state[3:]) + np.cross(spin, np.cross(spin, state[:3]))
        wanted = np.clip((target[:3] - state[:3]) / 320.0, -20.0, 20.0)  # m/s
        force = self.craft.mass_kg * ((wanted - state[3:]) / 80.0 - felt)
        limit = self.craft.thrust_limit_n
        return output.SetFromVector(np.clip(force, -limit, limit))


scenario, body = load_scenario(transit=0), load_body("kleopatra")
mine = fly(scenario, Homing(scenario.spacecraft, body))
mpc = fly(scenario, "mpc")
for name, log in {"mine": mine, "MPC": mpc}.items():
    print(name, log.summary["success"], round(log.summary["delta_v_m_s"], 1), "m/s")
plot_flight(mine).savefig("own_controller.png")
