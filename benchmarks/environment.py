"""Steps a second of the batch of transits for learners (`TransitBatch`), on one core.

A simple pilot flies it: a spring and a damper. It reaches its goals where nothing blocks the way.
Where the body blocks the way, most flights end in it, and others begin.

    python benchmarks/environment.py [--transits 512] [--steps 300]
"""

import argparse
import time

import gymnasium
import numpy as np
from _kept import keep
from rich.console import Console
from rich.table import Table

import proxops.training.environment  # noqa: F401  (registers it)


def steps_a_second(observation: str, transits: int, steps: int) -> float:
    """Environment steps for each second of processor time."""
    mode = "vector_entry_point"
    many = gymnasium.make_vec(
        "proxops/Transit-v0", transits, vectorization_mode=mode, observation=observation
    )
    seen, _ = many.reset(seed=1)
    actions = np.zeros((transits, 3))
    began = 0.0
    for k in range(steps + 1):
        if k == 1:  # The first loads what is compiled.
            began = time.process_time()
        if observation == "state":
            way, velocity = seen["goal"] - seen["state"][:, :3], seen["state"][:, 3:]
            actions = np.clip(2e-4 * way - 0.15 * velocity, -1.0, 1.0)
        seen = many.step(actions)[0]
    return steps * transits / (time.process_time() - began)


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--transits", type=int, default=512, help="at once")
    parser.add_argument("--steps", type=int, default=300, help="of each, with the state")
    arguments = parser.parse_args()
    table = Table(title=f"{arguments.transits} transits at once, one core")
    table.add_column("observation")
    table.add_column("steps a second", justify="right")
    for observation, share in (("state", 1.0), ("lidar", 0.1)):
        steps = max(1, round(share * arguments.steps))
        found = steps_a_second(observation, arguments.transits, steps)
        keep({f"steps a second of a batch of transits, {observation}": found})
        table.add_row(observation, f"{found:,.0f}")
    Console().print(table)


if __name__ == "__main__":
    main()
