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
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from maskfab.errors import InternalError
from maskfab.model import frozen
from maskfab.optics.aperture import Lattice
from maskfab.optics.pupil import Pupil
from maskfab.optics.waves import Reals

Floats = NDArray[np.float64]


_ROWS_AT_A_TIME, _COLUMNS_AT_A_TIME = 128, 64
_SINGLE = 1e-5
# Above it a transform is faster than counting pairs.
_MOST_PAIRS = 8_000_000


@dataclass(frozen=True, eq=False)
class LagTable:
    """The pupil's autocorrelation at every cell lag and dot lag up to some reach.

    Attributes:
        x, y: the pupil's lattices.
        values: float64 [cells y, dots y, cells x, dots x] in square micrometres, negative lags wrapped round.
        reach_um: largest lag along either axis for which the table is good.
        energy_um2: the value at lag 0.
        uncertainty: error bound of C(s) / C(0) at any lag, see the module's notes.
    """

    x: Lattice
    y: Lattice
    values: Floats
    reach_um: float
    energy_um2: float
    uncertainty: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", frozen(self.values))

    def otf(self, lag_x_um: Floats, lag_y_um: Floats) -> Floats:
        """C(s) / C(0) at lags of equal shape, in micrometres; real, because the amplitude is.

        Raises:
            InternalError: MF901 for a lag beyond the table's reach.
        """
        lag_x, lag_y = np.asarray(lag_x_um), np.asarray(lag_y_um)
        longest = max(abs(lag_x).max(initial=0.0), abs(lag_y).max(initial=0.0))
        if longest > self.reach_um * (1 + 1e-9):
            raise InternalError("MF901", f"lag {longest:g} um is beyond the table's reach of {self.reach_um:g} um")
        total = np.zeros(np.broadcast(lag_x, lag_y).shape)
        along_x = list(neighbours(self.x, lag_x, self.values.shape[2:]))
        for cell_y, dot_y, weight_y in neighbours(self.y, lag_y, self.values.shape[:2]):
            for cell_x, dot_x, weight_x in along_x:
                total += weight_y * weight_x * self.values[cell_y, dot_y, cell_x, dot_x]
        return total / self.energy_um2

    @property
    def volume_um2(self) -> float:
        """Integral of C(s) / C(0) over all lags: the clear area, if the mask is binary.

        A sum over all lags does not care that those beyond the reach are folded onto each other.
        """
        return float(self.values.sum() * self.x.dot_um * self.y.dot_um / self.energy_um2)


def lag_table(pupil: Pupil, reach_um: float = np.inf) -> LagTable:
    """Autocorrelate a pupil by FFT over cells and dots at once.

    Args:
        pupil: openings inside the stop.
        reach_um: the largest lag along either axis that will be asked for; a shorter reach is a smaller transform.
    """
    dot_area = pupil.x.dot_um * pupil.y.dot_um
    values = _autocorrelation(pupil, _blocks(pupil, pupil.mean_transmission), reach_um) * dot_area
    spread = pupil.variance.sum() * dot_area
    values[0, 0, 0, 0] += spread
    energy = float(values[0, 0, 0, 0])
    uncertainty = 1e-15
    if spread > 0:
        # Between lags a cut dot meets the edge of another, at most half its contrast off: three sigma of that sum.
        between_lags = 1.5 * np.sqrt(pupil.variance.sum()) * dot_area
        uncertainty = (_largest_overlap(np.sqrt(pupil.variance)) * dot_area + between_lags) / energy
    return LagTable(pupil.x, pupil.y, values, reach_um, energy, uncertainty)


def _largest_overlap(deviation: Floats) -> float:
    """The largest autocorrelation, lag 0 aside, of the intervals' standard deviations.

    Gutters count as intervals, which makes some lags alike that are not; their sums are still a bound.
    """
    row, column = np.nonzero(deviation)
    height, width = deviation.shape
    if row.size**2 <= _MOST_PAIRS:
        value = deviation[row, column]
        place = row * 2 * width + column
        first, second = np.nonzero(place[:, None] > place)
        found = np.bincount(place[first] - place[second], value[first] * value[second])
        return float(found.max(initial=0.0))
    sizes = [fft.next_fast_len(2 * n - 1, real=True) for n in (height, width)]
    # A bound needs no more than single precision, whose error is added.
    blocks, padded = deviation.astype(np.float32)[:, None, None, :], [sizes[0], 1, 1, sizes[1]]
    largest = 0.0
    for rows, lags in _lags(_power(blocks, padded), padded):
        if rows.start == 0:
            lags[0, 0, 0, 0] = 0.0
        largest = max(largest, float(lags.max()))
    return largest + _SINGLE * float((deviation**2).sum())


def _blocks(pupil: Pupil, values: Floats) -> Floats:
    """The dots of a pupil as [cells y, dots y, cells x, dots x]; one cell of many dots where there is no gutter."""
    rows, columns = pupil.y.dot_index(), pupil.x.dot_index()
    dots = values[np.ix_(rows.ravel(), columns.ravel())]
    (cells_y, dots_y), (cells_x, dots_x) = _periods(pupil.y), _periods(pupil.x)
    return dots.reshape(cells_y, dots_y, cells_x, dots_x)


def _periods(lattice: Lattice) -> tuple[int, int]:
    """Cells and dots that must be told apart: without gutters every dot is its own cell."""
    return (lattice.cells, lattice.dots) if lattice.has_gutter else (lattice.cells * lattice.dots, 1)


def _autocorrelation(pupil: Pupil, blocks: Floats, reach_um: float) -> Floats:
    """Autocorrelation along all four axes, padded so that nothing folds onto lags within reach."""
    sizes = [
        fft.next_fast_len(min(2 * n - 1, n + extra), real=True) if n > 1 else 1
        for n, extra in zip(blocks.shape, (*_extra(pupil.y, reach_um), *_extra(pupil.x, reach_um)), strict=True)
    ]
    return _correlated(blocks, sizes)


def _correlated(blocks: Floats, sizes: list[int]) -> Floats:
    """Autocorrelation of [a, b, c, d] values by transforms of the given sizes, negative lags wrapped round."""
    power = _power(blocks, sizes)
    values = np.empty(sizes, dtype=blocks.dtype)
    for rows, lags in _lags(power, sizes):
        values[rows] = lags
    opposite = np.ix_(*(-np.arange(size) % size for size in sizes[1:]))
    for row in range(len(power), sizes[0]):
        values[row] = values[sizes[0] - row][opposite]
    return values


def _power(blocks: Reals, sizes: list[int]) -> NDArray[np.complexfloating[Any]]:
    """Autocorrelation along y, from lag 0 on, of transforms along x; opposite lags and frequencies are alike.

    What is transformed along y is squared and transformed back a few columns at a time, never held in full.
    """
    spectrum = fft.rfftn(blocks, *_along_x(sizes))
    columns = spectrum.reshape(*blocks.shape[:2], -1)
    power = np.empty((sizes[0] // 2 + 1, sizes[1], columns.shape[2]), dtype=columns.dtype)
    for start in range(0, columns.shape[2], _COLUMNS_AT_A_TIME):
        part = slice(start, start + _COLUMNS_AT_A_TIME)
        field = fft.fftn(columns[:, :, part], sizes[:2], axes=(0, 1))
        field *= field.conj()
        power[:, :, part] = fft.ifftn(field, axes=(0, 1), overwrite_x=True)[: len(power)]
    return power.reshape(*power.shape[:2], *spectrum.shape[2:])


def _lags(power: NDArray[np.complexfloating[Any]], sizes: list[int]) -> Iterator[tuple[slice, Floats]]:
    """The same at lags along x, a few rows at a time."""
    for start in range(0, len(power), _ROWS_AT_A_TIME):
        rows = slice(start, min(start + _ROWS_AT_A_TIME, len(power)))
        yield rows, fft.irfftn(power[rows], *_along_x(sizes))


def _along_x(sizes: list[int]) -> tuple[list[int], list[int]]:
    """Sizes and axes of transforms over the last two of four axes, without those of a single value."""
    axes = [k for k in (2, 3) if sizes[k] > 1] or [3]
    return [sizes[k] for k in axes], axes


def _extra(lattice: Lattice, reach_um: float) -> tuple[int, int]:
    """Padding of the cells and of the dots that keeps lags up to the reach apart from folded ones."""
    pitch = lattice.pitch_um if lattice.has_gutter else lattice.dot_um
    cells, dots = _periods(lattice)
    return cells if not np.isfinite(reach_um) else int(np.ceil(reach_um / pitch)) + 2, dots


def neighbours(
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
