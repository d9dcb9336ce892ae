"""A band-limited picture on a grid, taken by pixels that lie anywhere, are of any size, and turned against it.

Samples closer than the picture's limit asks for say all about it: between them it is the sum of a sinc under a Gaussian
(L. Qian, Proc. Am. Math. Soc. 131, 1169, 2003), whose error falls with exp(-π N (1 - 1/q) / 2) for N samples to each
side and q times as many as needed. A turn is three shears (M. Unser et al., IEEE Trans. Image Process. 4, 1371, 1995).
"""

from __future__ import annotations

import math

import numpy as np
import scipy
from numpy.polynomial.legendre import leggauss

from maskfab.base.arrays import Floats

OVERSAMPLING = 1.3
"""Samples on a grid for each that the picture's limit asks for."""
MARGIN = 24
"""Samples that a grid must hold beyond the outermost pixel."""
_WIDTH = math.sqrt(MARGIN / (math.pi * (1 - 1 / OVERSAMPLING)))
_ALIASED, _REACH = 0.77, 4.5
_NODES = 8
"""Of the mean over a pixel, which holds a few samples across."""


def pixel_means(samples: int, centres: Floats, width: float) -> Floats:
    """Matrix [pixels, samples] that turns samples along an axis into means over pixels.

    Args:
        samples: odd; the middle one lies at 0, neighbours are 1 apart.
        centres: of the pixels, in samples, [pixels].
        width: of a pixel, in samples.
    """
    nodes, weights = leggauss(_NODES)
    places = centres[:, None] + width / 2 * nodes
    first = np.floor(places).astype(np.intp) - MARGIN + 1
    offsets = np.arange(2 * MARGIN)
    away = places[..., None] - (first[..., None] + offsets)
    values = np.sinc(away) * np.exp(-(away**2) / (2 * _WIDTH**2)) * (weights[:, None] / 2)
    columns = first[..., None] + offsets + samples // 2
    rows = np.broadcast_to(np.arange(centres.size)[:, None, None], columns.shape)
    held = (columns >= 0) & (columns < samples)
    parts = (values[held], (rows[held], columns[held]))
    return scipy.sparse.coo_array(parts, shape=(centres.size, samples)).toarray()  # type: ignore[no-any-return]


def gaussian_nodes(sigma: float) -> tuple[Floats, Floats]:
    """Places and weights that stand for a Gaussian under which such a picture is smoothed, by the trapezoid rule.

    Its repetitions along the frequency fall on the picture's band with less than 1e-5 of themselves.

    Args:
        sigma: standard deviation, in samples; 0 of a point.
    """
    if not sigma:
        return np.zeros(1), np.ones(1)
    apart = 1 / (1 / (2 * OVERSAMPLING) + _ALIASED / sigma)
    count = math.ceil(_REACH * sigma / apart)
    places = np.asarray(apart * np.arange(-count, count + 1), dtype=np.float64)
    weights = np.exp(-((places / sigma) ** 2) / 2)
    return places, np.asarray(weights / weights.sum())


def turned(picture: Floats, angle_rad: float) -> Floats:
    """The picture [n, n] turned counter-clockwise about its middle sample, rows upwards, by less than a radian."""
    if angle_rad == 0:
        return picture
    across, up = -math.tan(angle_rad / 2), math.sin(angle_rad)
    return _sheared(_sheared(_sheared(picture, across), up, rows=False), across)


def _sheared(picture: Floats, slope: float, *, rows: bool = True) -> Floats:
    """Rows moved by slope times their height; or columns by slope times their place."""
    values = picture if rows else picture.T
    count = values.shape[1]
    size = scipy.fft.next_fast_len(count + 2 * MARGIN, real=True)
    height = np.arange(values.shape[0]) - values.shape[0] // 2
    waves = np.fft.rfftfreq(size)
    moved = scipy.fft.irfft(
        scipy.fft.rfft(values, size, axis=1) * np.exp(-2j * np.pi * slope * height[:, None] * waves), size, axis=1
    )[:, :count]
    return moved if rows else moved.T  # type: ignore[no-any-return]
