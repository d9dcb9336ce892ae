"""The far field of a pupil by a matrix transform, exact for every interval.

The field at spatial frequency (u, v) is the Fourier integral of the amplitude,

    F(u, v) = ∫∫ a(x, y) exp(-2πi (ux + vy)) dx dy                        (Goodman, Fourier Optics, 4.2.5),

and an interval of width w centred at c with Legendre profile P_p contributes, exactly,

    ∫ P_p(2(x - c)/w) exp(-2πiux) dx = w (-i)^p j_p(πuw) exp(-2πiuc)       (DLMF 10.54.2 with 18.17.19),

whose p = 0 case is the familiar w sinc(uw). On a grid that is symmetric about the axis the real amplitude splits into
parts even and odd in x and in y, and four real products of a quarter of the size replace one complex one.

The dots that the stop cuts become a small grid of sources. A rim has few dots but a column of moments each, and as a
matrix over all intervals it costs more than everything that is not cut. Folded into one quadrant it lies in two bands:
dots nearer to the x axis fill a tall, narrow one, the others a low, wide one. Each is narrow one way, so its sources on
Chebyshev nodes (:mod:`maskfab.optics.field.waves`) are a slim matrix, and the frequencies alone decide how many there
are, not the dots.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Complexes, Floats, Indices, distinct
from maskfab.base.errors import InternalError
from maskfab.base.model import Scalar
from maskfab.optics.field.waves import (
    FrequencyNodes,
    Positions,
    Precision,
    Reals,
    frequency_nodes,
    nodes_for,
    point_sources,
    real_type,
    reduced_cycles,
    right_half,
)
from maskfab.optics.polynomials import spherical_bessel, spherical_bessel_bounds
from maskfab.optics.pupil import Pupil

# Bound of the field's relative L2 error from the orders left out.
_TOLERANCE = 2e-13
_MOST_ORDERS = 64
# Squares of amplitudes below 1e-150 are not told from nothing.
_LEAST_ENERGY_UM2 = 1e-290


def rim_terms(pupil: Pupil, highest_u: float, highest_v: float, precision: Precision) -> tuple[WaveProduct, ...]:
    """The dots that the stop cuts as at most two bands of sources, good for frequencies up to the highest given."""
    if not pupil.rim_row.size:
        return ()
    x, y = pupil.x.edges_um(), pupil.y.edges_um()
    column, row = _folded(pupil.rim_column, x.size - 1), _folded(pupil.rim_row, y.size - 1)
    beside = x[column] + x[column + 1] >= y[row] + y[row + 1]
    orders = rim_orders(pupil, highest_u, highest_v)
    if pupil.x == pupil.y and highest_u == highest_v:
        # The bands are each other's mirror images, and share nodes and waves.
        narrow = _side(x, np.concatenate([column[beside], row[~beside]]), highest_u, orders)
        long = _side(x, np.concatenate([row[beside], column[~beside]]), highest_u, orders)
        bands = [(beside, narrow, long), (~beside, long, narrow)]
    else:
        bands = [
            (chosen, _side(x, column[chosen], highest_u, orders), _side(y, row[chosen], highest_v, orders))
            for chosen in (beside, ~beside)
            if chosen.any()
        ]
    return tuple(
        slim_term(
            along_x.positions, along_y.positions, _band(pupil, np.flatnonzero(chosen), along_x, along_y), precision
        )
        for chosen, along_x, along_y in bands
        if chosen.any()
    )


def rim_orders(pupil: Pupil, highest_u: float, highest_v: float) -> int:
    """Number of Legendre orders of the rim that matter at the highest frequency; at least one.

    What cut dots hold in orders from P on is their clear share less the squares of the moments before (Parseval). At
    most (2P + 1) j_P² of that lies within the phase that j_P is taken at.
    """
    if not pupil.rim_row.size:
        return 1
    widths, heights = np.diff(pupil.x.edges_um())[pupil.rim_column], np.diff(pupil.y.edges_um())[pupil.rim_row]
    phase = np.pi * np.maximum(highest_u * widths.max(), highest_v * heights.max())
    size = (2 * np.arange(_MOST_ORDERS) + 1) * spherical_bessel_bounds(phase, _MOST_ORDERS) ** 2
    needed = np.flatnonzero(size * _left_out(pupil, widths * heights) >= _TOLERANCE**2)
    return int(needed[-1]) + 1 if needed.size else 1


def _left_out(pupil: Pupil, area_um2: Floats) -> Floats:
    """Share of the field's energy in the rim's orders from P on, float64 [_MOST_ORDERS]."""
    shape = pupil.rim_moments / pupil.rim_transmission[:, None, None]
    weight = 2 * np.arange(shape.shape[1]) + 1
    squares, energy_um2 = pupil.rim_transmission**2, pupil.energy_um2
    if energy_um2 < _LEAST_ENERGY_UM2:
        # As if the rim held all the light, which asks for no fewer orders.
        squares, energy_um2 = np.ones_like(squares), float(area_um2.sum())
    light = area_um2 * squares / energy_um2
    held = weight[:, None] * weight * np.tensordot(light, shape**2, 1)
    before = np.array([held[:order, :order].sum() for order in range(len(held) + 1)])
    left = np.clip(light @ shape[:, 0, 0] - before, 0, None)
    return np.append(left, np.full(_MOST_ORDERS - left.size, left[-1]))


@dataclass(frozen=True, eq=False)
class _Side:
    """One axis of a band: numbers of its intervals, intp [k], and their moments as of :meth:`Nodes.moments`."""

    positions: Positions
    index: Indices
    moments: Floats

    def of(self, index: Indices) -> Floats:
        taken: Floats = self.moments[np.searchsorted(self.index, index)]
        return taken


def _side(edges: Floats, index: Indices, highest: float, orders: int) -> _Side:
    held = distinct(index)
    low, high = edges[held], edges[held + 1]
    nodes = nodes_for(float(low[0]), float(high[-1]), highest)
    moments = nodes.moments(low, high, orders, orders + 2)
    return _Side(point_sources(nodes.position_um), held, moments)


def _folded(index: Indices, count: int) -> Indices:
    """Intervals left of the axis replaced by their mirror images; one that straddles it stays."""
    return np.maximum(index, count - 1 - index)


def _band(pupil: Pupil, chosen: Indices, along_x: _Side, along_y: _Side) -> Floats:
    """Strengths of a band's nodes in square micrometres, [2, 2, ny, nx], for parts even or odd in y and in x."""
    rows, columns = pupil.whole.shape
    row, column = _folded(pupil.rim_row[chosen], rows), _folded(pupil.rim_column[chosen], columns)
    below, left = row != pupil.rim_row[chosen], column != pupil.rim_column[chosen]
    orders = along_x.moments.shape[1]
    rim = pupil.moments(orders)
    signs = (-1.0) ** np.arange(orders)
    ny, nx = along_y.positions.count, along_x.positions.count
    quadrants = np.empty((2, 2, ny, nx))
    for flip_y in (0, 1):
        for flip_x in (0, 1):
            cells = np.flatnonzero((below == flip_y) & (left == flip_x))
            # Mirroring an interval multiplies P_p by (-1)^p.
            moments = rim[chosen[cells]] * np.where(flip_y, signs, 1.0)[:, None] * np.where(flip_x, signs, 1.0)
            across = (moments @ along_x.of(column[cells])).reshape(-1, nx)
            np.matmul(along_y.of(row[cells]).reshape(-1, ny).T, across, out=quadrants[flip_y, flip_x])
    # Mirror images add in the even part and subtract in the odd one.
    for turned in (quadrants, quadrants.transpose(1, 0, 2, 3)):
        odd = turned[0] - turned[1]
        turned[0] += turned[1]
        turned[1] = odd
    return quadrants


Waves = tuple[Reals, Reals]

_BLOCK, _ROWS_AT_A_TIME = 64, 32
# Below this saving the longer chain of smaller products is no faster.
_WORTHWHILE = 0.9


@dataclass(frozen=True, eq=False)
class ParityField:
    """The field on the quadrant u, v >= 0, split by parity: ``even_odd`` is even in v and odd in u, [nv, nu] each.

    F(u, v) = even_even - odd_odd - i (odd_even + even_odd), and reflections in u or v change the signs of odd parts.

    Attributes:
        on_axis: whether the first u and the first v are 0, and so are their own mirror images.
    """

    even_even: Floats
    even_odd: Floats
    odd_even: Floats
    odd_odd: Floats
    on_axis: bool

    def intensity(self) -> Floats:
        """|F|² on the symmetric grid that the quadrant spans, [2 nv - 1, 2 nu - 1], or [2 nv, 2 nu] off axis."""
        same, opposite = self.quadrants()
        return self._mirrored(same, opposite, same, opposite)

    def quadrants(self) -> tuple[Floats, Floats]:
        """|F|² at (±u, ±v) and at (∓u, ±v), [nv, nu] each: all of it, since opposite frequencies are alike."""
        same = _sum_of_squares(self.even_even - self.odd_odd, self.odd_even + self.even_odd)
        opposite = _sum_of_squares(self.even_even + self.odd_odd, self.odd_even - self.even_odd)
        return same, opposite

    def amplitude(self) -> Complexes:
        """F on the same grid as :meth:`intensity`."""
        same = (self.even_even - self.odd_odd) - 1j * (self.odd_even + self.even_odd)
        opposite = (self.even_even + self.odd_odd) - 1j * (self.odd_even - self.even_odd)
        # The amplitude is real, so opposite frequencies are complex conjugates.
        return self._mirrored(same, opposite, same.conj(), opposite.conj())

    def _mirrored(
        self,
        right_up: NDArray[Scalar],
        left_up: NDArray[Scalar],
        left_down: NDArray[Scalar],
        right_down: NDArray[Scalar],
    ) -> NDArray[Scalar]:
        rows, columns = right_up.shape
        first = 1 if self.on_axis else 0
        grid = np.empty((2 * rows - first, 2 * columns - first), dtype=right_up.dtype)
        above, right = slice(rows - first, None), slice(columns - first, None)
        below, left = slice(0, rows - first), slice(0, columns - first)
        grid[above, right] = right_up
        grid[above, left] = left_up[:, first:][:, ::-1]
        grid[below, left] = left_down[first:, first:][::-1, ::-1]
        grid[below, right] = right_down[first:][::-1]
        return grid


def _sum_of_squares(one: Floats, other: Floats) -> Floats:
    """Sum of squares, written over ``one``: fresh memory costs more than the sums."""
    one *= one
    other *= other
    one += other
    return one


def parity_of(above: Complexes, below: Complexes, on_axis: bool) -> ParityField:
    """The split of a real amplitude's field that is known at (u, v) and at (u, -v), u, v >= 0, [nv, nu] each."""
    return ParityField(
        (above.real + below.real) / 2,
        -(above.imag + below.imag) / 2,
        (below.imag - above.imag) / 2,
        (below.real - above.real) / 2,
        on_axis,
    )


@dataclass(frozen=True, eq=False)
class WaveProduct:
    """One product of waves along y, a core, and waves along x.

    Attributes:
        x, y: sources right of and above the axis; one object for both where they are alike, so that waves are shared.
        core: [2, 2, ny, nx] their strengths, for the parts of the field that are even or odd in y and in x.
        reach: how many rows from the axis the core needs, for every ``_BLOCK`` columns: a round stop leaves its corner
            empty.
    """

    x: Positions
    y: Positions
    core: Reals
    reach: tuple[int, ...]

    def part(self, along_y: Reals, along_x: Reals, odd_y: int, odd_x: int) -> Reals:
        """One part of its field, [nv, nu], from waves along y [ny, nv] and x [nx, nu] of that parity."""
        core = self.core[odd_y, odd_x]
        y_first, x_first = _orders_of_sums(core.shape, along_x.shape[1], along_y.shape[1])
        if x_first < y_first:
            part: Reals = along_y.T @ (core @ along_x)
            return part
        rows = np.empty((along_y.shape[1], core.shape[1]), dtype=core.dtype)
        for k, reach in enumerate(self.reach):
            columns = slice(k * _BLOCK, (k + 1) * _BLOCK)
            np.matmul(along_y[:reach].T, core[:reach, columns], out=rows[:, columns])
        return rows @ along_x


def _orders_of_sums(core: Sequence[int], nu: int, nv: int) -> tuple[int, int]:
    """Multiplications with the sum along y first, which leaves the other the columns, and along x first."""
    ny, nx = core
    return nv * nx * (ny + nu), nu * ny * (nx + nv)


def multiplications(
    cores: Sequence[Sequence[int]], nu: int, nv: int, nodes_u: FrequencyNodes, nodes_v: FrequencyNodes
) -> tuple[int, bool]:
    """Multiplications of one part of the field, by nodes of frequency if these are few, and whether they are.

    Args:
        cores: shapes [ny, nx] of what is added up.
    """
    plain = sum(min(_orders_of_sums(core, nu, nv)) for core in cores)
    by_nodes = sum(min(_orders_of_sums(core, nodes_u.count, nodes_v.count)) for core in cores)
    by_nodes += nv * nodes_u.count * (nodes_v.count + nu)
    return (by_nodes, True) if by_nodes <= _WORTHWHILE * plain else (plain, False)


@dataclass(frozen=True, eq=False)
class PreparedField:
    """A pupil folded into a quadrant, ready for any wavelength.

    Attributes:
        highest_u, highest_v: frequencies up to which the terms hold, cycles per micrometre.
    """

    terms: tuple[WaveProduct, ...]
    highest_u: float
    highest_v: float
    precision: Precision

    def field(self, u: Floats, v: Floats) -> ParityField:
        """The field at non-negative, ascending frequencies, [nu] and [nv]; both begin at 0 or neither does."""
        if u[-1] > self.highest_u * (1 + 1e-9) or v[-1] > self.highest_v * (1 + 1e-9):
            what = (
                f"frequencies up to {u[-1]:g} and {v[-1]:g} cycles/um are beyond the {self.highest_u:g} and "
                f"{self.highest_v:g} that the pupil was prepared for"
            )
            raise InternalError("MF901", what)
        nodes_u, nodes_v = (
            frequency_nodes(max(axis.reach_um for axis in axes), float(frequency[-1]), self.precision)
            for axes, frequency in (([t.x for t in self.terms], u), ([t.y for t in self.terms], v))
        )
        cores = [term.core.shape[2:] for term in self.terms]
        if not multiplications(cores, u.size, v.size, nodes_u, nodes_v)[1]:
            return _whole(self._parts(u, v), on_axis=bool(u[0] == 0))
        return SampledField(nodes_u, nodes_v, self._parts(nodes_u.frequency, nodes_v.frequency)).field(u, v)

    def _parts(self, u: Floats, v: Floats) -> Reals:
        """The parts of the field that are even or odd in v and in u, [2, 2, nv, nu]."""
        of_u = _waves_by_source([term.x for term in self.terms], u, self.precision, {})
        shared = of_u if np.array_equal(u, v) else {}
        of_v = _waves_by_source([term.y for term in self.terms], v, self.precision, shared)
        parts = np.zeros((2, 2, v.size, u.size), dtype=real_type(self.precision))
        for term in self.terms:
            for odd_y, odd_x in np.ndindex(2, 2):
                parts[odd_y, odd_x] += term.part(of_v[id(term.y)][odd_y], of_u[id(term.x)][odd_x], odd_y, odd_x)
        return parts


@dataclass(frozen=True, eq=False)
class SampledField:
    """A field at so few frequencies that they give it at all others up to the highest, for many wavelengths.

    Attributes:
        parts: [2, 2, nodes v, nodes u] the parts that are even or odd in v and in u.
    """

    nodes_u: FrequencyNodes
    nodes_v: FrequencyNodes
    parts: Reals

    @classmethod
    def of(
        cls,
        field: Callable[[Floats, Floats], ParityField],
        reach_um: tuple[float, float],
        highest: tuple[float, float],
        precision: Precision = "double",
    ) -> SampledField:
        """Sample a field.

        Args:
            field: at non-negative, ascending frequencies u and v.
            reach_um: how far from the axis its light lies along x and y.
            highest: u and v that will be asked for, cycles per micrometre.
            precision: of the samples and of what they are carried with.
        """
        nodes = [frequency_nodes(reach, top, precision) for reach, top in zip(reach_um, highest, strict=True)]
        sampled = field(*(node.frequency[::-1] for node in nodes))
        parts = np.array([[sampled.even_even, sampled.even_odd], [sampled.odd_even, sampled.odd_odd]])[:, :, ::-1, ::-1]
        return cls(nodes[0], nodes[1], parts.astype(real_type(precision), order="C"))

    def field(self, u: Floats, v: Floats) -> ParityField:
        """The field at non-negative, ascending frequencies up to the highest, [nu] and [nv]."""
        across = self.nodes_u.interpolation(u)
        up = across if self.nodes_u == self.nodes_v and np.array_equal(u, v) else self.nodes_v.interpolation(v)
        return _whole(up.transpose(0, 2, 1)[:, None] @ self.parts @ across, on_axis=bool(u[0] == 0))

    def at(self, u: Floats, v: Floats) -> Complexes:
        """The field at any frequencies up to the highest, of either sign, [nv, nu] from [nu] and [nv]."""
        alike = self.nodes_u == self.nodes_v
        waves = []
        for nodes, frequency in (
            [(self.nodes_u, np.concatenate([u, v]))] if alike else [(self.nodes_u, u), (self.nodes_v, v)]
        ):
            most = float(abs(frequency).max())
            if most > nodes.highest * (1 + 1e-9):
                what = f"a frequency of {most:g} cycles/um is beyond the {nodes.highest:g} that a field was sampled for"
                raise InternalError("MF901", what)
            waves.append(nodes.interpolation(frequency))
        of_u, of_v = (waves[0][:, :, : u.size], waves[0][:, :, u.size :]) if alike else waves
        (ee, oe), (eo, oo) = self._columns @ of_u[:, None]
        even_v, odd_v = of_v.transpose(0, 2, 1)
        found = np.empty((v.size, u.size), dtype=np.complex128)
        found.real = even_v @ ee - odd_v @ oo
        found.imag = -(odd_v @ oe) - even_v @ eo
        return found

    @cached_property
    def _columns(self) -> Reals:
        """Parts by their parity in u, then in v."""
        return np.ascontiguousarray(self.parts.swapaxes(0, 1))


def _whole(parts: Reals, on_axis: bool) -> ParityField:
    (ee, eo), (oe, oo) = parts.astype(np.float64, copy=False)
    return ParityField(ee, eo, oe, oo, on_axis)


def _waves_by_source(
    sources: Sequence[Positions], frequency: Floats, precision: Precision, shared: Mapping[int, Waves]
) -> dict[int, Waves]:
    waves = dict(shared)
    for source in sources:
        if id(source) not in waves:
            waves[id(source)] = source.waves(frequency, precision)
    return waves


def prepare(pupil: Pupil, highest_u: float, highest_v: float, precision: Precision = "double") -> PreparedField:
    """Fold a pupil, once for all wavelengths.

    Args:
        pupil: openings inside the stop, on lattices that are symmetric about the axis.
        highest_u, highest_v: the highest frequencies that will be asked for, cycles per micrometre.
        precision: of the products; single errs by 3e-7 to 3e-6 of the PSF.
    """
    along_x = right_half(pupil.x)
    along_y = along_x if pupil.x == pupil.y else right_half(pupil.y)
    # Sums of two dots' bytes stay bytes, an eighth of the memory, where none has to be halved.
    bytes_do = pupil.whole.dtype == np.uint8 and not any(count % 2 for count in pupil.whole.shape)
    dots = pupil.whole.view(np.int8) if bytes_do else pupil.whole.astype(real_type(precision), copy=False)
    whole = slim_term(along_x, along_y, fold(dots), precision)
    return PreparedField((whole, *rim_terms(pupil, highest_u, highest_v, precision)), highest_u, highest_v, precision)


def slim_term(along_x: Positions, along_y: Positions, core: NDArray[Any], precision: Precision) -> WaveProduct:
    """A term, its core [2, 2, ny, nx] in the given precision."""
    columns = core.shape[3]
    filled = (core != 0).any(axis=(0, 1)).reshape(core.shape[2:])
    blocks = [filled[:, start : start + _BLOCK].any(axis=1) for start in range(0, columns, _BLOCK)]
    reach = tuple(int(np.flatnonzero(rows)[-1]) + 1 if rows.any() else 0 for rows in blocks)
    return WaveProduct(along_x, along_y, core.astype(real_type(precision), copy=False), reach)


def parity_field(pupil: Pupil, u: Floats, v: Floats, precision: Precision = "double") -> ParityField:
    """The field of a pupil whose lattices are symmetric about the axis.

    Args:
        u, v: non-negative frequencies in cycles per micrometre, ascending, [nu] and [nv]; both begin at 0 or neither.
        precision: of the products; single errs by 3e-7 to 3e-6 of the PSF.
    """
    return prepare(pupil, float(u[-1]), float(v[-1]), precision).field(u, v)


def direct_field(pupil: Pupil, u: Floats, v: Floats, precision: Precision = "double") -> Complexes:
    """The field at any frequencies on any lattice by complex products, [nv, nu]: slower, and a check of the split."""
    orders = rim_orders(pupil, float(abs(u).max()), float(abs(v).max()))
    kind = np.complex128 if precision == "double" else np.complex64
    x_kernels = _complex_kernels(pupil.x.edges_um(), u, orders)
    y_kernels = _complex_kernels(pupil.y.edges_um(), v, orders)
    total: Complexes = y_kernels[0].T.astype(kind) @ pupil.whole.astype(kind) @ x_kernels[0].astype(kind)
    total = total.astype(np.complex128, copy=False)
    if not pupil.rim_row.size:
        return total
    import scipy  # slow to load, and of rims alone

    weight = 2 * np.arange(orders) + 1
    moments = pupil.moments(orders) * weight[:, None] * weight
    rows, columns = pupil.whole.shape
    place = np.repeat(pupil.rim_column, orders), (pupil.rim_row[:, None] + rows * np.arange(orders)).ravel()
    stacked = np.concatenate(y_kernels)
    for p in range(orders):
        rim = scipy.sparse.coo_array((moments[:, :, p].ravel(), place), (columns, orders * rows))
        total += (rim.tocsr() @ stacked).T @ x_kernels[p]
    return total


def _complex_kernels(edges: Floats, frequency: Floats, orders: int) -> list[Complexes]:
    """Transforms of P_0, P_1, ... on every interval, [intervals, m] each."""
    width = np.diff(edges)
    phase = np.exp(-2j * np.pi * reduced_cycles((edges[1:] + edges[:-1]) / 2, frequency))
    # A lattice has few different widths, so each is worked out once.
    different, which = np.unique(np.round(width, 11), return_inverse=True)
    argument = np.pi * different[:, None] * frequency
    size = different[:, None] * spherical_bessel(abs(argument), orders)
    signs = np.where(argument < 0, -1.0, 1.0)
    return [(-1j) ** p * (size[p] * signs**p)[which] * phase for p in range(orders)]


def fold(matrix: NDArray[Any]) -> NDArray[Any]:
    """The four parities of a matrix on the half grids right of and above the axis, [2, 2, rows / 2, columns / 2].

    A row or column on the axis is its own mirror image, and is halved.
    """
    rows, columns = matrix.shape
    up, right = rows // 2, columns // 2
    parts = np.empty((2, 2, rows - up, columns - right), dtype=matrix.dtype)
    above, below = matrix[up:], matrix[: rows - up][::-1]
    # A few rows at a time stay in the processor's cache.
    for start in range(0, rows - up, _ROWS_AT_A_TIME):
        some = slice(start, start + _ROWS_AT_A_TIME)
        for half, values in zip(parts, (above[some] + below[some], above[some] - below[some]), strict=True):
            mirrored = values[:, : columns - right][:, ::-1]
            np.add(values[:, right:], mirrored, out=half[0, some])
            np.subtract(values[:, right:], mirrored, out=half[1, some])
    if columns % 2:
        parts[:, :, :, 0] /= 2
    if rows % 2:
        parts[:, :, 0] /= 2
    return parts
