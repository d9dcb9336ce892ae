r"""A window's intensity along rays from the axis, on which all wavelengths are one function.

A mask that only dims has at the place p of the sensor the intensity I(p / (λf)) / (λf)² for every wavelength, I the
squared modulus of one field (Goodman, Fourier Optics, 4.4.2 and 6.3). On the ray t -> (t, st) it is one even function
of t, whose Fourier integral ends at the longest lag of the pupil along the ray. So samples of I on rays, taken once,
give any sum over wavelengths by one product: its matrix interpolates I to all the p / (λf) and adds them up.

Both interpolations are polynomials through the nearest samples of an even grid. Their errors fall as the power of the
number of samples that a wave's phase from one to the next is of π.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Floats
from maskfab.optics.field.parity import SampledField

_TAPS = 14
# Samples for each that the longest lag needs at least.
_OVERSAMPLING = 5.0

RAYS_ERROR = 4e-8
"""Relative error of the wave of the longest lag, twice Π|x - k| (π/n)^14 / 14! halfway between samples; of all others
far less. Rounding comes on top."""

_BLOCK = 256
_PLACES = 16


@dataclass(frozen=True, eq=False)
class Rays:
    """|F|² on rays (t, st) and (st, t), 0 < s < 1, and on their mirror images, which with t < 0 make the whole plane.

    Attributes:
        step: between samples t = 0, step, ..., in cycles per micrometre.
        values: [t, rays].
    """

    step: float
    values: Floats

    @classmethod
    def of(cls, field: SampledField, reach_um: float, highest: float, slopes: Floats) -> Rays:
        """Sample a field along rays.

        Args:
            field: known as far as :func:`beyond` says along both axes.
            reach_um: most of x + sy, of its light and for any of the slopes.
            highest: t that will be asked for, cycles per micrometre.
            slopes: s of the rays.
        """
        step, count = _grid(reach_um, highest)
        t = step * np.arange(count + _TAPS, dtype=np.float64)
        values = np.empty((count, slopes.size, 4))
        for start in range(0, count, _BLOCK):
            block = t[start : min(start + _BLOCK, count)]
            # Beyond the diagonal no ray needs the field, but for the neighbours of those close to it.
            inner = t[: start + block.size + _TAPS]
            along_x, along_y = (field.field(*axes).quadrants() for axes in ((block, inner), (inner, block)))
            tall = [each.T for each in along_x]
            # The four that share their neighbours side by side in memory.
            sides = [_mirrored(*pair) for pair in (tall, tall[::-1], along_y, along_y[::-1])]
            known = np.stack(sides, axis=-1).reshape(-1, 4)
            first, weights = _neighbours(np.arange(start, start + block.size)[:, None] * slopes)
            first += _TAPS + (inner.size + _TAPS) * np.arange(block.size)[:, None]
            near = weights[..., None]
            found = values[start : start + block.size]
            np.multiply(near[0], known[first], out=found)
            for k in range(1, _TAPS):
                found += near[k] * known[first + k]
        return cls(step, values.reshape(count, -1))

    def combined(self, places: Floats, scales: Floats, weights: Floats) -> Floats:
        """Σ_k w_k |F(p / c_k)|² at places p along all rays, [p, rays].

        Args:
            places: p > 0, float64 [p], ascending.
            scales, weights: c_k and w_k, float64 [k].
        """
        count = self.values.shape[0]
        found = np.empty((places.size, self.values.shape[1]))
        for start in range(0, places.size, _PLACES):
            some = places[start : start + _PLACES]
            first, near = _neighbours(some[:, None] / scales / self.step)
            near *= weights
            index = abs(first + np.arange(_TAPS)[:, None, None])
            used = slice(int(index.min()), int(index.max()) + 1)
            index += count * np.arange(some.size)[:, None]
            matrix = np.bincount(index.ravel(), near.ravel(), count * some.size).reshape(-1, count)[:, used]
            np.matmul(matrix, self.values[used], out=found[start : start + some.size])
        return found


def beyond(reach_um: float, highest: float) -> float:
    """The highest frequency at which rays look at a field; arguments as for :meth:`Rays.of`."""
    step, count = _grid(reach_um, highest)
    return step * (count + _TAPS - 1)


def _grid(reach_um: float, highest: float) -> tuple[float, int]:
    """Step and number of samples."""
    step = 1 / (4 * _OVERSAMPLING * reach_um)
    return step, math.ceil(highest / step) + _TAPS


def _mirrored(same: Floats, opposite: Floats) -> Floats:
    """[t, taps + r] along a grid of r >= 0 and before it ``_TAPS`` samples of r < 0, which the other quadrant has."""
    return np.concatenate([opposite[:, _TAPS:0:-1], same], axis=1)


def _neighbours(place: Floats) -> tuple[NDArray[np.intp], Floats]:
    """The first of the nearest points of the grid of whole numbers, [...], and Lagrange's weights, [taps, ...]."""
    first = np.floor(place).astype(np.intp) - (_TAPS // 2 - 1)
    node = np.arange(_TAPS, dtype=np.float64)
    apart = (place - first) - node.reshape(-1, *(1 for _ in place.shape))
    # At a node the others' weights come out as nothing, and its own as one.
    apart[apart == 0] = np.finfo(np.float64).tiny
    scale = [(-1) ** (_TAPS - 1 - k) * math.factorial(k) * math.factorial(_TAPS - 1 - k) for k in range(_TAPS)]
    weights: Floats = apart.prod(axis=0) / apart / np.reshape(scale, (-1, *(1 for _ in place.shape)))
    return first, weights
