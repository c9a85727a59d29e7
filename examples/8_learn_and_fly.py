"""Learn from flights and fly what was learned: behaviour cloning of the MPC, on the true state.

    python examples/8_learn_and_fly.py                # needs PyTorch: make train

The error on data is small, and the policy still misses the goal: where it goes, no expert has been.
That is what DAgger is for, which `proxops train` does.
"""

import numpy as np
import torch
from pydrake.systems.framework import LeafSystem

from proxops.diagrams.flight import fly
from proxops.diagrams.scenario import load_scenario

LIMIT = 7.0  # N
PAPER = {"navigation": {"_tag": "!TrueState"}, "log_ranges": False}


def features(state, target):
    return np.hstack([(target[..., :3] - state[..., :3]) / 1e5, state / ([1e5] * 3 + [20.0] * 3)])


def flown(transit):
    data = fly(load_scenario(transit=transit, **PAPER), "mpc").dataset.isel(time=slice(0, -1))
    return features(data["state"].values, data["target"].values), data["force"].values / LIMIT


class Network(LeafSystem):
    def __init__(self, network):
        super().__init__()
        self.network = network
        self.state = self.DeclareVectorInputPort("state", 6)
        self.target = self.DeclareVectorInputPort("target", 6)
        self.DeclareVectorOutputPort("force", 3, self.calc_force)

    def calc_force(self, context, output):
        known = features(self.state.Eval(context), self.target.Eval(context))
        with torch.no_grad():
            force = self.network(torch.tensor(known).float()).clamp(-1.0, 1.0)
        output.SetFromVector(LIMIT * force.numpy())


torch.manual_seed(0)
torch.set_num_threads(1)
flights = [flown(transit) for transit in range(6)]
inputs = torch.tensor(np.vstack([rows for rows, _ in flights])).float()
forces = torch.tensor(np.vstack([rows for _, rows in flights])).float()
layers = [torch.nn.Linear(9, 48), torch.nn.SiLU(), torch.nn.Linear(48, 48), torch.nn.SiLU()]
network = torch.nn.Sequential(*layers, torch.nn.Linear(48, 3))
optimiser = torch.optim.Adam(network.parameters(), lr=5e-3, weight_decay=1e-5)
for epoch in range(301):
    loss = torch.nn.functional.mse_loss(network(inputs), forces)
    optimiser.zero_grad()
    loss.backward()
    optimiser.step()
    if epoch % 100 == 0:
        print(f"epoch {epoch}: error {LIMIT * loss.item() ** 0.5:.2f} N")
log = fly(load_scenario(transit=20, **PAPER), Network(network))
print("success:", log.summary["success"], "miss (m):", log.summary["terminal_position_error_m"])
