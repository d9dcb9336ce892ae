"""Light beside a pixel, which tells its level without its own noise."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from maskfab.base.arrays import Floats

_AROUND = np.array([[1.0, 1.0, 1.0], [1.0, 0.0, 1.0], [1.0, 1.0, 1.0]])


def mean_beside(values: Floats, usable: NDArray[np.bool_]) -> Floats:
    """Mean of each pixel's eight neighbours of its colour, the pixel itself left out.

    Args:
        values: [rows, columns] of one colour.
        usable: which of them count; 0 where none of a pixel's neighbours does.
    """
    total = ndimage.convolve(np.where(usable, values, 0.0), _AROUND, mode="constant")
    count = ndimage.convolve(usable.astype(np.float64), _AROUND, mode="constant")
    found: Floats = np.divide(total, count, out=np.zeros_like(total), where=count > 0.5)
    return found
