"""Free area for emitters in a pixel, shapes in it as sets of squares, and gaps to the emitters of neighbouring pixels.

An emitter may lie where the pixel is closed, and far enough from its opening and from its neighbours'.

A connected shape of width w is a union of w x w squares of which each can be shifted to the next by one cell along x
or y without leaving the shape. Such a set is one whole number, one bit for every place in which a square fits, so that
growing, cutting and counting are single operations on it, whatever the number of squares.

Squares can keep the colours' gap across the pixel's borders too, from neighbours in every orientation, exactly. A
margin along the borders is enough but not needed: one colour may have the border to itself. All rules are between two
squares, so it is enough to know which places each square near a border forbids to the other colours.

A placement is checked for every pair of orientations that meet in a panel. Clearance is pairwise, so pairs that share a
side and pairs that share a corner are all there is to look at. A pair one above the other is a pair side by side after
a quarter turn, and a corner pair of one diagonal one of the other, so two kinds of neighbours are enough: to the right,
and up to the right.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import permutations

import numpy as np
import scipy
from numpy.typing import NDArray

from maskfab.base.arrays import Indices, Ints, Labels, Mask
from maskfab.base.model import ORIENTATIONS, orient, refined
from maskfab.display.emitter_rules import EmitterGrid

EVERY = tuple(range(ORIENTATIONS))


def free_region(mask: Mask, grid: EmitterGrid, orientations: Iterable[int] = EVERY, *, margin: int = 0) -> Mask:
    """The cells in which an emitter may lie, whichever of the orientations the pixel and its neighbours have.

    A neighbour's opening counts where the gap is wider than the gutter. As emitters turn with their opening, what
    matters is the neighbour's orientation relative to this pixel's, and the union over all that can occur is exact
    for panels in which any two orientations meet.

    Args:
        mask: bool [..., dots, dots] openings, True is clear; leading axes are a batch.
        margin: cells kept free along each side, for rules between emitters of neighbouring pixels.

    Returns:
        bool [..., n, n] on the grid's cells.
    """
    clear = refined(np.asarray(mask, dtype=np.bool_), grid.per_dot)
    n = grid.cells
    over = max(0, grid.to_opening - grid.gutter)
    if over == 0:
        taken = _grown(clear, grid.to_opening)
    else:
        taken = _grown(_with_neighbours(clear, over, grid.gutter, relative_orientations(orientations)), grid.to_opening)
        rim = over + grid.gutter
        taken = taken[..., rim : rim + n, rim : rim + n]
    free = ~taken
    if margin > 0:
        inner = np.zeros((n, n), dtype=np.bool_)
        inner[margin : n - margin, margin : n - margin] = True
        free &= inner
    return free


def relative_orientations(orientations: Iterable[int]) -> tuple[int, ...]:
    """Orientations of neighbours relative to a pixel's own, for all pairs of the orientations."""
    return _relative(tuple(sorted(set(orientations))))


@cache
def _relative(used: tuple[int, ...]) -> tuple[int, ...]:
    marks = np.arange(9).reshape(3, 3)
    return tuple(
        k
        for k in EVERY
        if any(np.array_equal(orient(orient(marks, k), own), orient(marks, other)) for own in used for other in used)
    )


def _with_neighbours(clear: Mask, depth: int, gutter: int, orientations: tuple[int, ...]) -> Mask:
    """The pixel with a rim: an empty gutter, then the outermost cells of all its eight neighbours."""
    n = clear.shape[-1]
    around = np.zeros_like(clear)
    batch = clear.reshape(-1, n, n)
    for k in orientations:
        turned = np.stack([orient(one, k) for one in batch])
        around |= turned.reshape(clear.shape)
    depth = min(depth, n)
    rim = depth + gutter
    whole = np.zeros((*clear.shape[:-2], n + 2 * rim, n + 2 * rim), dtype=np.bool_)
    below, own = (slice(0, depth), slice(n - depth, n)), (slice(rim, rim + n), slice(0, n))
    places: tuple[tuple[slice, slice], ...] = (below, own, (slice(rim + n + gutter, None), slice(0, depth)))
    for to_y, from_y in places:
        for to_x, from_x in places:
            whole[..., to_y, to_x] = around[..., from_y, from_x]
    whole[..., rim : rim + n, rim : rim + n] = clear
    return whole


def _grown(clear: Mask, gap: int) -> Mask:
    """Cells within ``gap`` cells of a clear one along both axes."""
    grown = clear.copy()
    for axis in (-2, -1):
        source = np.moveaxis(grown.copy(), axis, 0)
        target = np.moveaxis(grown, axis, 0)
        for step in range(1, min(gap, len(source) - 1) + 1):
            target[step:] |= source[:-step]
            target[:-step] |= source[step:]
    return grown


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


@cache
def both_ways(stride: int, times: int) -> tuple[int, ...]:
    """Shifts along a row and up that fill a square."""
    return _shifts(1, times) + _shifts(stride, times)


def _pack(cells: Mask, stride: int) -> int:
    rows = np.zeros((cells.shape[0], stride), dtype=np.bool_)
    rows[:, : cells.shape[1]] = cells
    return int.from_bytes(np.packbits(rows, bitorder="little").tobytes(), "little")


@dataclass(frozen=True)
class Squares:
    """The places of w x w squares in a region of n x n cells; bit y * stride + x is the square whose lowest left cell
    is (y, x).

    Attributes:
        width: w, side of a square in cells.
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
    def of(cls, region: Mask, width: int, gap: int) -> Squares:
        """Squares of a bool [n, n] region."""
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

    def places(self) -> tuple[Indices, Indices]:
        """Lowest row and leftmost column of every free square."""
        ys, xs = np.divmod(np.flatnonzero(self._unpacked(self.free)), self.stride)
        return ys, xs

    def _unpacked(self, bits: int) -> NDArray[np.uint8]:
        count = self.stride * self.cells
        raw = np.frombuffer((bits & (1 << count) - 1).to_bytes((count + 7) // 8, "little"), dtype=np.uint8)
        return np.unpackbits(raw, bitorder="little", count=count)

    def cover(self, squares: int) -> int:
        """The cells of these squares."""
        for shift in both_ways(self.stride, self.width - 1):
            squares |= squares << shift
        return squares

    def area(self, squares: int) -> int:
        """Number of cells that these squares cover."""
        return self.cover(squares).bit_count()

    def beside(self, squares: int) -> int:
        """The places one step along x or y from these squares, and these themselves; free or not."""
        return squares | squares << 1 | squares >> 1 | squares << self.stride | squares >> self.stride

    def reach(self, seeds: int, within: int, goal: int = 0) -> int:
        """Squares that can be reached from the seeds by steps of one cell along x or y; some, once a goal is."""
        reached = seeds & within
        stride = self.stride
        while True:
            # A carry runs through a row of set bits: all squares to the right in one addition.
            more = reached | (((within + reached) ^ within) & within)
            more |= more >> 1 & within
            more |= (more << stride | more >> stride) & within
            if more == reached or (goal and not goal & ~more):
                return more
            reached = more

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
        for shift in both_ways(self.stride, 2 * distance):
            squares |= squares << shift
        return squares >> distance * (self.stride + 1)

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

    def picture(self, squares: int) -> Mask:
        """bool [n, n] the cells that these squares cover."""
        rows = self._unpacked(self.cover(squares)).reshape(self.cells, self.stride)
        return rows[:, : self.cells].astype(np.bool_)

    def among(self, cells: Mask) -> int:
        """The squares that lie within bool [n, n] cells."""
        return self.within(_pack(cells, self.stride))


_MOST_PAIRS = 2_000_000
"""Pairs of squares looked at for a third; some seconds."""


def border_margin(grid: EmitterGrid) -> int:
    """Cells along each side that hold no emitter, so that emitters of any two neighbours keep the colours' gap."""
    return max(0, -(-(grid.colour_gap - grid.gutter) // 2))


def facing_squares(region: Mask, grid: EmitterGrid, orientations: Iterable[int] = EVERY) -> Squares:
    """The squares of a region, bool [n, n] without a margin, each with what it forbids near neighbours' borders."""
    squares = Squares.of(region, grid.min_width, grid.colour_gap)
    reach, pitch = grid.min_width + grid.colour_gap - 1, grid.cells + grid.gutter
    n = grid.cells - grid.min_width + 1
    if border_margin(grid) == 0:
        return squares
    ys, xs = squares.places()
    numbers = np.arange(n * n).reshape(n, n)
    foes: dict[int, int] = {}
    for k in relative_orientations(orientations):
        # Where the square at each place comes to lie when its pixel is turned.
        to = np.empty(n * n, dtype=np.intp)
        to[orient(numbers, k).ravel()] = np.arange(n * n)
        turned_y, turned_x = np.divmod(to[ys * n + xs], n)
        for up in (-pitch, 0, pitch):
            for right in (-pitch, 0, pitch):
                if up == right == 0:
                    continue
                y0, y1 = (np.clip(turned_y + up + end, 0, n) for end in (-reach, reach + 1))
                x0, x1 = (np.clip(turned_x + right + end, 0, n) for end in (-reach, reach + 1))
                for i in np.flatnonzero((y1 > y0) & (x1 > x0)):
                    box = squares.box(int(y0[i]), int(y1[i]), int(x0[i]), int(x1[i]))
                    bit = int(ys[i]) * squares.stride + int(xs[i])
                    foes[bit] = foes.get(bit, 0) | box
    return replace(squares, edge=sum(1 << bit for bit in foes), foes=foes)


def three_facing_squares(squares: Squares) -> tuple[int, int, int] | None:
    """Three squares that may be of different colours; zeros if there are none, None if there are too many to tell.

    Emitters that keep the rules hold three squares that do, so zeros prove that no three emitters of any shape fit.
    """
    pairs = 0
    one = squares.free
    while one:
        first = one & -one
        one ^= first
        beside = one & ~squares.near(first)
        two = beside
        while two:
            second = two & -two
            two ^= second
            third = two & ~squares.near(second)
            if third:
                return first, second, third & -third
            pairs += 1
            if pairs > _MOST_PAIRS:
                return None
    return 0, 0, 0


Pair = tuple[int, int]

TURNED_BACK = tuple(k // 4 * 4 + (k + 3) % 4 for k in range(ORIENTATIONS))
"""An orientation followed by a quarter turn clockwise."""


@dataclass(frozen=True)
class Borders:
    """The gaps across borders of a panel.

    Attributes:
        side_violations, diagonal_violations: how many of them are closer than a rule.
        worst: orientations of the left (or lower left) and the right (or upper right) pixel of the pair that falls
            shortest of its rule; None if no pixels meet.
        margin_nm: kept free along the pixel's sides, it makes every pair legal without a look at any.
    """

    side_pairs: int
    diagonal_pairs: int
    side_violations: int
    diagonal_violations: int
    worst: Pair | None
    margin_nm: int

    @property
    def legal(self) -> bool:
        return self.side_violations + self.diagonal_violations == 0


def margin(grid: EmitterGrid) -> int:
    """The margin, in cells, that is enough on every side: max((colour gap - gutter) / 2, gap to openings - gutter)."""
    return max(border_margin(grid), grid.to_opening - grid.gutter)


def meetings(orientations: Labels) -> tuple[frozenset[Pair], frozenset[Pair]]:
    """The pairs of a map that share a side, and those that share a corner, each as if beside or up to the right."""
    turned = np.array(TURNED_BACK)[orientations % ORIENTATIONS]
    plain = orientations % ORIENTATIONS

    def pairs(one: NDArray[np.integer], other: NDArray[np.integer]) -> set[Pair]:
        codes = np.unique(one.astype(int) * ORIENTATIONS + other)
        return {divmod(int(code), ORIENTATIONS) for code in codes}

    beside = pairs(plain[:, :-1], plain[:, 1:]) | pairs(turned[:-1], turned[1:])
    # Up to the left, turned back by a quarter, is up to the right.
    across = pairs(plain[:-1, :-1], plain[1:, 1:]) | pairs(turned[:-1, 1:], turned[1:, :-1])
    return frozenset(beside), frozenset(across)


def borders(labels: Labels, opening: Mask, grid: EmitterGrid, orientations: Labels) -> Borders:
    """Check every pair of neighbours of a panel, of one pixel's labels, int8 [n, n] on the grid's cells."""
    beside, across = meetings(orientations)
    turned = [(orient(labels, k), orient(opening, k)) for k in range(ORIENTATIONS)]
    shortfalls: list[tuple[int, Pair]] = []
    violations = []
    for diagonal, pairs in ((False, beside), (True, across)):
        near = {a: _distances(*turned[a], grid, diagonal) for a in {a for a, _ in pairs}}
        short = [(_shortfall(near[a], *turned[b], grid), (a, b)) for a, b in sorted(pairs)]
        violations.append(sum(lacking > 0 for lacking, _ in short))
        shortfalls += short
    _, worst = max(shortfalls, key=lambda pair: pair[0], default=(0, None))
    return Borders(len(beside), len(across), violations[0], violations[1], worst, margin(grid) * grid.cell_nm)


Near = tuple[tuple[Ints, ...], Ints]


def _distances(labels: Labels, opening: Mask, grid: EmitterGrid, diagonal: bool) -> Near:
    """Gaps to every cell of the neighbour, [n, n] each, from each colour, any colour and the opening; large if far."""

    def gaps(mask: Mask) -> Ints:
        n, reach = grid.cells, max(grid.colour_gap, grid.to_opening)
        far = n + grid.gutter
        canvas = np.ones((far + n if diagonal else n, far + n), dtype=bool)
        canvas[:n, :n] = ~mask
        seen = canvas[max(0, n - reach) if diagonal else 0 :, max(0, n - reach) :]
        if seen.all():
            return np.full((n, n), 2 * far)
        distance = scipy.ndimage.distance_transform_cdt(seen, metric="chessboard")
        return np.asarray(distance[-n:, -n:], dtype=np.int64) - 1

    emitting = labels > 0
    return (*(gaps(labels == k) for k in (1, 2, 3)), gaps(emitting)), gaps(opening)


def _shortfall(near: Near, labels: Labels, opening: Mask, grid: EmitterGrid) -> int:
    """Cells by which the worst gap falls short of its rule; 0 where rules are kept."""
    colours, from_opening = near
    lacking = [0]
    for one, other in permutations(range(3), 2):
        place = labels == other + 1
        if place.any():
            lacking.append(grid.colour_gap - int(colours[one][place].min()))
    emitting = labels > 0
    if opening.any():
        lacking.append(grid.to_opening - int(colours[3][opening].min()))
    if emitting.any():
        lacking.append(grid.to_opening - int(from_opening[emitting].min()))
    return max(lacking)
