"""The pilot's filter against a Kalman filter of full matrices, and its motion."""

import numpy as np
import pytest
import torch
from torch import Tensor

from proxops.training.networks.state_filter import MEMORY, Motion, StateFilter

PERIOD = 10.0


def corrected(subject: StateFilter, memory: Tensor, fix: Tensor, noise: float = 1.0) -> Tensor:
    return subject.correct(memory, fix - memory[:, :3], torch.full((1, 1), noise))


def still_filter() -> StateFilter:
    """One whose motion is thrust alone: 1 m/s^2 for 100 N."""
    motion = Motion(100e3, 20.0, 0.01, PERIOD)
    with torch.no_grad():
        for weights in motion.parameters():
            weights.zero_()
        motion.per_newton.copy_(torch.eye(3))
    return StateFilter(motion)


@torch.no_grad()
def test_is_a_kalman_filter():
    """Nine states, full matrices, numpy: the same means after forty steps of noisy fixes."""
    subject = still_filter()
    deviations = np.exp(subject.logs.double().numpy())
    eye = np.eye(3)
    h, k = PERIOD, 0.5 * PERIOD**2
    step = np.kron(np.array([[1.0, h, k], [0.0, 1.0, h], [0.0, 0.0, 1.0]]), eye)
    noise = np.kron(np.diag(deviations[1:4] ** 2), eye)
    seen = np.hstack([eye, np.zeros((3, 6))])
    random = np.random.default_rng(0)
    mean, covariance = np.zeros(9), np.zeros((9, 9))
    memory = torch.zeros(1, MEMORY)
    place, velocity = np.array([120e3, -40e3, 30e3]), np.array([1.0, -2.0, 0.5])
    for index in range(40):
        force = random.normal(0.0, 2.0, 3)
        place = place + h * velocity + k * force / 100.0
        velocity = velocity + h * force / 100.0
        fix = place + random.normal(0.0, 20.0, 3)
        memory = subject.predict(memory, torch.tensor(force[None]).float())
        memory = corrected(subject, memory, torch.tensor(fix[None]).float())
        if index == 0:
            mean[:3] = fix
            covariance = np.kron(np.diag(deviations[4:] ** 2), eye)
        else:
            mean = step @ mean + np.concatenate([k * force, h * force, np.zeros(3)]) / 100.0
            covariance = step @ covariance @ step.T + noise
        gain = (
            covariance
            @ seen.T
            @ np.linalg.inv(seen @ covariance @ seen.T + deviations[0] ** 2 * eye)
        )
        mean = mean + gain @ (fix - seen @ mean)
        covariance = covariance - gain @ seen @ covariance
    found = memory[0].numpy()
    np.testing.assert_allclose(found[:3], mean[:3], atol=0.2)
    np.testing.assert_allclose(found[3:6], mean[3:6], atol=2e-2)
    np.testing.assert_allclose(found[6:9], mean[6:9], atol=2e-4)
    assert np.linalg.norm(found[3:6] - velocity) < 1.0


@pytest.mark.parametrize("steps", [500, pytest.param(10_000, marks=pytest.mark.slow)])
@torch.no_grad()
def test_covariance_stays_one_over_a_long_flight(steps: int):
    """Many steps in single precision, with fixes that surprise now and then."""
    subject = still_filter()
    memory = torch.zeros(1, MEMORY)
    fixes = 30.0 * torch.randn(steps, 1, 3, generator=torch.Generator().manual_seed(0))
    fixes[::97] *= 40.0
    upper = []
    for fix in fixes:
        memory = corrected(subject, subject.predict(memory, torch.zeros(1, 3)), fix)
        upper.append(memory[0, 9:15].double())
    matrices = torch.zeros(len(fixes), 3, 3, dtype=torch.float64)
    rows, columns = torch.triu_indices(3, 3)
    matrices[:, rows, columns] = torch.stack(upper)
    matrices[:, columns, rows] = torch.stack(upper)
    scales = matrices.diagonal(dim1=1, dim2=2).sqrt()
    correlations = matrices / scales[:, :, None] / scales[:, None]
    assert float(torch.linalg.eigvalsh(correlations).min()) > 0.0
    assert float(memory[:, 3:6].norm()) < 3.0
