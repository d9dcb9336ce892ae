"""Steps down a slope, against the formulas that they state and against the library that has them too."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch

from maskfab.camera.learning.steps import Adam, Momentum, Steps

RATE, FIRST, SECOND = 0.3, 0.8, 0.99


def start() -> torch.Tensor:
    values = np.random.default_rng(1).standard_normal((4, 3))
    return torch.tensor(values, requires_grad=True)


def slide(place: torch.Tensor, steps: Steps, count: int) -> None:
    """Down a bowl that is steeper along one axis than along the other."""
    for _ in range(count):
        steps.forget()
        (place**2 * torch.tensor([1.0, 5.0, 25.0])).sum().backward()
        steps.step()


def test_adam_is_the_algorithm_as_published():
    place, true = start(), start().detach().numpy().copy()
    slide(place, Adam([place], RATE, (FIRST, SECOND)), 5)
    mean = square = np.zeros_like(true)
    for count in range(1, 6):
        slope = 2 * true * [1.0, 5.0, 25.0]
        mean, square = FIRST * mean + (1 - FIRST) * slope, SECOND * square + (1 - SECOND) * slope**2
        true = true - RATE * mean / (1 - FIRST**count) / (np.sqrt(square / (1 - SECOND**count)) + 1e-8)
    np.testing.assert_allclose(place.detach(), true, rtol=1e-12)


@pytest.mark.parametrize("momentum", [0.0, 0.9])
def test_slopes_add_up_by_their_momentum(momentum):
    place, true = start(), start().detach().numpy().copy()
    slide(place, Momentum([place], 0.01, momentum), 5)
    sum_of_slopes = np.zeros_like(true)
    for _ in range(5):
        sum_of_slopes = momentum * sum_of_slopes + 2 * true * [1.0, 5.0, 25.0]
        true = true - 0.01 * sum_of_slopes
    np.testing.assert_allclose(place.detach(), true, rtol=1e-12)


MADE: list[Callable[[torch.Tensor], Steps]] = [
    lambda place: Adam([place], RATE, (FIRST, SECOND)),
    lambda place: Momentum([place], 0.01, 0.9),
]


@pytest.mark.parametrize("made", MADE, ids=["adam", "momentum"])
def test_steps_go_on_from_a_state_as_if_they_had_never_stopped(made):
    whole, parted = start(), start()
    slide(whole, made(whole), 6)
    before = made(parted)
    slide(parted, before, 3)
    after = made(parted)
    after.restore(before.state)
    slide(parted, after, 3)
    assert torch.equal(whole, parted)


def test_what_has_no_slope_stays():
    moved, still = start(), start()
    steps = Adam([still, moved], RATE, (FIRST, SECOND))
    slide(moved, steps, 1)
    assert torch.equal(still, start())
    assert not torch.equal(moved, start())
    assert list(steps.state) == [1]


@pytest.mark.slow
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_every_bit_is_that_of_torch(dtype):
    """Not in every test run, for the compiler that torch imports for it."""
    betas = FIRST, SECOND
    pairs = [
        (lambda place: Adam([place], RATE, betas), lambda place: torch.optim.Adam([place], RATE, betas)),
        (lambda place: Momentum([place], 0.01, 0.9), lambda place: torch.optim.SGD([place], 0.01, 0.9)),
        (lambda place: Momentum([place], 0.01, 0.0), lambda place: torch.optim.SGD([place], 0.01)),
    ]
    for ours, theirs in pairs:
        one, other = (start().detach().to(dtype).requires_grad_() for _ in range(2))
        mine, known = ours(one), theirs(other)
        for _ in range(20):
            for place in (one, other):
                place.grad = None
                (place**2 * torch.tensor([1.0, 5.0, 25.0], dtype=dtype)).sum().backward()
            mine.step()
            known.step()
        assert torch.equal(one, other)
