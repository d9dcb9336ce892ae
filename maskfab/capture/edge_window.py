"""The window about an edge: as wide as the edge spread changes, and no wider, for beyond it there is only noise."""

from __future__ import annotations

import math

import numpy as np

from maskfab.base.arrays import Floats
from maskfab.capture.oversampled import NormalSums

FLAT = 0.6
"""Share of the window that is 1; cosines fall to 0 on either side of it."""

# The edge spread has settled where means over so many pixels differ from its ends by less than so much of the step.
_SETTLED, _BLOCK_PX, _SIGMAS, _ENDS = 0.002, 2.0, 4.0, 0.15
_LEAST_HALF_PX, _MARGIN = 6.0, 1.6


def window(distance_px: Floats, half_px: float) -> Floats:
    """Tukey's window: 1 in the middle, cosines to 0 at ``half_px`` on either side."""
    beyond = (abs(distance_px) / half_px - FLAT) / (1 - FLAT)
    return np.asarray(np.cos(np.pi / 2 * np.clip(beyond, 0, 1)) ** 2)


def settled_px(sums: NormalSums, spread: Floats, noise: float, samples: int) -> float:
    """Reach of a window beyond which the edge spread no longer changes, with a margin; all that there is if it does.

    Args:
        sums: of all lines.
        spread: the edge spread at its knots.
        noise: one standard deviation of a sample.
        samples: their number.
    """
    half, step = float(sums.knots_px[-1]), sums.step_px
    block = round(_BLOCK_PX / step)
    mean = np.convolve(spread, np.full(block, 1 / block), "same")
    ends = max(block, round(_ENDS * spread.size))
    low, high = float(np.mean(spread[:ends])), float(np.mean(spread[-ends:]))
    of_block = noise / math.sqrt(max(samples / (2 * half) * _BLOCK_PX, 1.0))
    off = abs(mean - np.where(sums.knots_px < 0, low, high)) > _SETTLED * abs(high - low) + _SIGMAS * of_block
    # A mean over a block that reaches beyond the ends is none.
    off[:block] = off[-block:] = False
    farthest = float(abs(sums.knots_px[off]).max(initial=0.0))
    wanted = max(_LEAST_HALF_PX, _MARGIN * farthest + _BLOCK_PX)
    return min(half, step * math.ceil(wanted / step))
