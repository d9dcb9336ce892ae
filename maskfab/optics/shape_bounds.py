"""Bounds, lag by lag, of what the shapes of dots change of an autocorrelation that knows them by their means.

With a the amplitude, g its means over dots and e = a - g, which has no mean on any dot,

    C(s) - (g ⋆ g)(s) = ∫ e(r) a(r + s) d²r + ∫ e(r) g(r - s) d²r.

Of each integral, dot i has its share: as its e has no mean, any constant may be taken from the other factor, and what
is left of that is at most half of its range where the moved dot lies. So dot i adds no more than

    w_i R_i(s),    w_i = ½ ∫_i |e|,    R_i(s) = greatest less least amplitude under dot i moved by s.

A dot of amplitude t that a stop leaves in the share m has w = |t| m (1 - m) of its area; one of which only the variance
σ² is known has at most σ / 2 (Cauchy and Schwarz). The sum over i is a correlation of w with R, taken for a whole
square of lags at once: R over the box that a dot sweeps while its lag is in the square. No sign, grid or draw enters,
so that the bound holds for dots that all err alike, as those of repeating cells do.

Notes:
    Signs of many dots differ, and cancel; the bound is then about as much larger than the truth as the root of their
    number. Squares of lags are as large as a dot, larger for more dots than ``_MOST_SQUARES`` along a side.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Floats, Indices, fast_length
from maskfab.base.model import Frozen
from maskfab.optics.pupil import Lattice, Pupil

_MOST_SQUARES, _ROWS_AT_A_TIME = 512, 64
# Of the sum of all w, what single precision may lack in a correlation; dots in a row that are summed one by one.
_SINGLE, _FEW_IN_A_ROW = 2e-6, 16


@dataclass(frozen=True, eq=False)
class ShapeBounds(Frozen):
    """Bounds for lags up to a reach along either axis.

    Attributes:
        step_um: sides of the squares of lags along x and y.
        bound_um2: float32 [2 m, 2 n], for squares that begin -m, ..., m - 1 steps on along y, and so along x.
    """

    step_um: tuple[float, float]
    bound_um2: NDArray[np.float32]

    def at(self, lag_x_um: Floats, lag_y_um: Floats) -> Floats:
        """Bounds at lags of equal shape, in square micrometres."""
        column, row = self._squares(lag_x_um, lag_y_um)
        return self.bound_um2[row, column].astype(np.float64)

    def on_grid(self, lag_x_um: Floats, lag_y_um: Floats) -> Floats:
        """Bounds where columns [n] of lags cross rows [m] of them, [m, n]."""
        column, row = self._squares(lag_x_um, lag_y_um)
        return self.bound_um2[row][:, column].astype(np.float64)

    @property
    def largest_um2(self) -> float:
        """Largest bound within reach."""
        return float(self.bound_um2.max())

    def _squares(self, lag_x_um: Floats, lag_y_um: Floats) -> list[Indices]:
        lags = zip((lag_x_um, lag_y_um), self.step_um, self.bound_um2.shape[::-1], strict=True)
        return [np.clip(np.floor(lag / step) + count // 2, 0, count - 1).astype(np.intp) for lag, step, count in lags]


def shape_bounds(pupil: Pupil, reach_um: float, *, rim: bool) -> ShapeBounds | None:
    """Bounds for a table of a pupil's means; None where the means tell all.

    Args:
        reach_um: the largest lag along either axis that will be asked for.
        rim: whether the shapes of dots that the stop cuts count, beside those of which the variance is known.
    """
    axes = _Squares.of(pupil.y, reach_um), _Squares.of(pupil.x, reach_um)
    dots = _Dots.of(pupil, axes, rim=rim)
    if not dots.sum_um2:
        return None
    sizes = [fast_length(axis.windows + axis.reach + 1) for axis in axes]
    waves = np.fft.rfft2(dots.weights_um2, sizes)
    np.conj(waves, out=waves)
    waves *= np.fft.rfft2(dots.ranges, sizes)
    met = np.fft.irfft2(waves, sizes)
    del waves
    # Squares that begin L steps on, and the squares of the opposite lags, which begin -L - 1 steps on.
    ahead, behind = (
        met[np.ix_(*((lags + axis.span - 1) % size for lags, axis, size in zip(way, axes, sizes, strict=True)))]
        for way in ([axis.lags for axis in axes], [-axis.lags - 1 for axis in axes])
    )
    total = (np.clip(ahead, 0, None) + np.clip(behind, 0, None)).astype(np.float32)
    total += np.float32(_SINGLE * dots.sum_um2)
    # Tables have at lag 0 what dots share with themselves, and are linear from there to the next ones.
    total[tuple(slice(axis.reach - 1, axis.reach + 1) for axis in axes)] += np.float32(dots.own_um2)
    return ShapeBounds((axes[1].step_um, axes[0].step_um), total)


def axis_bounds(pupil: Pupil, *, along_x: bool) -> tuple[float, Floats]:
    """Bounds along one axis at every lag up to the pupil's width, the lag along the other being 0.

    Returns:
        A step in micrometres, and bounds [n] in square micrometres, from each whole step to the next.
    """
    still, moving = (pupil.y, pupil.x) if along_x else (pupil.x, pupil.y)
    axis, other = _Squares.of(moving, np.inf), _Squares.of(still, 0.0, moves=False)
    dots = _Dots.of(pupil, (other, axis) if along_x else (axis, other), rim=True)
    ranges, weights = (part if along_x else part.T for part in (dots.ranges, dots.weights_um2))
    # A dot on its own row, and the sweep of that row.
    rows = min(len(ranges) - (other.span - 1), len(weights))
    swept, lags = ranges[other.span - 1 :][:rows], np.arange(axis.reach)
    row, column = np.nonzero(weights[:rows])
    if row.size <= _FEW_IN_A_ROW * rows:
        beside = np.pad(swept, ((0, 0), (axis.reach, axis.reach + axis.span)))
        shares = np.lib.stride_tricks.sliding_window_view(beside, 2 * axis.reach, axis=1)
        met = weights[row, column] @ shares[row, column + axis.span - 1]
        ahead, behind = met[axis.reach + lags], met[axis.reach - lags - 1]
    else:
        size = fast_length(axis.windows + axis.reach + 1)
        met = np.fft.irfft((np.fft.rfft(swept, size) * np.fft.rfft(weights[:rows], size).conj()).sum(axis=0), size)
        ahead, behind = (met[(way + axis.span - 1) % size] for way in (lags, -lags - 1))
    total = np.clip(ahead, 0, None).astype(np.float64) + np.clip(behind, 0, None) + _SINGLE * dots.sum_um2
    total[0] += dots.own_um2
    return axis.step_um, total


@dataclass(frozen=True, eq=False)
class _Dots:
    """Dots whose shapes count, and what they sweep, on steps along y and x.

    Attributes:
        weights_um2: float32 [windows y, windows x], sums of w of the dots that begin in each square of steps.
        ranges: the same of greatest less least amplitude in every sweep.
    """

    weights_um2: NDArray[np.float32]
    ranges: NDArray[np.float32]
    sum_um2: float
    own_um2: float

    @classmethod
    def of(cls, pupil: Pupil, axes: tuple[_Squares, _Squares], *, rim: bool) -> _Dots:
        weights, own = _weights(pupil, axes, rim=rim)
        if not weights.any():
            return cls(weights, weights, 0.0, 0.0)
        # Ones and zeros stay bytes.
        kind = np.int8 if pupil.whole.dtype.itemsize == 1 and (pupil.rim_transmission == 1).all() else np.float32
        vague = pupil.whole_variance > 0 if any(pupil.whole_variance.strides) else None
        most, least = max(1.0, float(pupil.whole.max())), min(0.0, float(pupil.whole.min()))
        ranges = np.zeros(weights.shape, dtype=np.float32)
        for extreme, end, sign in ((np.maximum, most, 1), (np.minimum, least, -1)):
            values = np.array(pupil.whole, dtype=kind)
            values[pupil.rim_row, pupil.rim_column] = extreme(pupil.rim_transmission, 0.0)
            if vague is not None:
                values[vague] = end
            for k, axis in enumerate(axes):
                values = axis.swept(extreme, values, k)
            ranges += sign * values.astype(np.float32, copy=False)
        return cls(weights, ranges, float(weights.sum(dtype=np.float64)), own)


def _weights(pupil: Pupil, axes: tuple[_Squares, _Squares], *, rim: bool) -> tuple[NDArray[np.float32], float]:
    """Sums of w in squares of steps, and what the dots share with themselves, in square micrometres."""
    width, height = np.diff(pupil.x.edges_um()), np.diff(pupil.y.edges_um())
    weights, own = np.zeros([axis.windows for axis in axes], dtype=np.float32), 0.0
    if any(pupil.whole_variance.strides):
        into = (axes[1].of_dots[:, None] == np.arange(axes[1].windows)) * width[:, None]
        for start in range(0, height.size, _ROWS_AT_A_TIME):
            rows = slice(start, start + _ROWS_AT_A_TIME)
            variance = pupil.whole_variance[rows]
            own += float(height[rows] @ (variance @ width))
            np.add.at(weights, axes[0].of_dots[rows], height[rows, None] * (np.sqrt(variance) / 2 @ into))
    if rim:
        row, column, mean = pupil.rim_row, pupil.rim_column, pupil.rim_moments[:, 0, 0]
        area = height[row] * width[column]
        weight = abs(mean * (1 - mean / pupil.rim_transmission)) * area
        np.add.at(weights, (axes[0].of_dots[row], axes[1].of_dots[column]), weight)
        own += float(pupil.rim_variance @ area)
    return weights, own


@dataclass(frozen=True, eq=False)
class _Squares:
    """Even steps along one axis of a pupil, and what dots sweep while they move by one.

    Attributes:
        reach: steps to the longest lag.
        span: steps that a dot sweeps, of which it moves by one; one more where gutters take dots off the steps.
        first, last: intp [windows], intervals that lie in every such sweep.
        of_dots: intp [intervals], the step in which each interval begins.
    """

    step_um: float
    reach: int
    span: int
    first: Indices
    last: Indices
    of_dots: Indices

    @classmethod
    def of(cls, lattice: Lattice, reach_um: float, *, moves: bool = True) -> _Squares:
        edges = lattice.edges_um() - lattice.edges_um()[0]
        step = lattice.dot_um * -(-(edges.size - 1) // _MOST_SQUARES)
        little = 1e-6 * lattice.dot_um
        span = 1 + int(moves) + int(lattice.has_gutter)
        count = int(np.ceil((edges[-1] - little) / step))
        start = step * np.arange(1 - span, count, dtype=np.float64)
        first = np.searchsorted(edges, start + little, side="right") - 1
        last = np.searchsorted(edges, start + span * step - little, side="left") - 1
        reach = int(np.ceil(min(reach_um, edges[-1]) / step)) + 1
        return cls(step, reach, span, first, last, np.floor((edges[:-1] + little) / step).astype(np.intp))

    @property
    def windows(self) -> int:
        return self.first.size

    @property
    def lags(self) -> Indices:
        """Steps to where the squares of lags begin."""
        return np.arange(-self.reach, self.reach)

    def swept(self, extreme: np.ufunc, values: NDArray[Any], axis: int) -> NDArray[Any]:
        """Greatest or least value in every sweep; beyond the pupil all is dark."""
        width = values.shape[axis]
        found = None
        for k in range(int((self.last - self.first).max(initial=0)) + 1):
            place = np.minimum(self.first + k, self.last)
            met = values.take(np.clip(place, 0, width - 1), axis)
            np.multiply(met, np.expand_dims((place >= 0) & (place < width), 1 - axis), out=met)
            found = met if found is None else extreme(found, met, out=found)
        return np.asarray(found)
