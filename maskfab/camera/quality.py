"""Quality of a restored picture against the true one: PSNR, SSIM and S-CIELAB, of code values.

SSIM (Wang, Bovik, Sheikh, Simoncelli 2004) has Gaussian weights of 1.5 pixels out to 5, K1 = 0.01, K2 = 0.03,
population covariances, white 1, and is the mean over channels and all pixels at least 5 from the edge.

S-CIELAB (see :mod:`maskfab.eye.scielab`) is the difference in CIELAB after the eye's blur, for a viewer to whom a pixel
is a minute of arc: the finest that an eye of full acuity tells apart. The picture is mirrored beyond its edges.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.fft
from numpy.typing import NDArray
from scipy import ndimage

from maskfab.eye.scielab import OPPONENT_OF_RGB, gains
from maskfab.optics.numbers.colour import delta_e_1976, lab_of_linear_srgb, light_of_code

Singles = NDArray[np.float32]

_SIGMA, _REACH = 1.5, 5
_C1, _C2 = 0.01**2, 0.03**2
PIXELS_PER_DEGREE = 60.0
"""For S-CIELAB."""


def psnr(restored: Singles, truth: Singles) -> float:
    """10 log10 of 1 over the mean squared difference, in dB, over everything; infinite for equal pictures."""
    error = float(np.square(restored - truth).mean(dtype=np.float64))
    return float("inf") if error == 0 else float(-10 * np.log10(error))


@dataclass(frozen=True, eq=False)
class Truth:
    """A true picture, with what SSIM and S-CIELAB need of it.

    Attributes:
        values: float32 [3, rows, columns].
        mean: its local mean.
        variance: its local variance.
    """

    values: Singles
    mean: Singles
    variance: Singles

    @cached_property
    def lab(self) -> NDArray[np.float64]:
        """CIE L*a*b* of it as it is seen, [rows, columns, 3]; kept."""
        return seen(self.values)

    def ssim(self, restored: Singles) -> Singles:
        """The map of SSIM, [3, rows - 10, columns - 10]."""
        mean = _blur(restored)
        product = mean * self.mean
        covariance = _blur(restored * self.values) - product
        square = mean * mean
        variance = _blur(restored * restored) - square
        luminance = (2 * product + _C1) / (square + self.mean * self.mean + _C1)
        contrast = (2 * covariance + _C2) / (variance + self.variance + _C2)
        return np.asarray((luminance * contrast)[:, _REACH:-_REACH, _REACH:-_REACH])

    def delta_e(self, restored: Singles) -> NDArray[np.float64]:
        """The colour difference of S-CIELAB at every pixel, [rows, columns]; about 2.3 is just noticeable."""
        return delta_e_1976(seen(restored), self.lab)


def truth(values: Singles) -> Truth:
    """Prepare a true picture [3, rows, columns]."""
    mean = _blur(values)
    return Truth(values, mean, _blur(values * values) - mean * mean)


def seen(values: Singles) -> NDArray[np.float64]:
    """CIE L*a*b* of code values [3, rows, columns] after the eye's blur, [rows, columns, 3]."""
    rows, columns = values.shape[1:]
    # A cosine transform mirrors the picture; its k-th term has k / 2n cycles per pixel.
    y, x = np.arange(rows)[:, None] / (2 * rows), np.arange(columns) / (2 * columns)
    blur = gains(PIXELS_PER_DEGREE * np.hypot(y, x)).astype(np.float32)
    opponent = np.tensordot(OPPONENT_OF_RGB.astype(np.float32), light_of_code(values), axes=1)
    terms = scipy.fft.dctn(opponent, axes=(1, 2), overwrite_x=True, workers=1)
    terms *= blur
    blurred = scipy.fft.idctn(terms, axes=(1, 2), overwrite_x=True, workers=1)
    return lab_of_linear_srgb(np.tensordot(blurred.astype(np.float64), np.linalg.inv(OPPONENT_OF_RGB), axes=(0, 1)))


def inner(picture: Singles, trim: int) -> Singles:
    """A picture, or a map of SSIM, without ``trim`` elements at each edge."""
    return picture[:, trim:-trim, trim:-trim] if trim else picture


def _blur(values: Singles) -> Singles:
    across = np.arange(-_REACH, _REACH + 1)
    weight = np.exp(-(across**2) / (2 * _SIGMA**2))
    weight /= weight.sum()
    lines = ndimage.correlate1d(values, weight, axis=1, mode="nearest")
    return np.asarray(ndimage.correlate1d(lines, weight, axis=2, mode="nearest"))
