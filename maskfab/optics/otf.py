r"""The optical transfer function from the pupil's autocorrelation, one table of lags for every wavelength and cut.

    OTF(ν) = C(λfν) / C(0),    C(s) = ∫∫ a(r) a(r + s) d²r                    (Goodman, Fourier Optics, 6.3)

A pupil of square dots has an autocorrelation that is bilinear between whole-dot lags, so a table of those is exact. A
lag on a lattice of cells is a cell lag L and a dot lag l, s = L pitch + l dot, and the table has both, so that gutters
of any width stay exact although pitch and dot have no common measure.

Notes:
    Dots cut by a round stop enter with their mean transmission. Lag 0 is then corrected exactly; at another whole-dot
    lag the error is at most the autocorrelation of the dots' standard deviations (Cauchy-Schwarz), and in between the
    shape of the cut dots adds errors of random sign. Both are part of ``uncertainty``.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from maskfab.model import frozen
from maskfab.optics.aperture import Lattice
from maskfab.optics.pupil import Pupil

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LagTable:
    """The pupil's autocorrelation at every cell lag and dot lag.

    Attributes:
        x, y: the pupil's lattices.
        values: float64 [cells y, dots y, cells x, dots x] in square micrometres, negative lags wrapped round.
        energy_um2: the value at lag 0.
        uncertainty: error bound of C(s) / C(0) at any lag, see the module's notes.
    """

    x: Lattice
    y: Lattice
    values: Floats
    energy_um2: float
    uncertainty: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", frozen(self.values))

    def otf(self, lag_x_um: Floats, lag_y_um: Floats) -> Floats:
        """C(s) / C(0) at lags of equal shape, in micrometres; real, because the amplitude is."""
        total = np.zeros(np.broadcast(lag_x_um, lag_y_um).shape)
        along_x = list(_neighbours(self.x, np.asarray(lag_x_um), self.values.shape[2:]))
        for cell_y, dot_y, weight_y in _neighbours(self.y, np.asarray(lag_y_um), self.values.shape[:2]):
            for cell_x, dot_x, weight_x in along_x:
                total += weight_y * weight_x * self.values[cell_y, dot_y, cell_x, dot_x]
        return total / self.energy_um2

    @property
    def volume_um2(self) -> float:
        """Integral of C(s) / C(0) over all lags: the clear area, if the mask is binary."""
        return float(self.values.sum() * self.x.dot_um * self.y.dot_um / self.energy_um2)


def lag_table(pupil: Pupil) -> LagTable:
    """Autocorrelate a pupil by FFT over cells and dots at once."""
    dot_area = pupil.x.dot_um * pupil.y.dot_um
    values = _autocorrelation(_blocks(pupil, pupil.mean_transmission)) * dot_area
    variance = _blocks(pupil, pupil.variance)
    spread = variance.sum() * dot_area
    values[0, 0, 0, 0] += spread
    energy = float(values[0, 0, 0, 0])
    uncertainty = 1e-15
    if spread > 0:
        # Dots side by side as if there were no gutters: lags that this makes alike add up, so the bound still holds.
        flat = variance.reshape(1, variance.shape[0] * variance.shape[1], 1, -1)
        bound = _autocorrelation(np.sqrt(flat)) * dot_area
        bound[0, 0, 0, 0] = 0.0
        # Between lags a cut dot meets the edge of another, at most half its contrast off: three sigma of that sum.
        between_lags = 1.5 * np.sqrt(variance.sum()) * dot_area
        uncertainty = float((bound.max() + between_lags) / energy)
    return LagTable(pupil.x, pupil.y, values, energy, uncertainty)


def _blocks(pupil: Pupil, values: Floats) -> Floats:
    """The dots of a pupil as [cells y, dots y, cells x, dots x]; one cell of many dots where there is no gutter."""
    rows, columns = pupil.y.dot_index(), pupil.x.dot_index()
    dots = values[np.ix_(rows.ravel(), columns.ravel())]
    (cells_y, dots_y), (cells_x, dots_x) = _periods(pupil.y), _periods(pupil.x)
    return dots.reshape(cells_y, dots_y, cells_x, dots_x)


def _periods(lattice: Lattice) -> tuple[int, int]:
    """Cells and dots that must be told apart: without gutters every dot is its own cell."""
    return (lattice.cells, lattice.dots) if lattice.has_gutter else (lattice.cells * lattice.dots, 1)


def _autocorrelation(blocks: Floats) -> Floats:
    """Linear autocorrelation along all four axes, padded against wrap-round."""
    sizes = [fft.next_fast_len(2 * n - 1, real=True) if n > 1 else 1 for n in blocks.shape]
    axes = [k for k, n in enumerate(blocks.shape) if n > 1] or [0]
    spectrum = fft.rfftn(blocks, [sizes[k] for k in axes], axes=axes)
    np.multiply(spectrum, spectrum.conj(), out=spectrum)
    result: Floats = fft.irfftn(spectrum, [sizes[k] for k in axes], axes=axes, overwrite_x=True)
    return result


def _neighbours(
    lattice: Lattice, lag: Floats, sizes: tuple[int, ...]
) -> Iterator[tuple[NDArray[np.intp], NDArray[np.intp], Floats]]:
    """Table indices (cell, dot) and weights whose sum interpolates the table linearly at a lag along one axis."""
    cells, dots = _periods(lattice)
    pitch = lattice.pitch_um if lattice.has_gutter else lattice.dot_um
    whole = np.floor(lag / pitch)
    for cell in (whole, whole + 1):
        within = (lag - cell * pitch) / lattice.dot_um
        base = np.floor(within)
        for dot, weight in ((base, 1 - (within - base)), (base + 1, within - base)):
            valid = (abs(cell) < cells) & (abs(dot) < dots)
            yield (
                np.where(valid, cell, 0).astype(np.intp) % sizes[0],
                np.where(valid, dot, 0).astype(np.intp) % sizes[1],
                np.where(valid, weight, 0.0),
            )
