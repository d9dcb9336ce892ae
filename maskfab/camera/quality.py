"""Quality of a restored picture against the true one: PSNR, SSIM and S-CIELAB, of code values.

SSIM (Wang, Bovik, Sheikh, Simoncelli 2004) has Gaussian weights of 1.5 pixels out to 5, K1 = 0.01, K2 = 0.03,
population covariances, white 1, and is the mean over channels and all pixels at least 5 from the edge.

S-CIELAB (see :mod:`maskfab.eye.scielab`) is the difference in CIELAB after the eye's blur, for a viewer to whom a pixel
is a minute of arc: the finest that an eye of full acuity tells apart. The picture is mirrored beyond its edges.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy.fft
from numpy.typing import NDArray
from scipy import ndimage

from maskfab.base.arrays import Floats, Singles
from maskfab.camera.restorers.wiener import LARGE
from maskfab.eye.scielab import OPPONENT_OF_RGB, gains
from maskfab.optics.numbers.colour import delta_e_1976, lab_of_linear_srgb, light_of_code

_SIGMA, _REACH = 1.5, 5
_C1, _C2 = 0.01**2, 0.03**2
PIXELS_PER_DEGREE = 60.0
"""For S-CIELAB."""
_AT_ONCE = 1 << 18


def psnr(restored: Singles, truth: Singles) -> float:
    """10 log10 of 1 over the mean squared difference, in dB, over everything; infinite for equal pictures."""
    parts = ((..., strip, slice(None)) for strip in _strips(truth.shape))
    squares = (float(np.square(restored[part] - truth[part]).sum(dtype=np.float64)) for part in parts)
    error = math.fsum(squares) / truth.size
    return float("inf") if error == 0 else float(-10 * np.log10(error))


@dataclass(frozen=True, eq=False)
class Truth:
    """A true picture, and what SSIM and S-CIELAB need of it, strip by strip; of a large one nothing is kept.

    Attributes:
        values: float32 [3, rows, columns].
    """

    values: Singles
    _local: dict[int, tuple[Singles, Singles]] = field(default_factory=dict, init=False, repr=False)

    @property
    def _large(self) -> bool:
        return bool(self.values[0].size > LARGE)

    @cached_property
    def _kept_lab(self) -> NDArray[np.float64]:
        return seen(self.values)

    def ssim(self, restored: Singles) -> Singles:
        """The map of SSIM, [3, rows - 10, columns - 10]."""
        planes, rows, columns = restored.shape
        found = np.empty((planes, rows - 2 * _REACH, columns - 2 * _REACH), dtype=np.float32)
        for strip in _strips(found.shape):
            lines = slice(strip.start, strip.stop + 2 * _REACH)
            true, picture = self.values[:, lines], restored[:, lines]
            true_mean, true_variance = self._moments(lines)
            mean = _blur(picture)
            product = mean * true_mean
            covariance = _blur(picture * true) - product
            square = mean * mean
            variance = _blur(picture * picture) - square
            luminance = (2 * product + _C1) / (square + true_mean * true_mean + _C1)
            contrast = (2 * covariance + _C2) / (variance + true_variance + _C2)
            found[:, strip] = (luminance * contrast)[:, _REACH:-_REACH, _REACH:-_REACH]
        return found

    def delta_e(self, restored: Singles) -> Floats | Singles:
        """The colour difference of S-CIELAB at every pixel, [rows, columns]; about 2.3 is just noticeable."""
        if not self._large:
            return delta_e_1976(seen(restored), self._kept_lab)
        found = np.empty(restored.shape[1:], dtype=np.float32)
        pictures = [_opponents(each) for each in (restored, self.values)]
        for strip in _strips(restored.shape):
            found[strip] = delta_e_1976(*(_lab(each[:, strip]) for each in pictures))
        return found

    def _moments(self, lines: slice) -> tuple[Singles, Singles]:
        """Local mean and variance of some rows."""
        known = self._local.get(lines.start)
        if known is None:
            true = self.values[:, lines]
            mean = _blur(true)
            known = mean, _blur(true * true) - mean * mean
            if not self._large:
                self._local[lines.start] = known
        return known


def seen(values: Singles) -> NDArray[np.float64]:
    """CIE L*a*b* of code values [3, rows, columns] after the eye's blur, [rows, columns, 3]."""
    return _lab(_opponents(values))


def _opponents(values: Singles) -> Singles:
    """Luminance, red-green and blue-yellow of code values after the eye's blur, [3, rows, columns]."""
    _, rows, columns = values.shape
    found = np.empty(values.shape, dtype=np.float32)
    weights = OPPONENT_OF_RGB.astype(np.float32)
    for strip in _strips(values.shape):
        found[:, strip] = np.tensordot(weights, light_of_code(values[:, strip]), axes=1)
    # A cosine transform mirrors the picture; its k-th term has k / 2n cycles per pixel.
    y, x = np.arange(rows)[:, None] / (2 * rows), np.arange(columns) / (2 * columns)
    for plane in found:
        plane[:] = scipy.fft.dctn(plane, workers=1)
    for strip in _strips(values.shape):
        found[:, strip] *= gains(PIXELS_PER_DEGREE * np.hypot(y[strip], x))
    for plane in found:
        plane[:] = scipy.fft.idctn(plane, workers=1)
    return found


def _lab(opponents: Singles) -> NDArray[np.float64]:
    return lab_of_linear_srgb(np.tensordot(opponents.astype(np.float64), np.linalg.inv(OPPONENT_OF_RGB), axes=(0, 1)))


def _strips(shape: tuple[int, ...]) -> list[slice]:
    """Rows of a picture [..., rows, columns], so many at once that they take little memory."""
    rows, columns = shape[-2:]
    step = max(1, _AT_ONCE // columns)
    return [slice(start, min(rows, start + step)) for start in range(0, rows, step)]


def inner(picture: Singles, trim: int) -> Singles:
    """A picture, or a map of SSIM, without ``trim`` elements at each edge."""
    return picture[:, trim:-trim, trim:-trim] if trim else picture


def _blur(values: Singles) -> Singles:
    across = np.arange(-_REACH, _REACH + 1)
    weight = np.exp(-(across**2) / (2 * _SIGMA**2))
    weight /= weight.sum()
    lines = ndimage.correlate1d(values, weight, axis=1, mode="nearest")
    return np.asarray(ndimage.correlate1d(lines, weight, axis=2, mode="nearest"))
