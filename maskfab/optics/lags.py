"""The optical transfer function from the pupil's autocorrelation, one table of lags for every wavelength and cut.

    OTF(ν) = C(λfν) / C(0),    C(s) = ∫∫ a(r) a(r + s) d²r                    (Goodman, Fourier Optics, 6.3)

A pupil of square dots has an autocorrelation that is bilinear between whole-dot lags, so a table of those is exact. A
lag on a lattice of cells is a cell lag L and a dot lag l, s = L pitch + l dot, and the table has both, so that gutters
of any width stay exact although pitch and dot have no common measure.

Notes:
    Dots cut by the stop enter the table with their mean transmission, lag 0 aside, and what their shapes change is
    added lag by lag (see ``rim_lags``). That costs time in proportion to lags times cut dots; where many lags are asked
    for, the table alone will do, within a bound for each of them (see ``shape_bounds``).

Along the two axes the autocorrelation is had at every lag. A line or an edge along y is imaged through the OTF along x
alone: its profile needs no light of the other axis and no window. Between the lags of the table the autocorrelation is
linear for whole dots, a sum of triangles one dot to either side, so its transform is that of the table times dot sinc².
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Floats, Indices, fast_length
from maskfab.base.errors import InternalError
from maskfab.base.model import Frozen, Scalar
from maskfab.job.camera import Stop
from maskfab.optics.field.waves import Reals
from maskfab.optics.pupil import Lattice, Pupil
from maskfab.optics.rim import apart, rim_lags
from maskfab.optics.shape_bounds import ShapeBounds, axis_bounds, shape_bounds

if TYPE_CHECKING:
    from maskfab.optics.outline_lags import OutlineLags

# At lags within so many dots of 0 cut dots meet themselves or the next ones, and all err alike.
_NEAR_DOTS = 3
# Pairs of lags and cut dots that cost little beside a table; near 0, where they meet each other, they cost more.
_FEW_PAIRS, _FEW_NEAR_PAIRS = 50_000, 25_000
# Of polygons lags times pairs that take half a second; a lag of few takes as long as one of so many, and a part that
# the stop cuts as long as several.
_PAIRS_OF_OUTLINE, _FEWEST_PARTS, _PAIRS_OF_CUT = 2_500_000, 3000, 30
# So much stays in the processor's cache, and so many values along x are held at once.
_ROWS_AT_A_TIME, _COLUMNS_AT_A_TIME, _MOST_HELD = 32, 16, 18_000_000


class Shapes(Protocol):
    """That part of an autocorrelation which means of dots do not tell."""

    @property
    def stop(self) -> Stop: ...

    @property
    def cut_dots(self) -> int:
        """Number of parts that every lag looks at."""

    def correction_um2(self, lag_x_um: Floats, lag_y_um: Floats) -> Floats:
        """Changes by shapes at lags [n] other than 0."""


@dataclass(frozen=True, eq=False)
class LagTable(Frozen):
    """The pupil's autocorrelation at every cell lag and dot lag up to some reach.

    Attributes:
        values: float64 [cells y, dots y, cells x, dots x] in square micrometres, of mean transmissions but for lag 0;
            lags up to the reach and few others, negative ones wrapped round.
        reach_um: largest lag along either axis for which the table is good.
        energy_um2: the value at lag 0.
        floor: bound of the error of C(s) / C(0) at every lag, rounding among it.
        unknown: bounds of what shapes that nothing tells add to it.
        coarse: bounds of that and of what ``rims`` tell.
        rims: what the shapes of cut dots change, of every part of the amplitude.
        sum_um2: of the means over all lags, within reach or not.
        outline: of what is clear, where polygons tell the shapes of all dots.
        film: what a film adds that leaks, over the same energy.
    """

    x: Lattice
    y: Lattice
    values: Floats
    reach_um: float
    energy_um2: float
    floor: float
    unknown: tuple[ShapeBounds, ...] = ()
    coarse: tuple[ShapeBounds, ...] = ()
    rims: tuple[Shapes, ...] = ()
    sum_um2: float = 0.0
    outline: OutlineLags | None = None
    film: LagTable | None = None

    def otf(self, lag_x_um: Floats, lag_y_um: Floats) -> Floats:
        """C(s) / C(0) at lags of equal shape, in micrometres; real, because the amplitude is."""
        coarse = self.coarse_otf(lag_x_um, lag_y_um)
        if not self.rims:
            return coarse
        lag_x, lag_y = np.broadcast_arrays(np.asarray(lag_x_um, np.float64), np.asarray(lag_y_um, np.float64))
        meets = ~apart(self.rims[0].stop, lag_x, lag_y)
        exact = np.where(meets, coarse, 0.0)
        # Lag 0 was given its due.
        meets &= (lag_x != 0) | (lag_y != 0)
        for rim in self.rims:
            exact[meets] += rim.correction_um2(lag_x[meets], lag_y[meets]) / self.energy_um2
        return exact

    def coarse_otf(self, lag_x_um: Floats, lag_y_um: Floats) -> Floats:
        """The OTF without the effect of the shapes of cut dots, within ``coarse_uncertainty``, and much faster."""
        lag_x, lag_y = np.asarray(lag_x_um), np.asarray(lag_y_um)
        self._refuse_beyond_reach(lag_x, lag_y)
        total = np.zeros(np.broadcast(lag_x, lag_y).shape)
        cells_y, dots_y, cells_x, dots_x = self.values.shape
        flat = self.values.ravel()
        along_x = list(neighbours(self.x, lag_x, (cells_x, dots_x)))
        for row, weight_y in neighbours(self.y, lag_y, (cells_y, dots_y)):
            start = row * (cells_x * dots_x)
            for column, weight_x in along_x:
                total += weight_y * weight_x * flat[start + column]
        return total / self.energy_um2 + (0.0 if self.film is None else self.film.coarse_otf(lag_x, lag_y))

    def coarse_grid(self, lag_x_um: Floats, lag_y_um: Floats) -> Floats:
        """The coarse OTF where columns [n] of lags cross rows [m] of them, [m, n], faster still."""
        self._refuse_beyond_reach(lag_x_um, lag_y_um)
        cells_y, dots_y, cells_x, dots_x = self.values.shape
        table = self.values.reshape(cells_y * dots_y, cells_x * dots_x)
        rows = np.zeros((lag_y_um.size, table.shape[1]))
        for row, weight in neighbours(self.y, lag_y_um, (cells_y, dots_y)):
            rows += weight[:, None] * table[row]
        grid = np.zeros((lag_y_um.size, lag_x_um.size))
        for column, weight in neighbours(self.x, lag_x_um, (cells_x, dots_x)):
            grid += weight * rows[:, column]
        return grid / self.energy_um2 + (0.0 if self.film is None else self.film.coarse_grid(lag_x_um, lag_y_um))

    def _refuse_beyond_reach(self, lag_x_um: Floats, lag_y_um: Floats) -> None:
        longest = max(abs(lag_x_um).max(initial=0.0), abs(lag_y_um).max(initial=0.0))
        if longest > self.reach_um * (1 + 1e-9):
            raise InternalError("MF901", f"lag {longest:g} um is beyond the table's reach of {self.reach_um:g} um")

    @property
    def near_um(self) -> float:
        """Lags shorter than that are near 0."""
        return _NEAR_DOTS * max(self.x.dot_um, self.y.dot_um)

    def error_at(self, lag_x_um: Floats, lag_y_um: Floats, *, coarse: bool = False) -> Floats:
        """Error bound of C(s) / C(0) at lags of equal shape, of the coarse one or of that with ``rims``."""
        parts = [each.at(lag_x_um, lag_y_um) for each in (self.coarse if coarse else self.unknown)]
        return np.asarray(self.floor + sum(parts, np.zeros(np.shape(lag_x_um))) / self.energy_um2)

    def coarse_error_on_grid(self, lag_x_um: Floats, lag_y_um: Floats) -> Floats:
        """The coarse bound where columns [n] of lags cross rows [m] of them, [m, n]."""
        parts = [each.on_grid(lag_x_um, lag_y_um) for each in self.coarse]
        return np.asarray(self.floor + sum(parts, np.zeros((lag_y_um.size, lag_x_um.size))) / self.energy_um2)

    @property
    def uncertainty(self) -> float:
        """Error bound of C(s) / C(0) at any lag within reach."""
        return self.floor + sum(each.largest_um2 for each in self.unknown) / self.energy_um2

    @property
    def cut_dots(self) -> int:
        """Number of cut dots whose shapes count."""
        return sum(rim.cut_dots for rim in self.rims)

    @property
    def coarse_uncertainty(self) -> float:
        """Error bound of the coarse transfer function at any lag within reach."""
        return self.floor + sum(each.largest_um2 for each in self.coarse) / self.energy_um2

    def affords(self, lags: int) -> bool:
        """Whether so many lags may be exact at once; of few polygons, or where there are none, they may."""
        return self.outline is None or lags * self.cut_dots <= _PAIRS_OF_OUTLINE

    def bounded_otf(self, lag_x_um: Floats, lag_y_um: Floats) -> tuple[Floats, Floats]:
        """C(s) / C(0) at lags [n], exact where that costs little, and a bound of the error of each."""
        values, errors = self.coarse_otf(lag_x_um, lag_y_um), self.error_at(lag_x_um, lag_y_um, coarse=True)
        if not self.rims:
            return values, errors
        meets = ~apart(self.rims[0].stop, lag_x_um, lag_y_um)
        near = (np.hypot(lag_x_um, lag_y_um) < self.near_um) & meets
        dots, exact = self.cut_dots, meets
        if self.outline is None or not self.affords(int(np.count_nonzero(exact))):
            if np.count_nonzero(exact) * dots > _FEW_PAIRS:
                exact = near
            if np.count_nonzero(exact & near) * dots > _FEW_NEAR_PAIRS:
                exact = exact & ~near
        values, errors = values * meets, errors * meets
        values[exact] = self.otf(lag_x_um[exact], lag_y_um[exact])
        errors[exact] = self.error_at(lag_x_um[exact], lag_y_um[exact])
        return values, errors

    @property
    def volume_um2(self) -> float:
        """Integral of C(s) / C(0) over all lags: the clear area, if the mask is binary."""
        own = self.sum_um2 * self.x.dot_um * self.y.dot_um / self.energy_um2
        return own if self.film is None else own + self.film.volume_um2


@dataclass(frozen=True, eq=False)
class _Outlined:
    """Polygons, as a correction of the means of a raster of them."""

    outline: OutlineLags
    means: LagTable

    @property
    def stop(self) -> Stop:
        return self.outline.stop

    @property
    def cut_dots(self) -> int:
        return _FEWEST_PARTS + self.outline.pairs + _PAIRS_OF_CUT * int(np.count_nonzero(~self.outline.whole))

    def correction_um2(self, lag_x_um: Floats, lag_y_um: Floats) -> Floats:
        means = self.means.coarse_otf(lag_x_um, lag_y_um) * self.means.energy_um2
        return self.outline.autocorrelation_um2(lag_x_um, lag_y_um) - means


def lag_table(pupil: Pupil, reach_um: float = np.inf, outline: OutlineLags | None = None) -> LagTable:
    """Autocorrelate a pupil by FFT over cells and dots at once.

    Args:
        reach_um: the largest lag along either axis that will be asked for; a shorter reach is a smaller transform.
        outline: polygons of which the pupil is a raster.
    """
    dot_area = pupil.x.dot_um * pupil.y.dot_um
    rows, columns = pupil.y.dot_index().ravel(), pupil.x.dot_index().ravel()
    across = columns if pupil.x.has_gutter else slice(None)

    def grey(part: slice) -> Floats:
        return pupil.grey_rows(rows[part])[:, across].reshape(-1, *_periods(pupil.x))

    sizes = lag_sizes(pupil.x, pupil.y, reach_um)
    values, total = correlated(grey, _periods(pupil.y), sizes, _held(pupil.x, pupil.y, reach_um, sizes))
    values *= dot_area
    values[0, 0, 0, 0] += (float(pupil.whole_variance.sum()) + float(pupil.rim_variance.sum())) * dot_area
    energy = float(values[0, 0, 0, 0])
    values.flags.writeable = False
    if outline is not None:
        energy = outline.area_um2
        held = values.copy()
        held[0, 0, 0, 0] = energy
        means = LagTable(pupil.x, pupil.y, held, reach_um, energy, outline.rounding, sum_um2=energy**2 / dot_area)
        coarse = _bounds(pupil, reach_um, rim=True)
        means = replace(means, coarse=coarse, outline=outline)
        return replace(means, rims=(_Outlined(outline, means),)) if outline.pairs else replace(means, unknown=coarse)
    rim = rim_lags(pupil, reach_um)
    # Areas are told to some last places of the stop's.
    rounding = 1e-15 + 4 * np.finfo(np.float64).eps * pupil.rim_row.size * pupil.stop.area_um2 / max(energy, 1e-300)
    coarse = _bounds(pupil, reach_um, rim=True)
    unknown = coarse if rim is None else _bounds(pupil, reach_um, rim=False)
    rims = () if rim is None else (rim,)
    return LagTable(pupil.x, pupil.y, values, reach_um, energy, rounding, unknown, coarse, rims, total * dot_area)


def _bounds(pupil: Pupil, reach_um: float, *, rim: bool) -> tuple[ShapeBounds, ...]:
    bounds = shape_bounds(pupil, reach_um, rim=rim)
    return () if bounds is None else (bounds,)


def lag_sizes(x: Lattice, y: Lattice, reach_um: float) -> list[int]:
    """Transforms along cells and dots of y and of x that fold nothing onto lags within reach."""
    counts = (*_periods(y), *_periods(x))
    return [
        fast_length(min(2 * n - 1, n + extra)) if n > 1 else 1
        for n, extra in zip(counts, (*_extra(y, reach_um), *_extra(x, reach_um)), strict=True)
    ]


def _held(x: Lattice, y: Lattice, reach_um: float, sizes: list[int]) -> list[int]:
    """Numbers of lags of cells and dots that a table holds: those within reach, of either sign."""
    extra = (*_extra(y, reach_um), *_extra(x, reach_um))
    return [min(2 * most + 1, size) for most, size in zip(extra, sizes, strict=True)]


def dot_blocks(x: Lattice, y: Lattice, values: NDArray[Scalar]) -> NDArray[Scalar]:
    """Values of intervals as those of dots, [cells y, dots y, cells x, dots x]; cells of one dot without a gutter."""
    dots = values[np.ix_(y.dot_index().ravel(), x.dot_index().ravel())]
    (cells_y, dots_y), (cells_x, dots_x) = _periods(y), _periods(x)
    return dots.reshape(cells_y, dots_y, cells_x, dots_x)


def _periods(lattice: Lattice) -> tuple[int, int]:
    """Cells and dots that must be told apart: without gutters every dot is its own cell."""
    return (lattice.cells, lattice.dots) if lattice.has_gutter else (lattice.cells * lattice.dots, 1)


def correlated(
    rows: Callable[[slice], Reals], shape: tuple[int, ...], sizes: list[int], held: list[int]
) -> tuple[Floats, float]:
    """Autocorrelation of values on dots by transforms of given sizes.

    Args:
        rows: gives [n, cells x, dots x] values of n rows of dots, those of one cell after those of another.
        shape: number of cells and dots along y.
        sizes: of the transforms along cells y, dots y, cells x and dots x.
        held: how many lags are wanted of each, the longest of them unfolded.

    Returns:
        Values [held], negative lags wrapped round, and their sum over all lags, held or not.
    """
    power, total = _power(rows, shape, sizes, held[0])
    values = np.empty(held)
    # Lags from 0 on, and those before it, which are at the end.
    parts = [[slice((n + 1) // 2), slice(-(n // 2), None)] if n > 1 else [slice(None)] for n in held[1:]]
    for part, lags in _lags(power, sizes):
        for chosen in itertools.product(*parts):
            values[(part, *chosen)] = lags[(slice(None), *chosen)]
    opposite = np.ix_(*(-np.arange(count) % count for count in held[1:]))
    for row in range(power.shape[1], held[0]):
        values[row] = values[held[0] - row][opposite]
    return values, total


def _power(
    rows: Callable[[slice], Reals], shape: tuple[int, ...], sizes: list[int], held: int
) -> tuple[NDArray[np.complexfloating[Any]], float]:
    """Autocorrelation along y of transforms along x, and its sum over all lags; opposite lags are alike.

    What is transformed along y is squared and transformed back a few columns at a time, never held in full. Lags within
    reach are fewer than rows, and take the place of columns that have been used. Of more values along x than are held
    at once all rows are transformed again.

    Returns:
        The autocorrelation [columns / few, lags from 0 on, dots y, few], the last few columns filled up.
    """
    cells, dots = shape
    lengths, axes = _along_x(sizes)
    few, kind = _COLUMNS_AT_A_TIME, np.result_type(rows(slice(1)).dtype, np.complex64)
    columns = math.prod(lengths[:-1]) * (lengths[-1] // 2 + 1)
    blocks, shape_of_lags = -(-columns // few), (held // 2 + 1, sizes[1], few)
    used, kept = cells * dots * few, math.prod(shape_of_lags)
    most = min(max(_MOST_HELD // used, 1), blocks)
    buffer = np.empty(most * used, dtype=kind)
    in_place = most == blocks and kept <= used
    power = buffer if in_place else np.empty(blocks * kept, dtype=kind)
    along_y, total = [0, 1] if sizes[1] > 1 else [0], 0.0
    field = np.empty((*sizes[:2], few), dtype=kind)
    for first in range(0, blocks, most):
        spectrum = buffer.reshape(most, cells * dots, few)
        part_of_row = slice(first * few, min((first + most) * few, columns))
        whole, rest = divmod(part_of_row.stop - part_of_row.start, few)
        spectrum[whole:, :, rest:] = 0
        for start in range(0, cells * dots, _ROWS_AT_A_TIME):
            part = slice(start, min(start + _ROWS_AT_A_TIME, cells * dots))
            waves = np.fft.rfftn(rows(part), lengths, axes).reshape(part.stop - start, -1)[:, part_of_row]
            spectrum[:whole, part] = waves[:, : whole * few].reshape(len(waves), whole, few).swapaxes(0, 1)
            if rest:
                spectrum[whole, part, :rest] = waves[:, whole * few :]
        for block in range(first, min(first + most, blocks)):
            field[...] = 0
            field[:cells, :dots] = spectrum[block - first].reshape(cells, dots, few)
            waves = np.fft.fftn(field, axes=along_y)
            squares = waves.real**2
            squares += waves.imag**2
            if block == 0:
                total = float(squares[0, 0, 0])
            # Squares are real, so half of the lags tell the others.
            lags = np.fft.rfftn(squares, axes=along_y[::-1], norm="forward")
            np.conj(lags[: shape_of_lags[0]], out=power[block * kept : (block + 1) * kept].reshape(shape_of_lags))
    if in_place:
        del spectrum
        power.resize(blocks * kept, refcheck=False)
    power = power.reshape(blocks, *shape_of_lags)
    return power, total


def _lags(power: NDArray[np.complexfloating[Any]], sizes: list[int]) -> Iterator[tuple[slice, Floats]]:
    """The autocorrelation at lags along x, [n, dots y, cells x, dots x] a few rows at a time."""
    lengths, axes = _along_x(sizes)
    shape = [*sizes[2:]]
    shape[axes[-1]] = lengths[-1] // 2 + 1
    few = max(1, _ROWS_AT_A_TIME // sizes[1])
    for start in range(0, power.shape[1], few):
        rows = slice(start, min(start + few, power.shape[1]))
        waves = np.moveaxis(power[:, rows], 0, 2).reshape(rows.stop - start, sizes[1], -1)
        waves = waves[..., : math.prod(shape)].reshape(*waves.shape[:2], *shape)
        yield rows, np.fft.irfftn(waves, lengths, axes)


def _along_x(sizes: list[int]) -> tuple[list[int], list[int]]:
    """Sizes and axes of transforms over the last two axes, without those of a single value."""
    axes = [k for k in (-2, -1) if sizes[k] > 1] or [-1]
    return [sizes[k] for k in axes], axes


def _extra(lattice: Lattice, reach_um: float) -> tuple[int, int]:
    """Padding of the cells and of the dots that keeps lags up to the reach apart from folded ones."""
    pitch = lattice.pitch_um if lattice.has_gutter else lattice.dot_um
    cells, dots = _periods(lattice)
    return cells if not np.isfinite(reach_um) else int(np.ceil(reach_um / pitch)) + 2, dots


def neighbours(lattice: Lattice, lag: Floats, sizes: tuple[int, int]) -> Iterator[tuple[Indices, Floats]]:
    """Flat indices into a table of lags [cells, dots] along one axis, and weights that interpolate it linearly."""
    cells, dots = _periods(lattice)
    pitch = lattice.pitch_um if lattice.has_gutter else lattice.dot_um
    whole = np.floor(lag / pitch)
    for cell in (whole, whole + 1):
        within = (lag - cell * pitch) / lattice.dot_um
        if dots == 1:
            # A cell of one dot meets others in one way only.
            ways = [(np.zeros(()), np.maximum(1 - abs(within), 0))]
        else:
            base = np.floor(within)
            ways = [(base, 1 - (within - base)), (base + 1, within - base)]
        for dot, weight in ways:
            valid = (abs(cell) < cells) & (abs(dot) < dots)
            place = (cell + sizes[0] * (cell < 0)) * sizes[1] + dot + sizes[1] * (dot < 0)
            yield (place * valid).astype(np.intp), weight * valid


_LAG_ROWS_AT_A_TIME = 128


@dataclass(frozen=True, eq=False)
class AxisLags(Frozen):
    """The pupil's autocorrelation along one axis, the lag along the other being 0.

    Attributes:
        values: float64 [cells, dots] in square micrometres, negative lags wrapped round, good for every lag.
        step_um: of the bounds.
        bounds: float64 [n], of what the means of dots do not tell, from each whole step to the next.
        film: what a film adds that leaks.
    """

    lattice: Lattice
    values: Floats
    step_um: float
    bounds: Floats
    film: AxisLags | None = None

    def at(self, lag_um: Floats) -> Floats:
        """The autocorrelation at lags of any shape; linear between the table's, which is exact for whole dots."""
        total = np.zeros(lag_um.shape)
        cells, dots = self.values.shape
        for place, weight in neighbours(self.lattice, lag_um, (cells, dots)):
            total += weight * self.values.ravel()[place]
        return total if self.film is None else total + self.film.at(lag_um)

    def error_at(self, lag_um: Floats, table: LagTable) -> Floats:
        """Error of C(s) / C(0) at lags of any shape."""
        steps = np.minimum(abs(lag_um) / self.step_um, self.bounds.size - 1).astype(np.intp)
        return table.floor + self.bounds[steps] / table.energy_um2

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
        dot_lag = dot * np.fft.fftfreq(dots, 1 / dots)
        # Opposite lags are alike.
        weighed = self.values[: cell_lag.size] * np.where(cell_lag > 0, 2.0, 1.0)[:, None]
        along, between = (np.exp(2j * np.pi * places[:, None] * lag) for lag in (cell_lag, dot_lag))
        total = np.empty((places.size, offsets.size))
        for k, offset in enumerate(offsets):
            cell_turn, dot_turn = (np.exp(2j * np.pi * offset * lag) for lag in (cell_lag, dot_lag))
            total[:, k] = ((along @ (cell_turn[:, None] * weighed * dot_turn)) * between).real.sum(axis=1)
        total *= dot * np.sinc(dot * (places[:, None] + offsets)) ** 2
        return total if self.film is None else total + self.film.transform(places, offsets)


def axis_lags(pupil: Pupil, energy_um2: float) -> tuple[AxisLags, AxisLags]:
    """Autocorrelations along x and along y at every lag up to the pupil's width.

    Args:
        energy_um2: the value at lag 0, which dots that the stop cuts do not give by their means.
    """
    grey = pupil.mean_transmission[np.ix_(pupil.y.dot_index().ravel(), pupil.x.dot_index().ravel())]
    area = pupil.x.dot_um * pupil.y.dot_um
    tables = []
    for along_x, lattice, rows in ((True, pupil.x, grey), (False, pupil.y, grey.T)):
        period = _periods(lattice)
        sizes = [fast_length(2 * n - 1) for n in period]
        axes, sizes = ([1], sizes[:1]) if period[1] == 1 else ([1, 2], sizes)
        power: Floats | float = 0.0
        for start in range(0, len(rows), _LAG_ROWS_AT_A_TIME):
            part = rows[start : start + _LAG_ROWS_AT_A_TIME]
            spectrum = np.fft.rfftn(part.reshape(-1, *period), sizes, axes=axes)
            power = power + (spectrum.real**2 + spectrum.imag**2).sum(axis=0)
        values = np.fft.irfftn(power, sizes, axes=[axis - 1 for axis in axes]) * area
        values[0, 0] = energy_um2
        tables.append(AxisLags(lattice, values, *axis_bounds(pupil, along_x=along_x)))
    return tables[0], tables[1]
