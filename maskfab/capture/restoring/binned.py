r"""Two by two pixels as one: of a record the mean, of a blur what the mean of a scene's pixels becomes.

With a scene that is constant over the larger pixels,

    H'(ν) = sum over k of H((ν + k) / 2) cos²(π (ν_x + k_x) / 2) cos²(π (ν_y + k_y) / 2),        k_x, k_y = 0 or 1,

ν in cycles per larger pixel: one cos² is the mean on the sensor, the other the larger pixel of the scene.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from maskfab.camera.mosaic import interpolated
from maskfab.camera.record import Record
from maskfab.camera.restorers.restorer import Blur, Transfer


@dataclass(frozen=True, eq=False)
class BinnedBlur:
    """Blur of means over 2 x 2 pixels.

    Attributes:
        fine: that of the pixels.
    """

    fine: Blur

    def on(self, shape: tuple[int, int]) -> Transfer:
        """See :class:`maskfab.camera.restorers.restorer.Blur`."""
        rows, columns = shape
        half = self.fine.on((2 * rows, 2 * columns))
        y, x = np.asarray(scipy.fft.fftfreq(2 * rows))[:, None], np.asarray(scipy.fft.rfftfreq(2 * columns))
        half = half * (np.square(np.cos(np.pi * y)) * np.square(np.cos(np.pi * x))).astype(np.float32)
        folded = half[:, :rows] + half[:, rows:]
        keep = columns // 2 + 1
        # The other half of the columns is that of the opposite frequencies, conjugate.
        across = np.arange(columns, columns - keep, -1)
        opposite = folded[:, -np.arange(rows) % rows][:, :, across].conj()
        return np.asarray(folded[:, :, :keep] + opposite)


def binned(record: Record) -> Record:
    """Means over 2 x 2 pixels of a record of even sides; full where one of the four is."""
    _, rows, columns = record.values.shape
    cells = record.values.reshape(3, rows // 2, 2, columns // 2, 2)
    full = record.clipped.reshape(cells.shape).any(axis=(2, 4))
    values = np.where(full, np.float32(record.ceiling), cells.mean(axis=(2, 4), dtype=np.float32))
    kept = _of_mosaic() if record.interpolated else 1 / 4
    return replace(record, values=values, noise=record.noise.times(kept), interpolated=False)


def of_cells(places: NDArray[Any], colours: str) -> NDArray[Any]:
    """Red, green and blue of cells of a mosaic, [3, rows, columns], nothing interpolated.

    Args:
        places: [4, rows, columns] of the cells' four places, row by row.
        colours: of the places, such as ``RGGB``; the mean of both greens counts.
    """
    return np.stack([places[[k for k in range(4) if colours[k] == colour]].mean(axis=0) for colour in "RGB"])


@cache
def _of_mosaic() -> float:
    """Variance of the mean over the four places of an interpolated mosaic with noise of 1, the mean of the colours."""
    total = 0.0
    for place in range(100):
        pixel = np.zeros(100, dtype=np.float32)
        pixel[place] = 1
        middle = interpolated(pixel.reshape(10, 10))[:, 4:6, 4:6].mean(axis=(1, 2), dtype=np.float64)
        total += float(np.square(middle).mean())
    return total
