r"""The far field of a pupil by a matrix transform, exact for every interval.

The field at spatial frequency (u, v) is the Fourier integral of the amplitude,

    F(u, v) = ∫∫ a(x, y) exp(-2πi (ux + vy)) dx dy                        (Goodman, Fourier Optics, 4.2.5),

and an interval of width w centred at c with Legendre profile P_p contributes, exactly,

    ∫ P_p(2(x - c)/w) exp(-2πiux) dx = w (-i)^p j_p(πuw) exp(-2πiuc)       (DLMF 10.54.2 with 18.17.19),

whose p = 0 case is the familiar w sinc(uw). On a grid that is symmetric about the axis the real amplitude splits into
parts even and odd in x and in y, and four real products of a quarter of the size replace one complex one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.special import spherical_jn

from maskfab.errors import InternalError
from maskfab.model import Scalar
from maskfab.optics.basis import Factors, factors
from maskfab.optics.pupil import Pupil
from maskfab.optics.rim import rim_bands, rim_orders
from maskfab.optics.waves import Positions, Precision, Reals, real_type, reduced_cycles, right_half

Floats = NDArray[np.float64]
Waves = tuple[Reals, Reals]
Pair = tuple[Factors, Factors]

_BLOCK = 64


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
        same = (self.even_even - self.odd_odd) ** 2
        same += (self.odd_even + self.even_odd) ** 2
        opposite = (self.even_even + self.odd_odd) ** 2
        opposite += (self.odd_even - self.even_odd) ** 2
        return self._mirrored(same, opposite, same, opposite)

    def amplitude(self) -> NDArray[np.complex128]:
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


def parity_of(above: NDArray[np.complex128], below: NDArray[np.complex128], on_axis: bool) -> ParityField:
    """The split of a real amplitude's field that is known at (u, v) and at (u, -v), u, v >= 0, [nv, nu] each."""
    return ParityField(
        (above.real + below.real) / 2,
        -(above.imag + below.imag) / 2,
        (below.imag - above.imag) / 2,
        (below.real - above.real) / 2,
        on_axis,
    )


@dataclass(frozen=True, eq=False)
class Term:
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

    def y_first(self, nu: int, nv: int) -> bool:
        """Whether to sum along y before x, which leaves the other sum the columns."""
        ny, nx = self.core.shape[2:]
        return bool(nv * nx * (ny + nu) <= nu * ny * (nx + nv))

    def sum_rows(self, waves: Reals, odd_y: int, odd_x: int, out: Reals) -> None:
        """Sum one part of the core along y, [ny, nv] waves into [nv, nx]."""
        core = self.core[odd_y, odd_x]
        for k, rows in enumerate(self.reach):
            columns = slice(k * _BLOCK, (k + 1) * _BLOCK)
            np.matmul(waves[:rows].T, core[:rows, columns], out=out[:, columns])


@dataclass(frozen=True, eq=False)
class PreparedField:
    """A pupil folded into a quadrant, ready for any wavelength.

    Attributes:
        terms: what to add up.
        highest_u, highest_v: frequencies up to which the terms hold, cycles per micrometre.
        precision: of waves and products.
    """

    terms: tuple[Term, ...]
    highest_u: float
    highest_v: float
    precision: Precision

    def field(self, u: Floats, v: Floats) -> ParityField:
        """The field at non-negative, ascending frequencies, [nu] and [nv]; both begin at 0 or neither does.

        Raises:
            InternalError: MF901 if a frequency is beyond the highest that was prepared for.
        """
        if u[-1] > self.highest_u * (1 + 1e-9) or v[-1] > self.highest_v * (1 + 1e-9):
            raise InternalError(
                "MF901",
                f"frequencies up to {u[-1]:g} and {v[-1]:g} cycles/um are beyond the {self.highest_u:g} and "
                f"{self.highest_v:g} that the pupil was prepared for",
            )
        shared = np.array_equal(u, v)
        few = [self._factors(term, u, v, shared) for term in self.terms]
        plain = [term for term, factored in zip(self.terms, few, strict=True) if factored is None]
        of_u = _waves_by_source([term.x for term in plain], u, self.precision, {})
        of_v = _waves_by_source([term.y for term in plain], v, self.precision, of_u if shared else {})
        ways = [
            _Way(term, of_v[id(term.y)], of_u[id(term.x)]) if factored is None else _ShortWay(term, *factored)
            for term, factored in zip(self.terms, few, strict=True)
        ]
        ee, eo, oe, oo = (self._part(ways, v.size, u.size, y, x) for y in (0, 1) for x in (0, 1))
        return ParityField(ee, eo, oe, oo, on_axis=bool(u[0] == 0))

    def _factors(self, term: Term, u: Floats, v: Floats, shared: bool) -> tuple[Pair, Pair] | None:
        """The term's waves along y and x in factors, where both are worth it."""
        of_x = factors(term.x, u, self.precision)
        of_y = of_x if shared and term.x is term.y else factors(term.y, v, self.precision)
        return None if of_x is None or of_y is None else (of_y, of_x)

    def _part(self, ways: Sequence[_Way | _ShortWay], nv: int, nu: int, odd_y: int, odd_x: int) -> Floats:
        """One parity of the field, [nv, nu]: the inner sums of all terms side by side, then one outer product."""
        sizes = [way.size(odd_x) for way in ways]
        left = np.empty((nv, sum(sizes)), dtype=real_type(self.precision))
        right = np.empty((sum(sizes), nu), dtype=left.dtype)
        start = 0
        for way, size in zip(ways, sizes, strict=True):
            way.fill(odd_y, odd_x, left[:, start : start + size], right[start : start + size])
            start += size
        return (left @ right).astype(np.float64, copy=False)


@dataclass(frozen=True, eq=False)
class _Way:
    """A term with its waves along y and x, [n, m] each, even and odd."""

    term: Term
    along_y: Waves
    along_x: Waves

    @property
    def y_first(self) -> bool:
        return self.term.y_first(self.along_x[0].shape[1], self.along_y[0].shape[1])

    def size(self, odd_x: int) -> int:
        """How many sums are left between the two products."""
        return int(self.term.core.shape[3 if self.y_first else 2])

    def fill(self, odd_y: int, odd_x: int, left: Reals, right: Reals) -> None:
        """Write the factors whose product is the term's share, [nv, size] and [size, nu]."""
        if self.y_first:
            self.term.sum_rows(self.along_y[odd_y], odd_y, odd_x, left)
            right[:] = self.along_x[odd_x]
        else:
            left[:] = self.along_y[odd_y].T
            np.matmul(self.term.core[odd_y, odd_x], self.along_x[odd_x], out=right)


@dataclass(frozen=True, eq=False)
class _ShortWay:
    """The same with the waves in factors, which shrink the core before the waves are met."""

    term: Term
    along_y: Pair
    along_x: Pair

    def size(self, odd_x: int) -> int:
        """As for the other way."""
        return int(self.along_x[odd_x].wave.shape[0])

    def fill(self, odd_y: int, odd_x: int, left: Reals, right: Reals) -> None:
        """As for the other way."""
        of_y, of_x = self.along_y[odd_y], self.along_x[odd_x]
        rows = np.empty((of_y.pattern.shape[1], self.term.core.shape[3]), dtype=left.dtype)
        self.term.sum_rows(of_y.pattern, odd_y, odd_x, rows)
        np.matmul(of_y.wave.T, rows @ of_x.pattern, out=left)
        right[:] = of_x.wave


def _waves_by_source(
    sources: Sequence[Positions], frequency: Floats, precision: Precision, known: Mapping[int, Waves]
) -> dict[int, Waves]:
    """Waves of each different object among the sources, by its id."""
    waves = dict(known)
    for source in sources:
        if id(source) not in waves:
            waves[id(source)] = source.waves(frequency, precision)
    return waves


def prepare(pupil: Pupil, highest_u: float, highest_v: float, precision: Precision = "double") -> PreparedField:
    """Fold a pupil, once for all wavelengths.

    Args:
        pupil: openings inside the stop, on lattices that are symmetric about the axis.
        highest_u, highest_v: the highest frequencies that will be asked for, cycles per micrometre.
        precision: of the products; single errs by about 3e-7 of the PSF.

    Raises:
        InternalError: MF901 if a lattice is not symmetric.
    """
    along_x = right_half(pupil.x)
    along_y = along_x if pupil.x == pupil.y else right_half(pupil.y)
    whole = slim_term(along_x, along_y, fold(pupil.whole.astype(real_type(precision), copy=False)), precision)
    return PreparedField((whole, *rim_terms(pupil, highest_u, highest_v, precision)), highest_u, highest_v, precision)


def slim_term(along_x: Positions, along_y: Positions, core: Reals, precision: Precision) -> Term:
    """A term, its core [2, 2, ny, nx] in the given precision."""
    columns = core.shape[3]
    filled = (core != 0).any(axis=(0, 1)).reshape(core.shape[2:])
    blocks = [filled[:, start : start + _BLOCK].any(axis=1) for start in range(0, columns, _BLOCK)]
    reach = tuple(int(np.flatnonzero(rows)[-1]) + 1 if rows.any() else 0 for rows in blocks)
    return Term(along_x, along_y, core.astype(real_type(precision), copy=False), reach)


def rim_terms(pupil: Pupil, highest_u: float, highest_v: float, precision: Precision) -> tuple[Term, ...]:
    """The dots that the stop cuts, as terms."""
    bands = rim_bands(pupil, highest_u, highest_v)
    return tuple(slim_term(band.x, band.y, band.strength, precision) for band in bands)


def parity_field(pupil: Pupil, u: Floats, v: Floats, precision: Precision = "double") -> ParityField:
    """The field of a pupil whose lattices are symmetric about the axis.

    Args:
        pupil: openings inside the stop.
        u, v: non-negative frequencies in cycles per micrometre, ascending, [nu] and [nv]; both begin at 0 or neither.
        precision: of the products; single errs by about 3e-7 of the PSF.

    Raises:
        InternalError: MF901 if a lattice is not symmetric.
    """
    return prepare(pupil, float(u[-1]), float(v[-1]), precision).field(u, v)


def direct_field(pupil: Pupil, u: Floats, v: Floats, precision: Precision = "double") -> NDArray[np.complex128]:
    """The field at any frequencies on any lattice by complex products, [nv, nu]: slower, and a check of the split."""
    orders = rim_orders(pupil, float(abs(u).max()), float(abs(v).max()))
    kind = np.complex128 if precision == "double" else np.complex64
    x_kernels = _complex_kernels(pupil.x.edges_um(), u, orders)
    y_kernels = _complex_kernels(pupil.y.edges_um(), v, orders)
    total: NDArray[np.complex128] = y_kernels[0].T.astype(kind) @ pupil.whole.astype(kind) @ x_kernels[0].astype(kind)
    total = total.astype(np.complex128, copy=False)
    if not pupil.rim_row.size:
        return total
    weight = 2 * np.arange(orders) + 1
    moments = pupil.moments(orders) * weight[:, None] * weight
    rows, columns = pupil.whole.shape
    place = np.repeat(pupil.rim_column, orders), (pupil.rim_row[:, None] + rows * np.arange(orders)).ravel()
    stacked = np.concatenate(y_kernels)
    for p in range(orders):
        rim = sparse.coo_array((moments[:, :, p].ravel(), place), (columns, orders * rows))
        total += (rim.tocsr() @ stacked).T @ x_kernels[p]
    return total


def _complex_kernels(edges: Floats, frequency: Floats, orders: int) -> list[NDArray[np.complex128]]:
    """Transforms of P_0, P_1, ... on every interval, [intervals, m] each."""
    width = np.diff(edges)
    phase = np.exp(-2j * np.pi * reduced_cycles((edges[1:] + edges[:-1]) / 2, frequency))
    # A lattice has few different widths, so each is worked out once.
    different, which = np.unique(np.round(width, 11), return_inverse=True)
    argument = np.pi * different[:, None] * frequency
    return [(-1j) ** p * (different[:, None] * spherical_jn(p, argument))[which] * phase for p in range(orders)]


def fold(matrix: Reals) -> Reals:
    """The four parities of a matrix on the half grids right of and above the axis, [2, 2, rows / 2, columns / 2].

    A row or column on the axis is its own mirror image, and is halved.
    """
    rows, columns = matrix.shape
    up, right = rows // 2, columns // 2
    across = np.empty((2, rows, columns - right), dtype=matrix.dtype)
    np.add(matrix[:, right:], matrix[:, : columns - right][:, ::-1], out=across[0])
    np.subtract(matrix[:, right:], matrix[:, : columns - right][:, ::-1], out=across[1])
    parts = np.empty((2, 2, rows - up, columns - right), dtype=matrix.dtype)
    np.add(across[:, up:], across[:, : rows - up][:, ::-1], out=parts[0])
    np.subtract(across[:, up:], across[:, : rows - up][:, ::-1], out=parts[1])
    if columns % 2:
        parts[:, :, :, 0] /= 2
    if rows % 2:
        parts[:, :, 0] /= 2
    return parts
