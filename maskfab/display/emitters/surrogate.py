"""Fraction of a pixel's closed area that is wide enough for emitters, with a gradient for optimisers."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch.nn import functional

from maskfab.errors import JobError


def compactness(mask: torch.Tensor | NDArray[np.floating | np.bool_], width: int) -> torch.Tensor:
    """Share of the pixel that closed squares of the least width cover: a grey-scale opening, mean taken.

    On a mask of zeros and ones it is exact. In between, erosion is the minimum and dilation the maximum over the
    square (J. Serra, Image Analysis and Mathematical Morphology, 1982), so that the gradient goes to the dots that
    decide: those whose closing would widen a corridor.

    Args:
        mask: [..., n, n] transmission of the dots, 1 is clear.
        width: side of the square in dots.

    Returns:
        [...] shares from 0 to 1, differentiable with respect to ``mask`` almost everywhere.

    Raises:
        JobError: MF117 if the square is wider than the pixel or has no width.
    """
    clear = mask if isinstance(mask, torch.Tensor) else torch.from_numpy(np.asarray(mask, dtype=np.float64))
    n = min(clear.shape[-2:])
    if not 1 <= width <= n:
        raise JobError(
            "MF117",
            f"a width of {width} dots is not within the {n} dots of the pixel",
            where="emitters.min_width",
            cure=f"Give a width from 1 to {n} dots",
        )
    batch = clear.reshape(-1, 1, *clear.shape[-2:])
    if not batch.is_floating_point():
        batch = batch.to(torch.get_default_dtype())
    squares = 1 - functional.max_pool2d(batch, width, stride=1)
    rim = width - 1
    # Zeros do no harm: no closed square is less than 0.
    opened = functional.max_pool2d(functional.pad(squares, (rim, rim, rim, rim)), width, stride=1)
    return opened.mean(dim=(-1, -2, -3)).reshape(clear.shape[:-2])
