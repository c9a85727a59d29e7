"""The expert's plans at all members of a family, as labels."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from proxops.diagrams.flight import Workers
from proxops.diagrams.scenario import Scenario
from proxops.systems.common import derived_seed
from proxops.training.data import Labels, joined_labels, portion_labels, portions_of


def family_plans(
    scenarios: Sequence[Scenario],
    transits_each: int,
    seed: int,
    folder: Path,
    workers: Workers = Workers(),
) -> Labels:
    """States, goals and forces as of `expert_plans`, and the number of the scenario of each.

    Every scenario has transits of its own, drawn from the seed and the scenario's number. Plans are
    kept in the folder, in portions, and are not computed again, also if scenarios are added.

    Args:
      scenarios: in a fixed order.
      transits_each: number of transits of each.
      seed: of the transits.
      folder: for the plans.
      workers: compute the plans, and report how many transits are ready.

    Returns:
      `state` (N, 6), `goal` (N, 3) and `force` (N, 3) in K and SI, and `member` (N,), int: the
      index in `scenarios`.

    Raises:
      InputError: a file in the folder is damaged or holds other plans.
    """
    portions, members = [], []
    for number, scenario in enumerate(scenarios):
        own = portions_of(
            scenario, derived_seed(seed, number), transits_each, f"member-{number:05d}"
        )
        portions += own
        members += [number] * len(own)
    parts = portion_labels(portions, folder, workers)
    sizes = [len(part["state"]) for part in parts]
    return joined_labels(parts) | {"member": np.repeat(np.array(members), sizes)}
