r"""The pupil's autocorrelation along the two axes, at every lag, and what it tells of lines and edges.

A line or an edge along y is imaged through the OTF along x alone: its profile needs no light of the other axis and no
window. Between the lags of the table the autocorrelation is linear for whole dots, a sum of triangles one dot to either
side, so its transform is that of the table times dot sinc².
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from maskfab.base.arrays import Floats
from maskfab.model import frozen
from maskfab.optics.image.lag_table import neighbours
from maskfab.optics.pupil.aperture import Lattice
from maskfab.optics.pupil.pupil import Pupil

_ROWS_AT_A_TIME = 128


@dataclass(frozen=True, eq=False)
class AxisLags:
    """The pupil's autocorrelation along one axis, the lag along the other being 0.

    Attributes:
        lattice: the pupil's lattice along the axis.
        values: float64 [cells, dots] in square micrometres, negative lags wrapped round, good for every lag.
    """

    lattice: Lattice
    values: Floats

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", frozen(self.values))

    def at(self, lag_um: Floats) -> Floats:
        """The autocorrelation at lags of any shape; linear between the table's, which is exact for whole dots."""
        total = np.zeros(lag_um.shape)
        cells, dots = self.values.shape
        for place, weight in neighbours(self.lattice, lag_um, (cells, dots)):
            total += weight * self.values.ravel()[place]
        return total

    def transform(self, places: Floats, offsets: Floats) -> Floats:
        """Its integral over all lags against cos(2πus), in cubic micrometres.

        Args:
            places, offsets: [m] and [k], whose sums are the frequencies u per micrometre; split to spare waves.

        Returns:
            float64 [m, k].
        """
        cells, dots = self.values.shape
        dot = self.lattice.dot_um
        cell_lag = (self.lattice.pitch_um if self.lattice.has_gutter else dot) * np.arange(cells // 2 + 1)
        dot_lag = dot * scipy.fft.fftfreq(dots, 1 / dots)
        # Opposite lags are alike.
        weighed = self.values[: cell_lag.size] * np.where(cell_lag > 0, 2.0, 1.0)[:, None]
        along, between = (np.exp(2j * np.pi * places[:, None] * lag) for lag in (cell_lag, dot_lag))
        total = np.empty((places.size, offsets.size))
        for k, offset in enumerate(offsets):
            cell_turn, dot_turn = (np.exp(2j * np.pi * offset * lag) for lag in (cell_lag, dot_lag))
            total[:, k] = ((along @ (cell_turn[:, None] * weighed * dot_turn)) * between).real.sum(axis=1)
        return np.asarray(total * dot * np.sinc(dot * (places[:, None] + offsets)) ** 2)


def axis_lags(pupil: Pupil, energy_um2: float) -> tuple[AxisLags, AxisLags]:
    """Autocorrelations along x and along y at every lag up to the pupil's width.

    Args:
        pupil: openings inside the stop.
        energy_um2: the value at lag 0, which dots that the stop cuts do not give by their means.
    """
    grey = pupil.mean_transmission[np.ix_(pupil.y.dot_index().ravel(), pupil.x.dot_index().ravel())]
    area = pupil.x.dot_um * pupil.y.dot_um
    found = []
    for lattice, rows in ((pupil.x, grey), (pupil.y, grey.T)):
        # Without gutters every dot is a cell, as in the lag table.
        period = (lattice.cells, lattice.dots) if lattice.has_gutter else (lattice.cells * lattice.dots, 1)
        sizes = [scipy.fft.next_fast_len(2 * n - 1, real=True) for n in period]
        axes, sizes = ([1], sizes[:1]) if period[1] == 1 else ([1, 2], sizes)
        power: Floats | float = 0.0
        for start in range(0, len(rows), _ROWS_AT_A_TIME):
            part = rows[start : start + _ROWS_AT_A_TIME]
            spectrum = scipy.fft.rfftn(part.reshape(-1, *period), sizes, axes=axes)
            power = power + (spectrum.real**2 + spectrum.imag**2).sum(axis=0)
        values = scipy.fft.irfftn(power, sizes, axes=[axis - 1 for axis in axes]) * area
        values[0, 0] = energy_um2
        found.append(AxisLags(lattice, values))
    return found[0], found[1]
