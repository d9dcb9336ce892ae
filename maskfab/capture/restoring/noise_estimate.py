r"""Noise of a photograph by itself, where nobody states the sensor's gain.

Second differences along both axes, [1 -2 1] x [1 -2 1] / 6, keep the variance of white noise and nothing of light that
is even or slopes (J. Immerkær, Comput. Vis. Image Underst. 64, 300, 1996). In classes of equal brightness, their median
in the smoothest blocks tells the variance there, and the classes tell

    var = light / electrons of white + floor        (A. Foi et al., IEEE Trans. Image Process. 17, 1737, 2008).

Notes:
    Behind a panel the finest detail is blurred away, so what is left there is noise. A picture that a camera or a coder
    has smoothed looks less noisy than it is.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import ndimage, optimize

from maskfab.base.arrays import Floats, Singles
from maskfab.camera.record import Noise
from maskfab.errors import SourceError

_BLOCK = 8
_CLASSES = 24
_SMOOTH = 0.3
"""Share of a class's blocks that are looked at: those whose means over 3 x 3 pixels differ least."""
_FEWEST = 8
_OF_MEDIAN = 0.6745
"""Median of the modulus of a standard normal number."""
_LEAST = 1e-7
"""Variance in units of white below which none is told: a well of 10 million electrons."""


def estimated_noise(planes: Sequence[Singles], ceiling: float = np.inf) -> Noise:
    """Noise in units of white, of white noise that is the same function of light in every colour.

    Args:
        planes: [rows, columns] of each colour, as the pixels recorded it, black is 0 and white 1: interpolated pixels
            are not noisy enough.
        ceiling: light at which pixels are full; blocks that hold one do not count.

    Raises:
        SourceError: MF335 for fewer than some hundred blocks of 8 x 8 pixels that are not full.
    """
    parts = [_blocks(plane, ceiling) for plane in planes]
    light, rough, fine = (np.concatenate([part[k] for part in parts]) for k in range(3))
    order = np.argsort(light)
    means, variances = [], []
    for group in np.array_split(order, _CLASSES):
        smooth = group[np.argsort(rough[group])[: max(_FEWEST, int(_SMOOTH * group.size))]]
        if smooth.size >= _FEWEST:
            means.append(float(light[smooth].mean()))
            variances.append(max(float(np.median(fine[smooth])) / _OF_MEDIAN, 0.0) ** 2)
    if len(means) < _CLASSES:
        raise SourceError(
            "MF335",
            f"{light.size} blocks of {_BLOCK} x {_BLOCK} pixels that are not full are too few to tell the noise by",
            where="gain",
            cure="State the gain and the read noise, or give a larger photograph",
        )
    slope, floor = _line(np.array(means), np.array(variances))
    return Noise(1 / slope, floor**0.5 / slope)


def _blocks(plane: Singles, ceiling: float) -> tuple[Floats, Floats, Floats]:
    """Of blocks without full pixels: mean light, its unevenness, and the median modulus of second differences [n]."""
    rows, columns = (side // _BLOCK * _BLOCK for side in plane.shape)
    second = np.array([1.0, -2.0, 1.0], dtype=np.float32)
    fine = ndimage.correlate1d(ndimage.correlate1d(plane, second, axis=0), second, axis=1) / 6

    def cut(values: Singles) -> Floats:
        whole = values[:rows, :columns].reshape(rows // _BLOCK, _BLOCK, columns // _BLOCK, _BLOCK)
        return np.asarray(whole.transpose(0, 2, 1, 3).reshape(-1, _BLOCK**2), dtype=np.float64)

    means = cut(ndimage.uniform_filter(plane, 3))
    kept = cut(plane).max(axis=1) < ceiling
    return means.mean(axis=1)[kept], means.std(axis=1)[kept], np.median(abs(cut(fine)), axis=1)[kept]


def _line(light: Floats, variance: Floats) -> tuple[float, float]:
    """Slope and floor, none below 0, by least squares of relative errors, which are alike in all classes."""
    expected = np.maximum(variance, _LEAST)
    for _ in range(4):
        both = np.stack([np.maximum(light, 0), np.ones_like(light)], axis=1) / expected[:, None]
        (slope, floor), _ = optimize.nnls(both, variance / expected)
        expected = np.maximum(slope * np.maximum(light, 0) + floor, _LEAST)
    return max(float(slope), _LEAST), float(floor)
