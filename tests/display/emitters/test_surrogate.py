"""Compactness: the morphological opening of what is closed, with a gradient that can be followed."""

import numpy as np
import pytest
import torch
from scipy import ndimage

from maskfab.display.emitters.surrogate import compactness
from maskfab.errors import JobError


@pytest.mark.parametrize("width", [1, 2, 3, 5])
def test_is_the_opened_share_of_a_binary_mask(width):
    masks = np.random.default_rng(0).random((4, 11, 11)) < 0.2
    expected = [ndimage.binary_opening(~mask, np.ones((width, width))).mean() for mask in masks]
    assert compactness(masks, width).tolist() == pytest.approx(expected)


def test_all_closed_is_one_and_all_clear_is_nothing():
    assert compactness(np.zeros((5, 5)), 3) == 1
    assert compactness(np.ones((5, 5)), 3) == 0


def test_grows_where_an_opening_closes():
    rng = np.random.default_rng(1)
    mask = rng.random((9, 9))
    assert compactness(mask * 0.9, 2) >= compactness(mask, 2)


def test_gradient_is_that_of_finite_differences():
    mask = torch.from_numpy(np.random.default_rng(2).random((6, 6))).requires_grad_()
    assert torch.autograd.gradcheck(lambda one: compactness(one, 2), (mask,), eps=1e-7, atol=1e-6)


def test_descent_makes_room():
    mask = torch.from_numpy(np.random.default_rng(3).random((8, 8))).requires_grad_()
    before = compactness(mask, 2)
    before.backward()
    assert compactness(mask.detach() + 0.01 * mask.grad, 2) > before


@pytest.mark.parametrize("width", [0, 6])
def test_a_width_beyond_the_pixel_is_refused(width):
    with pytest.raises(JobError, match="MF117"):
        compactness(np.zeros((5, 5)), width)
