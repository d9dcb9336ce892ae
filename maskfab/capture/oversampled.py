r"""The edge spread on a grid finer than the pixels, from all lines across an edge at once.

Step 5 of the slanted-edge method of ISO 12233, with one change. There every sample falls into the bin of a quarter of a
pixel that holds its distance from the edge, and bins are means. Here the edge spread is the piecewise linear function,
with knots a quarter of a pixel apart, that is nearest to the samples: where they lie unevenly within a bin, its mean is
off, a line's slope is not. Least squares add up line by line, so a resample of lines is a sum with other weights.

    Projected onto such functions, a wave of ν cycles per knot is passed by sinc²(ν) / ((2 + cos 2πν) / 3); differences
    of neighbouring knots in place of the derivative pass sinc(ν) of it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from maskfab.base.arrays import Floats, Mask
from maskfab.model import frozen

# What holds knots together that a resample leaves without samples, as a share of the mean weight of a knot.
_TIE = 1e-6


@dataclass(frozen=True, eq=False)
class NormalSums:
    """Normal equations of the edge spread, line by line: tridiagonal, one row of them for each line.

    Attributes:
        knots_px: float64 [k], distance from the edge along its normal, a step apart about 0.
        diagonal: float64 [lines, k].
        beside: float64 [lines, k - 1].
        right: float64 [lines, k].
    """

    knots_px: Floats
    diagonal: Floats
    beside: Floats
    right: Floats

    def __post_init__(self) -> None:
        for name in ("knots_px", "diagonal", "beside", "right"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    @property
    def step_px(self) -> float:
        return float(self.knots_px[1] - self.knots_px[0])

    def spreads(self, weights: Floats) -> Floats:
        """Edge spreads at the knots, [n, k], for weights of the lines, [n, lines]."""
        diagonal, beside, right = weights @ self.diagonal, weights @ self.beside, weights @ self.right
        tie = _TIE * float(diagonal.mean())
        diagonal[:, :-1] += tie
        diagonal[:, 1:] += tie
        beside -= tie
        found = np.empty_like(right)
        for k, band in enumerate(zip(diagonal, beside, right, strict=True)):
            packed = np.stack([np.concatenate([[0.0], band[1]]), band[0]])
            found[k] = scipy.linalg.solveh_banded(packed, band[2], check_finite=False)
        return found


def normal_sums(distance_px: Floats, values: Floats, counts: Mask, half_px: float, step_px: float) -> NormalSums:
    """Sums for samples of lines at distances from the edge, [lines, samples] each.

    Args:
        distance_px: along the edge's normal.
        values: of the samples.
        counts: which of them are used; those farther than ``half_px`` are not.
        half_px: a whole number of steps.
        step_px: between knots.
    """
    side = round(half_px / step_px)
    size = 2 * side + 1
    place = distance_px / step_px + side
    below = np.floor(place)
    used = counts & (below >= 0) & (below < size - 1)
    line = np.nonzero(used)[0]
    share = (place - below)[used]
    flat = line * size + below[used].astype(np.intp)
    lines = len(values)

    def summed(at: NDArray[np.intp], weight: Floats) -> Floats:
        return np.asarray(np.bincount(at, weight, lines * size), np.float64).reshape(lines, size)

    diagonal = summed(flat, (1 - share) ** 2) + summed(flat + 1, share**2)
    beside = summed(flat, share * (1 - share))[:, :-1]
    right = summed(flat, (1 - share) * values[used]) + summed(flat + 1, share * values[used])
    return NormalSums(step_px * (np.arange(size, dtype=np.float64) - side), diagonal, beside, right)


def passed(cycles_per_px: Floats, step_px: float) -> Floats:
    """Share of a wave that projection and differences leave: to be divided by."""
    cycles = cycles_per_px * step_px
    return np.asarray(np.sinc(cycles) ** 3 * 3 / (2 + np.cos(2 * np.pi * cycles)))
