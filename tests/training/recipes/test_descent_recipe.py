"""The recipe for a descent, small: its examples are plans, and what flies is what was trained."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from proxops.diagrams.flight import Workers
from proxops.systems.policy import DESCENT_INPUTS, DescentBundle
from proxops.training.loop import Schedule
from proxops.training.networks import DescentCorrection
from proxops.training.recipes.descent import (
    DescentSettings,
    Examples,
    Places,
    relative_errors,
    train_descent,
    turned,
)

SMALL = dataclasses.replace(
    DescentSettings().quick(),
    bodies=2,
    sites=2,
    states=10,
    width=8,
    schedule=Schedule(epochs=2, batch=16, learning_rate=2e-3),
)


def test_a_law_is_near_the_program_at_any_place() -> None:
    rows = Places("body", 3, dataclasses.replace(SMALL, sites=3, states=40)).compute()
    again = Places("body", 3, dataclasses.replace(SMALL, sites=3, states=40)).compute()
    np.testing.assert_array_equal(rows, again)
    examples = Examples.of([rows])
    off = relative_errors(examples.law, examples.wanted)
    assert len(off) >= 40
    assert off.median() < 0.15


def test_examples_are_turned_about_the_normal() -> None:
    random = np.random.default_rng(1)
    given, law, wanted = (
        torch.from_numpy(random.normal(size=(5, size))) for size in (DESCENT_INPUTS, 3, 3)
    )
    angles = torch.from_numpy(random.uniform(-3.0, 3.0, 5))
    more, law_turned, wanted_turned = turned(given, law, wanted, angles)
    for k in range(5):
        about = Rotation.from_rotvec([0.0, 0.0, float(angles[k])])
        for before, after in ((law, law_turned), (wanted, wanted_turned)):
            np.testing.assert_allclose(after[k], about.apply(before[k]), rtol=1e-12)
        vectors = given[k, :15].reshape(5, 3)
        np.testing.assert_allclose(more[k, :15].reshape(5, 3), about.apply(vectors), rtol=1e-12)
    np.testing.assert_array_equal(more[:, 15:], given[:, 15:])


def test_from_plans_to_a_bundle(tmp_path: Path) -> None:
    told: list[str] = []
    workers = Workers(1, progress=lambda done, text: told.append(text))
    report = train_descent(tmp_path, SMALL, workers)
    assert told[:2] == ["plans at bodies, 1 of 2", "plans at bodies, 2 of 2"]
    assert report == json.loads((tmp_path / "report.json").read_text())
    assert report["training"]["epochs"] == 2
    assert 0 < report["force_errors"]["held out"]["states"] <= 20
    bundle = DescentBundle.load(tmp_path / "bundle")
    train_descent(tmp_path, SMALL)  # It is trained already.
    assert DescentBundle.load(tmp_path / "bundle").sha256 == bundle.sha256


def test_what_flies_is_what_was_trained() -> None:
    torch.manual_seed(2)
    network = DescentCorrection(8)
    torch.nn.init.normal_(network.last.weight)
    given = 3.0 * torch.randn(20, DESCENT_INPUTS)
    got = network.compiled().correction(given.numpy())
    np.testing.assert_allclose(got, network(given).detach(), rtol=1e-4, atol=1e-5)
