"""Quality of a restored picture against the true one: PSNR, and SSIM (Wang, Bovik, Sheikh, Simoncelli 2004).

SSIM has Gaussian weights of 1.5 pixels out to 5, K1 = 0.01, K2 = 0.03, population covariances, white 1, and is the mean
over channels and all pixels at least 5 from the edge.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

Singles = NDArray[np.float32]

_SIGMA, _REACH = 1.5, 5
_C1, _C2 = 0.01**2, 0.03**2


def psnr(restored: Singles, truth: Singles) -> float:
    """10 log10 of 1 over the mean squared difference, in dB, over everything; infinite for equal pictures."""
    error = float(np.square(restored - truth).mean(dtype=np.float64))
    return float("inf") if error == 0 else float(-10 * np.log10(error))


@dataclass(frozen=True, eq=False)
class Truth:
    """A true picture, with what SSIM needs of it.

    Attributes:
        values: float32 [3, rows, columns].
        mean: its local mean.
        variance: its local variance.
    """

    values: Singles
    mean: Singles
    variance: Singles

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


def truth(values: Singles) -> Truth:
    """Prepare a true picture [3, rows, columns]."""
    mean = _blur(values)
    return Truth(values, mean, _blur(values * values) - mean * mean)


def inner(picture: Singles, trim: int) -> Singles:
    """A picture, or a map of SSIM, without ``trim`` elements at each edge."""
    return picture[:, trim:-trim, trim:-trim] if trim else picture


def _blur(values: Singles) -> Singles:
    across = np.arange(-_REACH, _REACH + 1)
    weight = np.exp(-(across**2) / (2 * _SIGMA**2))
    weight /= weight.sum()
    lines = ndimage.correlate1d(values, weight, axis=1, mode="nearest")
    return np.asarray(ndimage.correlate1d(lines, weight, axis=2, mode="nearest"))
