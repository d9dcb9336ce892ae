"""Shapes of a least width, as sets of squares: one bit for every place in which a square fits.

A connected shape of width w is a union of w x w squares of which each can be shifted to the next by one cell along x
or y without leaving the shape. Such a set is one whole number, so that growing, cutting and counting are single
operations on it, whatever the number of squares.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache

import numpy as np
from numpy.typing import NDArray


def _spread(bits: int, step: int, times: int) -> int:
    """The union of the bits shifted 0 to ``times`` steps up."""
    for shift in _shifts(step, times):
        bits |= bits << shift
    return bits


@cache
def _shifts(step: int, times: int) -> tuple[int, ...]:
    """As few shifts as there can be: each is as wide as what is filled so far."""
    shifts, have = [], 1
    while have <= times:
        more = min(have, times + 1 - have)
        shifts.append(step * more)
        have += more
    return tuple(shifts)


def _pack(cells: NDArray[np.bool_], stride: int) -> int:
    rows = np.zeros((cells.shape[0], stride), dtype=np.bool_)
    rows[:, : cells.shape[1]] = cells
    return int.from_bytes(np.packbits(rows, bitorder="little").tobytes(), "little")


@dataclass(frozen=True)
class Squares:
    """The places of w x w squares in a region of n x n cells; bit y * stride + x is the square whose lowest left cell
    is (y, x).

    Attributes:
        cells: n.
        width: w, side of a square in cells.
        gap: least gap between squares of different shapes, in cells.
        stride: bits per row; more than n, so that nothing spreads from one row into the next.
        free: all places in which a square fits.
        edge: the squares that forbid places to other shapes beyond those around them: through a neighbouring pixel.
        foes: what each of them forbids so, by the number of its bit.
    """

    cells: int
    width: int
    gap: int
    stride: int
    free: int
    edge: int = 0
    foes: Mapping[int, int] = field(default_factory=dict)
    _beyond: dict[int, int] = field(default_factory=dict, init=False, repr=False, compare=False)
    """Squares that sets of squares of the edge forbid together, where it was asked: a search asks again and again."""

    @classmethod
    def of(cls, region: NDArray[np.bool_], width: int, gap: int) -> Squares:
        """All squares of a bool [n, n] region."""
        n = region.shape[0]
        stride = n + gap + 1
        empty = cls(n, width, gap, stride, 0)
        return cls(n, width, gap, stride, empty.within(_pack(region, stride)))

    def within(self, cells: int) -> int:
        """The squares all of whose cells are among these."""
        missing = ~cells & ((1 << self.stride * self.cells) - 1)
        reach = self.width - 1
        hit = _spread(_spread(missing, 1, reach), self.stride, reach) >> reach * (self.stride + 1)
        return self.window(0, self.cells, 0, self.cells) & ~hit

    def window(self, y0: int, y1: int, x0: int, x1: int) -> int:
        """The places of squares that lie between these cells, upper ends excluded, free or not."""
        high, wide = y1 - y0 - self.width + 1, x1 - x0 - self.width + 1
        if high <= 0 or wide <= 0:
            return 0
        return self.box(y0, y0 + high, x0, x0 + wide)

    def box(self, y0: int, y1: int, x0: int, x1: int) -> int:
        """The places in these rows and columns, upper ends excluded, of which there is at least one each."""
        return _spread(((1 << x1 - x0) - 1) << y0 * self.stride + x0, self.stride, y1 - y0 - 1)

    def places(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Lowest row and leftmost column of every free square."""
        ys, xs = np.divmod(np.flatnonzero(self._unpacked(self.free)), self.stride)
        return ys, xs

    def _unpacked(self, bits: int) -> NDArray[np.uint8]:
        count = self.stride * self.cells
        raw = np.frombuffer((bits & (1 << count) - 1).to_bytes((count + 7) // 8, "little"), dtype=np.uint8)
        return np.unpackbits(raw, bitorder="little", count=count)

    def cover(self, squares: int) -> int:
        """The cells of these squares."""
        return _spread(_spread(squares, 1, self.width - 1), self.stride, self.width - 1)

    def area(self, squares: int) -> int:
        """Number of cells that these squares cover."""
        return self.cover(squares).bit_count()

    def beside(self, squares: int) -> int:
        """The places one step along x or y from these squares, and these themselves; free or not."""
        return squares | squares << 1 | squares >> 1 | squares << self.stride | squares >> self.stride

    def reach(self, seeds: int, within: int, goal: int = 0) -> int:
        """All squares that can be reached from the seeds by steps of one cell along x or y; some, once a goal is."""
        found = seeds & within
        stride = self.stride
        while True:
            # A carry runs through a row of set bits: all squares to the right in one addition.
            more = found | (((within + found) ^ within) & within)
            more |= more >> 1 & within
            more |= (more << stride | more >> stride) & within
            if more == found or (goal and not goal & ~more):
                return more
            found = more

    def without(self, squares: int, lost: int) -> int:
        """The largest connected set that is left of a connected one without some of its squares."""
        left = squares & ~lost
        # Whatever a path through the lost ones led to can be reached round them if their neighbours are joined.
        around = self.beside(squares & lost) & left
        joined = around and not around & ~self.reach(around & -around, left, around)
        return left if joined else self.largest(left)

    def largest(self, within: int) -> int:
        """The connected set of squares with the most cells; the lowest and leftmost of equals."""
        best, most = 0, 0
        while within:
            part = self.reach(within & -within, within)
            within ^= part
            area = self.area(part)
            if area > most:
                best, most = part, area
            if within and self.area(within) <= most:
                break
        return best

    def around(self, squares: int, distance: int) -> int:
        """The places at most this far from these squares along both axes, free or not."""
        wide = _spread(_spread(squares, 1, 2 * distance), self.stride, 2 * distance)
        return wide >> distance * (self.stride + 1)

    def near(self, squares: int) -> int:
        """The places of squares that would overlap these or come nearer to them than the gap."""
        near = self.around(squares, self.width + self.gap - 1)
        edge = squares & self.edge
        return near | self._through_border(edge) if edge else near

    def _through_border(self, edge: int) -> int:
        forbidden = self._beyond.get(edge)
        if forbidden is None:
            forbidden, left = 0, edge
            while left:
                bit = left & -left
                forbidden |= self.foes[bit.bit_length() - 1]
                left ^= bit
            self._beyond[edge] = forbidden
        return forbidden

    def picture(self, squares: int) -> NDArray[np.bool_]:
        """bool [n, n] the cells that these squares cover."""
        rows = self._unpacked(self.cover(squares)).reshape(self.cells, self.stride)
        return rows[:, : self.cells].astype(np.bool_)

    def among(self, cells: NDArray[np.bool_]) -> int:
        """The squares that lie within bool [n, n] cells."""
        return self.within(_pack(cells, self.stride))
