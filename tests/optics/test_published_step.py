"""The published step is what it says: its sizes, its figure of merit, and the same slope as ours."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from optics.published_step import PublishedStep, published_step

from maskfab.designs.descent.objective import invertibility_of, tiled_stop
from maskfab.job.camera import Camera, Stop

CAMERA = Camera(10_000.0, Stop("circle", 4000.0), (610.0, 530.0, 470.0), 2.0, 256.0)
TURNED = np.random.default_rng(0).integers(8, size=(24, 24)).astype(np.int8)


@pytest.fixture(scope="module")
def step() -> PublishedStep:
    return published_step(21, TURNED)


def test_sizes_have_large_primes(step: PublishedStep) -> None:
    assert step.sizes == (1524, 1324, 1174) == (12 * 127, 4 * 331, 2 * 587)


def test_the_open_stop_has_its_blue_figure_of_merit(step: PublishedStep) -> None:
    """0.659 from the published files; every pixel sums 4 x 4 samples off its middle, so the true one is 0.720."""
    red, green, blue = step.auc(np.ones((21, 21), dtype=np.bool_))
    assert blue == pytest.approx(0.659, abs=0.003)
    assert red > 0.7
    assert green > 0.7


@pytest.mark.slow
def test_its_gradient_points_where_ours_does(step: PublishedStep) -> None:
    unit = torch.rand(21, 21, generator=torch.Generator().manual_seed(0))
    loss = invertibility_of(tiled_stop(21, 8000, TURNED, CAMERA), own_sum=True)
    leaf = unit.clone().requires_grad_()
    (ours,) = torch.autograd.grad(loss(leaf), leaf)
    both = torch.stack([ours.flatten().double(), step.gradient(unit).flatten()])
    assert float(torch.corrcoef(both)[0, 1]) > 0.99
