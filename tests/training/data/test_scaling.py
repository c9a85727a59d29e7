"""A small body's pilot and its examples are those of a large body in smaller units."""

import dataclasses as dc

import numpy as np
import torch
from short_flights import kleopatra

from proxops.systems import ray_directions
from proxops.systems.shapes.ray_casting import ray_caster
from proxops.training.data.scaling import Scaling, scaling_for
from proxops.training.networks import MEMORY, PilotDimensions
from proxops.training.recipes.pilot_losses import estimate_error, force_loss

# As much smaller; a power of two, so that it rounds nothing.
SMALL = 1.0 / 128.0
DIMENSIONS = PilotDimensions(
    planes=12, rays=360, hits=64, period=10.0, mass=100.0, thrust_limit=7.0, length=98e3,
    keep_out=(140e3, 70e3, 65e3), low=(-130e3, -50e3, -50e3), high=(130e3, 50e3, 50e3),
    spacing=10e3, coarse_width=8, motion_width=8, guidance_width=8,
)  # fmt: skip


def scaled(dimensions: PilotDimensions, size: float) -> PilotDimensions:
    """Those for a body `size` times as large, of the same density and spin."""

    def times(values: tuple[float, float, float]) -> tuple[float, float, float]:
        x, y, z = (size * value for value in values)
        return x, y, z

    return dc.replace(
        dimensions,
        thrust_limit=size * dimensions.thrust_limit,
        length=size * dimensions.length,
        spacing=size * dimensions.spacing,
        keep_out=times(dimensions.keep_out),
        low=times(dimensions.low),
        high=times(dimensions.high),
    )


@torch.no_grad()
def test_a_pilot_of_a_small_body_flies_as_one_of_a_large_one():
    large, small = (make(each) for each in (DIMENSIONS, scaled(DIMENSIONS, SMALL)))
    for pilot in (large, small):
        pilot.filter.motion.per_newton.copy_(1.02 * torch.eye(3))
    large.fit_residual(torch.tensor([300.0]))
    small.fit_residual(torch.tensor([300.0 * SMALL]))
    random = np.random.default_rng(0)
    places = np.linspace([150e3, 20e3, 10e3], [150e3, 22e3, 11e3], 6)
    frames = ray_caster(kleopatra().shape).fan(ray_directions()).frames(places)
    false = random.integers(0, frames.shape[1], 40)
    frames[:, false] = random.uniform(10e3, 300e3, 40)
    target = np.array([-60e3, 110e3, -50e3, 0.0, 0.0, 0.0])
    memories = [torch.zeros(1, MEMORY), torch.zeros(1, MEMORY)]
    for frame in frames:
        applied = random.normal(0.0, 1.0, 3)
        answers = []
        for k, (pilot, size) in enumerate(((large, 1.0), (small, SMALL))):
            given = (torch.tensor(size * x[None]).float() for x in (frame, target, applied))
            force, estimate, memories[k] = pilot(*given, memories[k])
            answers.append((force / size, estimate / size))
        torch.testing.assert_close(answers[1][0], answers[0][0], rtol=1e-4, atol=1e-4)
        torch.testing.assert_close(answers[1][1], answers[0][1], rtol=1e-5, atol=0.02)


def make(dimensions: PilotDimensions):
    torch.manual_seed(0)
    return dimensions.make().eval()


def test_losses_of_similar_errors_are_the_same():
    random = torch.Generator().manual_seed(0)
    force, wanted = torch.randn(2, 50, 3, generator=random)
    small = force_loss(SMALL * force, SMALL * wanted, SMALL * 7.0)
    torch.testing.assert_close(small, force_loss(force, wanted, 7.0))
    estimate, state = torch.randn(2, 50, 6, generator=random)
    scaling = scaling_for(SMALL * 98e3, 100.0, SMALL * 7.0)
    assert scaling == Scaling(SMALL, SMALL, SMALL, SMALL)
    torch.testing.assert_close(
        estimate_error(SMALL * estimate, SMALL * state, scaling),
        estimate_error(estimate, state, Scaling()),
    )
