"""A guidance that has learned nothing: it flies the law of least effort alone."""

from pathlib import Path

import torch
from short_flights import kleopatra, short_scenario

from proxops.diagrams.flight import surroundings
from proxops.systems.policy import INPUTS
from proxops.training.export import export_guidance
from proxops.training.loop import seeded
from proxops.training.networks import AnyBodyGuidance
from proxops.training.recipes.any_body import ranges_of


def write_guidance(folder: Path) -> Path:
    """Writes its bundle, for the default scenario's proportions; gives the folder."""
    with seeded(0):
        network, rows = AnyBodyGuidance(16), torch.rand(8, INPUTS) + 0.5
    last = network.network[-1]
    assert isinstance(last, torch.nn.Linear)
    torch.nn.init.zeros_(last.weight)
    ranges = ranges_of([surroundings(short_scenario(), kleopatra())])
    report = {"recipe": "any-body", "data_sha256": "", "training": {}}
    export_guidance(network.eval(), folder, rows, ranges, report, "# Nothing\n")
    return folder
