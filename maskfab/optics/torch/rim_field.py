r"""The field of dots along the rim of a stop, and its adjoint: a ring of dots, folded about both axes.

The parts of the folded pupil, P_ij, even or odd in y and x, give F_ij = K_i(y, v)ᵀ P_ij K_j(x, u). Of the ring's
quadrant the arm beyond some x goes through the product along y first, what is left of it through that along x, so
either has few dots along its other side. Both are laid in strips whose lengths follow the ring.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from maskfab.optics.pupil.aperture import Lattice
from maskfab.optics.torch.cell_field import waves

Floats = NDArray[np.float64]

_STRIP = 24  # dots across a strip: more follow the ring worse, fewer are many small products
_CALL = 60_000  # multiplications that a product's own call is worth


@dataclass(frozen=True)
class Strip:
    """A box of the folded pupil.

    Attributes:
        rows, columns: first dot and the one after the last, from the axis outwards.
        start: of its dots in the flat arrays.
    """

    rows: tuple[int, int]
    columns: tuple[int, int]
    start: int

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.rows[1] - self.rows[0], self.columns[1] - self.columns[0]

    @property
    def stop(self) -> int:
        """Where its dots end in the flat arrays."""
        return self.start + self.shape[0] * self.shape[1]


@dataclass(frozen=True, eq=False)
class Rim:
    """The constants of the dots along the rim.

    Attributes:
        index: int64 [2 x 2 x n], the unit's dot at each place of the strips, in the four quadrants: upper and lower,
            right and left.
        weight: [2, 2, n], what part of each of these dots counts; halved on a middle row or column, which two
            quadrants have in common.
        upright: strips that are multiplied along y first.
        lying: strips that are multiplied along x first.
        along_y: [2, nv, rows], even and odd waves of the folded rows.
        along_x: [2, columns, nu], the same of the columns.
    """

    index: torch.Tensor
    weight: torch.Tensor
    upright: tuple[Strip, ...]
    lying: tuple[Strip, ...]
    along_y: torch.Tensor
    along_x: torch.Tensor

    def add_field(self, unit: torch.Tensor, parts: torch.Tensor) -> None:
        """Add even and odd parts of the field of a unit [dots, dots] to ``parts``, [2, 2, nv, nu]."""
        pupil = butterfly(unit.flatten().index_select(0, self.index).view(self.weight.shape).mul_(self.weight))
        nv, nu = parts.shape[2:]
        if self.upright:
            # Both parities of x share the waves along y: fewer, larger products.
            columns = _span([s.columns for s in self.upright])
            for odd_y in range(2):
                strips = []
                for s in self.upright:
                    height, width = s.shape
                    both = pupil[odd_y, :, s.start : s.stop].view(2, height, width).transpose(0, 1)
                    product = self.along_y[odd_y, :, slice(*s.rows)] @ both.reshape(height, 2 * width)
                    strips.append(product.view(nv, 2, width))
                through = torch.cat(strips, 2)
                for odd_x in range(2):
                    parts[odd_y, odd_x].addmm_(through[:, odd_x], self.along_x[odd_x, columns])
        if self.lying:
            rows = _span([s.rows for s in self.lying])
            for odd_x in range(2):
                strips = []
                for s in self.lying:
                    height, width = s.shape
                    both = pupil[:, odd_x, s.start : s.stop].reshape(2 * height, width)
                    strips.append((both @ self.along_x[odd_x, slice(*s.columns)]).view(2, height, nu))
                through = torch.cat(strips, 1)
                for odd_y in range(2):
                    parts[odd_y, odd_x].addmm_(self.along_y[odd_y, :, rows], through[odd_y])

    def adjoint(self, slope: torch.Tensor) -> torch.Tensor:
        """Derivatives by the dots at ``index``, flat, from those by the field's parts, [2, 2, nv, nu]."""
        pupil = torch.empty_like(self.weight)
        nv, nu = slope.shape[2:]
        if self.upright:
            columns = _span([s.columns for s in self.upright])
            for odd_y in range(2):
                through = slope.new_empty(nv, 2, columns.stop - columns.start)
                for odd_x in range(2):
                    torch.mm(slope[odd_y, odd_x], self.along_x[odd_x, columns].mT, out=through[:, odd_x])
                for s in self.upright:
                    height, width = s.shape
                    at = slice(s.columns[0] - columns.start, s.columns[1] - columns.start)
                    both = through[:, :, at].reshape(nv, 2 * width)
                    product = self.along_y[odd_y, :, slice(*s.rows)].mT @ both
                    here = pupil[odd_y, :, s.start : s.stop].view(2, height, width)
                    here.copy_(product.view(height, 2, width).transpose(0, 1))
        if self.lying:
            rows = _span([s.rows for s in self.lying])
            for odd_x in range(2):
                through = slope.new_empty(2, rows.stop - rows.start, nu)
                for odd_y in range(2):
                    torch.mm(self.along_y[odd_y, :, rows].mT, slope[odd_y, odd_x], out=through[odd_y])
                for s in self.lying:
                    height, _ = s.shape
                    at = slice(s.rows[0] - rows.start, s.rows[1] - rows.start)
                    both = through[:, at].reshape(2 * height, nu)
                    product = both @ self.along_x[odd_x, slice(*s.columns)].mT
                    pupil[:, odd_x, s.start : s.stop] = product.view(2, -1)
        return butterfly(pupil).mul_(self.weight).flatten()


def butterfly(quadrants: torch.Tensor) -> torch.Tensor:
    """Sums and differences along the two leading axes, [2, 2, ...]: quadrants to parities, or back in the adjoint."""
    vertical, both = torch.empty_like(quadrants), torch.empty_like(quadrants)
    torch.add(quadrants[0], quadrants[1], out=vertical[0])
    torch.sub(quadrants[0], quadrants[1], out=vertical[1])
    torch.add(vertical[:, 0], vertical[:, 1], out=both[:, 0])
    torch.sub(vertical[:, 0], vertical[:, 1], out=both[:, 1])
    return both


def rim(
    y: Lattice,
    x: Lattice,
    unit_dot: NDArray[np.intp],
    share: Floats,
    v: Floats,
    u: Floats,
    *,
    dtype: torch.dtype,
    device: torch.device,
) -> Rim | None:
    """The dots that count at all, laid in strips; None if none does.

    Args:
        y, x: the cells' lattices, about the axis.
        unit_dot: flat index into the unit of every dot, [dots y, dots x].
        share: what part of each counts, [dots y, dots x]; negative for what whole cells have too much.
        v, u: frequencies in cycles per micrometre.
        dtype, device: of the constants.
    """
    rows, columns = _folds(y), _folds(x)
    places = [(row, column) for row in rows for column in columns]
    counts = np.logical_or.reduce([share[place] != 0 for place in places])
    if not counts.any():
        return None
    upright, lying = _strips(counts, v.size, u.size)
    boxes = [(slice(*s.rows), slice(*s.columns)) for s in (*upright, *lying)]
    halved = _middle_halved(y)[:, None] * _middle_halved(x)

    def packed(quadrant: NDArray[np.generic]) -> NDArray[np.generic]:
        return np.concatenate([quadrant[box].ravel() for box in boxes])

    index = np.concatenate([packed(unit_dot[place]) for place in places]).astype(np.int64)
    weight = np.stack([packed(share[place] * halved) for place in places])
    along_y, along_x = (waves(_dot_middle_um(lattice), lattice.dot_um, f) for lattice, f in ((y, v), (x, u)))
    return Rim(
        index=torch.from_numpy(index).to(device),
        weight=torch.from_numpy(weight).view(2, 2, -1).to(device=device, dtype=dtype),
        upright=upright,
        lying=lying,
        along_y=torch.from_numpy(np.ascontiguousarray(along_y.transpose(0, 2, 1))).to(device=device, dtype=dtype),
        along_x=torch.from_numpy(along_x).to(device=device, dtype=dtype),
    )


def _strips(counts: NDArray[np.bool_], nv: int, nu: int) -> tuple[tuple[Strip, ...], tuple[Strip, ...]]:
    """Upright and lying strips that hold all dots that count, [rows, columns], with the least work."""
    width = counts.shape[1]
    lowest, highest = _extents(counts.T)
    leftmost, _ = _extents(counts)
    # By the first column of the upright strips: the end of every row before it.
    ends = np.pad(np.maximum.accumulate(np.where(counts, np.arange(1, width + 1), 0), axis=1), ((0, 0), (1, 0)))

    def covers(first: int) -> tuple[list[tuple[int, int, int, int]], list[tuple[int, int, int, int]]]:
        end = ends[:, first]
        return _cover(lowest[first:], highest[first:]), _cover(np.where(end > 0, leftmost, width), end)

    def work(first: int) -> int:
        upright, lying = covers(first)
        total = _CALL * (len(upright) + len(lying))
        for strips, along, across in ((upright, nv, nu), (lying, nu, nv)):
            total += sum(along * (stop - start) * (high - low) for start, stop, low, high in strips)
            if strips:
                total += along * across * (strips[-1][1] - strips[0][0])
        return total

    # The least is flat: half a strip more or less hardly shows.
    first = min([*range(0, width, _STRIP // 2), width], key=work)
    upright, lying, start = [], [], 0
    columns, rows = covers(first)
    for low, high, begin, end in columns:
        upright.append(Strip((begin, end), (low + first, high + first), start))
        start = upright[-1].stop
    for low, high, begin, end in rows:
        lying.append(Strip((low, high), (begin, end), start))
        start = lying[-1].stop
    return tuple(upright), tuple(lying)


def _extents(lines: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """First place that counts in every line, and the one after the last; of a line that has none, its length and 0."""
    some, length = lines.any(axis=1), lines.shape[1]
    return np.where(some, lines.argmax(axis=1), length), np.where(some, length - lines[:, ::-1].argmax(axis=1), 0)


def _cover(low: NDArray[np.intp], high: NDArray[np.intp]) -> list[tuple[int, int, int, int]]:
    """Strips of lines, side by side: first line and the one after the last, then the same of the places they hold."""
    used = np.flatnonzero(low < high)
    if not used.size:
        return []
    end = int(used[-1]) + 1
    starts = np.arange(int(used[0]), end, _STRIP)
    stops = np.minimum(starts + _STRIP, end)
    low, high = np.minimum.reduceat(low[:end], starts), np.maximum.reduceat(high[:end], starts)
    # A strip may hold none.
    low, high = np.where(high > 0, low, 0), np.where(high > 0, high, 1)
    return list(zip(*(each.tolist() for each in (starts, stops, low, high)), strict=True))


def _span(ranges: list[tuple[int, int]]) -> slice:
    return slice(ranges[0][0], ranges[-1][1])


def _folds(lattice: Lattice) -> tuple[slice, slice]:
    """Dots from the axis outwards, and their mirror images."""
    count = lattice.cells * lattice.dots
    return slice(count // 2, None), slice(count - 1 - count // 2, None, -1)


def _middle_halved(lattice: Lattice) -> Floats:
    count = lattice.cells * lattice.dots
    factor = np.ones(count - count // 2)
    factor[0] = 0.5 if count % 2 else 1.0
    return factor


def _dot_middle_um(lattice: Lattice) -> Floats:
    """Middles of the dots from the axis outwards."""
    outwards, _ = _folds(lattice)
    middle: Floats = lattice.edges_um()[lattice.dot_index().ravel()[outwards]] + lattice.dot_um / 2
    return middle
