r"""The far field of a pupil by a matrix transform, exact for every interval.

The field at spatial frequency (u, v) is the Fourier integral of the amplitude,

    F(u, v) = ∫∫ a(x, y) exp(-2πi (ux + vy)) dx dy                        (Goodman, Fourier Optics, 4.2.5),

and an interval of width w centred at c with Legendre profile P_p contributes, exactly,

    ∫ P_p(2(x - c)/w) exp(-2πiux) dx = w (-i)^p j_p(πuw) exp(-2πiuc)       (DLMF 10.54.2 with 18.17.19),

whose p = 0 case is the familiar w sinc(uw). On a grid that is symmetric about the axis the real amplitude splits into
parts even and odd in x and in y, and four real products of a quarter of the size replace one complex one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.special import spherical_jn

from maskfab.errors import InternalError
from maskfab.model import Scalar
from maskfab.optics.pupil import RIM_ORDERS, Pupil

Floats = NDArray[np.float64]

# A rim holds a few per cent of the field, so terms below this do not reach 1e-9 of it.
_RIM_TOLERANCE = 1e-8


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
        same = (self.even_even - self.odd_odd) ** 2 + (self.odd_even + self.even_odd) ** 2
        opposite = (self.even_even + self.odd_odd) ** 2 + (self.odd_even - self.even_odd) ** 2
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
        last = 0 if self.on_axis else None
        upper = np.concatenate([left_up[:, :last:-1], right_up], axis=1)
        lower = np.concatenate([left_down[:last:-1, :last:-1], right_down[:last:-1]], axis=1)
        return np.concatenate([lower, upper], axis=0)


def parity_field(pupil: Pupil, u: Floats, v: Floats) -> ParityField:
    """The field of a pupil whose lattices are symmetric about the axis.

    Args:
        pupil: openings inside the stop.
        u, v: non-negative frequencies in cycles per micrometre, [nu] and [nv]; both begin at 0 or neither does.

    Raises:
        InternalError: MF901 if a lattice is not symmetric.
    """
    x, y = pupil.x.edges_um(), pupil.y.edges_um()
    for edges in (x, y):
        if not np.allclose(edges, -edges[::-1], rtol=0, atol=1e-9 * abs(edges).max()):
            raise InternalError("MF901", "the parity split needs a lattice that is symmetric about the axis")
    orders = _rim_orders(pupil, u, v)
    kernels_x = _half_kernels(x, u, orders)
    kernels_y = kernels_x if pupil.x == pupil.y and u is v else _half_kernels(y, v, orders)

    def part(odd_y: int, odd_x: int) -> Floats:
        return _part(pupil, kernels_y[odd_y], kernels_x[odd_x], odd_y, odd_x)

    return ParityField(part(0, 0), part(0, 1), part(1, 0), part(1, 1), on_axis=bool(u[0] == 0))


def direct_field(pupil: Pupil, u: Floats, v: Floats) -> NDArray[np.complex128]:
    """The field at any frequencies on any lattice by complex products, [nv, nu]: slower, and a check of the split."""
    orders = _rim_orders(pupil, u, v)
    x_kernels = _complex_kernels(pupil.x.edges_um(), u, orders)
    y_kernels = _complex_kernels(pupil.y.edges_um(), v, orders)
    total: NDArray[np.complex128] = y_kernels[0].T @ pupil.whole.astype(np.complex128) @ x_kernels[0]
    for q in range(orders):
        for p in range(orders):
            scale = (2 * q + 1) * (2 * p + 1)
            rim = sparse.coo_array(
                (scale * pupil.rim_moments[:, q, p], (pupil.rim_row, pupil.rim_column)), pupil.whole.shape
            )
            total += (rim.tocsr().T @ y_kernels[q]).T @ x_kernels[p]
    return total


def _rim_orders(pupil: Pupil, u: Floats, v: Floats) -> int:
    """How many Legendre orders the rim needs at the highest frequency; at least one."""
    if not pupil.rim_row.size:
        return 1
    x, y = pupil.x.edges_um(), pupil.y.edges_um()
    phase = np.pi * max(
        abs(u).max() * np.diff(x)[pupil.rim_column].max(), abs(v).max() * np.diff(y)[pupil.rim_row].max()
    )
    orders = np.arange(RIM_ORDERS)
    needed = np.flatnonzero((2 * orders + 1) * abs(spherical_jn(orders, phase)) >= _RIM_TOLERANCE)
    return int(needed[-1]) + 1


def _complex_kernels(edges: Floats, frequency: Floats, orders: int) -> list[NDArray[np.complex128]]:
    width, centre = np.diff(edges)[:, None], ((edges[1:] + edges[:-1]) / 2)[:, None]
    phase = np.exp(-2j * np.pi * centre * frequency)
    return [(-1j) ** p * _interval_size(width[:, 0], frequency, p) * phase for p in range(orders)]


def _interval_size(width: Floats, frequency: Floats, order: int) -> Floats:
    """w j_p(πuw), [intervals, m]; a lattice has few different widths, so each is worked out once."""
    different, which = np.unique(np.round(width, 11), return_inverse=True)
    size: Floats = different[:, None] * spherical_jn(order, np.pi * different[:, None] * frequency)
    return size[which]


def _half_kernels(edges: Floats, frequency: Floats, orders: int) -> tuple[list[Floats], list[Floats]]:
    """Cosine and sine transforms of P_0, P_1, ... on the intervals right of the axis, [n/2, m] each.

    An interval that straddles the axis is among them; its kernels of the wrong parity vanish by themselves.
    """
    half = (edges.size - 1) // 2
    right = edges[half:]
    width, centre = np.diff(right)[:, None], ((right[1:] + right[:-1]) / 2)[:, None]
    phase = 2 * np.pi * centre * frequency
    cosine, sine = np.cos(phase), np.sin(phase)
    even, odd = [], []
    for p in range(orders):
        size = _interval_size(width[:, 0], frequency, p)
        # cos(phase + pπ/2) and sin(phase + pπ/2)
        turned_cosine, turned_sine = ((cosine, sine), (-sine, cosine), (-cosine, -sine), (sine, -cosine))[p % 4]
        even.append(size * turned_cosine)
        odd.append(size * turned_sine)
    return even, odd


def _fold(matrix: Floats, odd_y: int, odd_x: int) -> Floats:
    """The part of a matrix with the given parities, on the half grid right of and above the axis."""
    return _fold_columns(_fold_columns(matrix, odd_x).T, odd_y).T


def _fold_columns(matrix: Floats, odd: int) -> Floats:
    count = matrix.shape[1]
    half = count // 2
    right, left = matrix[:, half:], matrix[:, : count - half][:, ::-1]
    folded = right - left if odd else right + left
    if count % 2:
        folded[:, 0] *= 0.5
    return folded


def _part(pupil: Pupil, along_y: list[Floats], along_x: list[Floats], odd_y: int, odd_x: int) -> Floats:
    """One parity of the field on the quadrant, [nv, nu]."""
    columns = along_y[0].T @ _fold(pupil.whole, odd_y, odd_x)
    if not pupil.rim_row.size:
        return columns @ along_x[0]
    rims = _folded_rim(pupil, len(along_y), odd_y, odd_x)
    stacked = np.concatenate(along_y, axis=0)
    columns = columns + (rims[0].T @ stacked).T
    total: Floats = columns @ along_x[0]
    for p in range(1, len(along_x)):
        total += (rims[p].T @ stacked).T @ along_x[p]
    return total


def _folded_rim(pupil: Pupil, orders: int, odd_y: int, odd_x: int) -> list[sparse.csr_array]:
    """For each order p in x: the rim's moments on the half grid, orders in y stacked, [orders * ny/2, nx/2]."""
    rows, columns = pupil.whole.shape
    row, mirrored_y = _folded_index(pupil.rim_row, rows)
    column, mirrored_x = _folded_index(pupil.rim_column, columns)
    half_rows, half_columns = rows - rows // 2, columns - columns // 2
    matrices = []
    for p in range(orders):
        # Mirroring an interval multiplies P_p by (-1)^p; the odd part of the grid changes sign once more.
        sign_x = np.where(mirrored_x, (-1.0) ** (p + odd_x), 1.0)
        values, indices = [], []
        for q in range(orders):
            sign_y = np.where(mirrored_y, (-1.0) ** (q + odd_y), 1.0)
            values.append((2 * q + 1) * (2 * p + 1) * pupil.rim_moments[:, q, p] * sign_x * sign_y)
            indices.append(row + q * half_rows)
        shape = (orders * half_rows, half_columns)
        tiled = np.tile(column, orders)
        matrices.append(sparse.coo_array((np.concatenate(values), (np.concatenate(indices), tiled)), shape).tocsr())
    return matrices


def _folded_index(index: NDArray[np.intp], count: int) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Place on the half grid, and whether it was mirrored to get there."""
    half = count // 2
    mirrored = index < half
    return np.where(mirrored, count - 1 - index, index) - half, mirrored
