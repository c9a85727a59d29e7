"""The parts of the learned pilot against plain numpy and closed forms, and all of it exported."""

from pathlib import Path

import numpy as np
import pytest
import torch
from short_flights import kleopatra

from proxops.systems import PolicyBundle, ray_directions
from proxops.systems.expert.plan import Horizon
from proxops.systems.policy import PolicyFacts, run_network
from proxops.systems.shapes.ray_casting import ray_caster
from proxops.training.export import export_policy
from proxops.training.networks.coarse_position import CoarsePosition
from proxops.training.networks.geometry_layer import GeometryLayer, SurfaceField
from proxops.training.networks.guidance import Guidance
from proxops.training.networks.lidar_hits import HitSelection
from proxops.training.networks.pilot_network import Pilot
from proxops.training.networks.state_filter import MEMORY, Motion, StateFilter
from proxops.training.recipes.pilot_losses import force_loss

PLACES = np.array([[150e3, 20e3, 10e3], [-60e3, 110e3, -50e3], [10e3, -20e3, 140e3]])


def frames(places: np.ndarray) -> np.ndarray:
    fan = ray_caster(kleopatra().shape).fan(ray_directions())
    return fan.frames(places).astype(np.float32)


def supported(frame: np.ndarray) -> list[int]:
    """Rays with two of the four beside them that agree, one by one."""
    plane = frame.reshape(12, 360)
    kept = []
    for i, j in np.argwhere(np.isfinite(plane)):
        agreeing = 0
        for shift in (-2, -1, 1, 2):
            other = plane[i, (j + shift) % 360]
            close = abs(other - plane[i, j]) < 5e3 + 0.15 * plane[i, j]
            agreeing += bool(np.isfinite(other) and close)
        if agreeing >= 2:
            kept.append(int(360 * i + j))
    return kept


def test_hits_are_those_that_others_support():
    given = frames(PLACES)
    random = np.random.default_rng(0)
    false = random.integers(0, given.shape[1], 30)
    given[:, false] = random.uniform(10e3, 300e3, 30).astype(np.float32)
    points, solid, valid, count = HitSelection(12, 360, 2000)(torch.from_numpy(given))
    for k, frame in enumerate(given):
        expected = supported(frame)
        assert int(count[k]) == np.isfinite(frame).sum()
        found = points[k][valid[k] > 0].numpy()
        wanted = frame[expected, None] * ray_directions()[expected]
        order = [np.lexsort(part.T.round(0)) for part in (found, wanted)]
        np.testing.assert_allclose(found[order[0]], wanted[order[1]], rtol=1e-5, atol=0.1)
    assert (solid[valid == 0] == 0).all()


def test_features_do_not_depend_on_the_order_of_returns():
    points, solid, valid, count = HitSelection(12, 360, 300)(torch.from_numpy(frames(PLACES)))
    network = CoarsePosition(100e3)
    expected, centre = network.features(points, solid, valid, count)
    order = torch.randperm(300, generator=torch.Generator().manual_seed(0))
    found, _ = network.features(points[:, order], solid[:, order], valid[:, order], count)
    torch.testing.assert_close(found, expected, rtol=1e-4, atol=1e-4)
    assert torch.isfinite(expected).all()
    # By area, as if each return were a piece of the surface facing the spacecraft.
    x, weight = points.double() / 100e3, solid.double()
    area = weight * (x**2).sum(2)
    by_hand = (area[..., None] * x).sum(1) / area.sum(1, keepdim=True)
    torch.testing.assert_close(centre.double(), by_hand, rtol=1e-5, atol=1e-6)


def plain_guidance(least_time: float) -> Guidance:
    """Guidance whose network says nothing."""
    axes = torch.tensor([140e3, 70e3, 65e3])
    guidance = Guidance(100e3, 20.0, axes, 100.0, 7.0, least_time, 0.03)
    with torch.no_grad():
        for weights in guidance.network[-1].parameters():
            weights.zero_()
    return guidance


@torch.no_grad()
def test_guidance_starts_as_the_law_of_least_effort():
    random = np.random.default_rng(0)
    position, goal = random.uniform(-150e3, 150e3, (2, 20, 3))
    velocity = random.normal(0.0, 5.0, (20, 3))
    given = (torch.tensor(x).float() for x in (position, velocity, goal))
    pull = random.normal(0.0, 1e-3, (20, 3))
    found = plain_guidance(1e-3)(*given, torch.tensor(pull).float()).numpy()
    for k in range(20):
        ends = np.append(position[k], velocity[k]), np.append(goal[k], np.zeros(3))
        time = Horizon(minimum=1e-3).time_to_go(*ends)
        law = 6.0 * (goal[k] - position[k]) / time**2 - 4.0 * velocity[k] / time
        law = law - pull[k]
        np.testing.assert_allclose(found[k], 100.0 * law, rtol=2e-3, atol=2e-3)


def test_the_loss_of_forces_counts_what_the_gate_would_not_take():
    def loss(error: float) -> float:
        wanted = torch.tensor([[1.0, -2.0, 3.0]])
        return float(force_loss(wanted + torch.tensor([[0.0, 0.6, 0.8]]) * error, wanted, 7.0))

    errors = np.geomspace(1e-3, 20.0, 30)
    assert (np.diff([loss(error) for error in errors]) > 0.0).all()
    # Least where the forces are the same, and there like a square.
    assert loss(2e-3) - loss(0.0) == pytest.approx(4.0 * (loss(1e-3) - loss(0.0)), rel=0.02)
    # From one newton to the next it grows most where a hybrid's gate stands, and little far off.
    growth = [loss(error + 0.5) - loss(error) for error in (0.25, 0.75, 2.0, 6.0)]
    assert growth[0] > growth[1] > 2.0 * growth[2] > 2.0 * growth[3] > 0.0


def small_pilot() -> Pilot:
    torch.manual_seed(0)
    vertices = kleopatra().shape.vertices
    motion = Motion(100e3, 20.0, 0.01, 10.0, width=8)
    field = SurfaceField(vertices.min(axis=0), vertices.max(axis=0), 20e3)
    axes = torch.tensor([140e3, 70e3, 65e3])
    guidance = Guidance(100e3, 20.0, axes, 100.0, 7.0, 300.0, 0.03, 16)
    return Pilot(
        HitSelection(12, 360, 64),
        CoarsePosition(100e3, width=16),
        GeometryLayer(field, 1e3),
        StateFilter(motion),
        guidance,
    ).eval()


def facts() -> PolicyFacts:
    body = kleopatra()
    return PolicyFacts(
        recipe="proxops", planes=12, rays=360, period=10.0, thrust_limit=7.0, memory=MEMORY,
        estimates=True, body=body.config.name, shape_sha256=body.shape.sha256, data_sha256="",
    )  # fmt: skip


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("pilot") / "bundle"
    export_policy(small_pilot(), folder, facts(), [flight()])
    return folder


def flight() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Eight steps along a line."""
    places = np.linspace(PLACES[0], PLACES[0] + [0.0, 2e3, 1e3], 8)
    target = np.tile(np.append(PLACES[1], np.zeros(3)), (8, 1))
    return frames(places), target, np.random.default_rng(0).normal(0.0, 1.0, (8, 3))


@pytest.mark.slow
@torch.no_grad()
def test_exported_pilot_says_what_the_trained_one_says(bundle: Path):
    pilot, memory, remembered = small_pilot(), torch.zeros(1, MEMORY), np.zeros(MEMORY)
    session = PolicyBundle.load(bundle).session
    for ranges, target, applied in zip(*flight(), strict=True):
        given = [
            torch.from_numpy(part[None].astype(np.float32)) for part in (ranges, target, applied)
        ]
        force, estimate, memory = pilot(*given, memory)
        said, seen, remembered = run_network(session, ranges, target, applied, remembered)
        np.testing.assert_allclose(said, force[0].numpy(), rtol=1e-3, atol=1e-3)
        np.testing.assert_allclose(seen, estimate[0].numpy(), rtol=1e-4, atol=1.0)
