"""Whether the outline of a polygon of very many vertices stays apart from itself, by a sweep over slabs.

A line that sweeps over an outline without crossings meets its sides in one order: sides begin and end, but never change
places. Lines between vertices part the outline into slabs. Sides that run through a whole slab must keep their order
from one line to the other; then they part the slab into convex gaps, and any other piece of a side must begin and end
in the same gap. What lies in one gap is little, and is compared pair by pair, in whole numbers.

KLayout's own check takes time in proportion to the vertices times the sides that one line meets: 12 s for a star of 1e5
vertices.
"""

from __future__ import annotations

import numpy as np

from maskfab.base.arrays import Floats, Indices, Ints, Mask

# Ends of sides in a slab; pieces of sides that run through slabs for every side, for fewer of which slabs are higher;
# and pairs for every side in a slab, for more of which its sides are swept over crosswise.
_FEWEST_ENDS, _MOST_ENDS, _PIECES_PER_SIDE, _PAIRS_PER_SIDE = 16, 400, 40, 128
_ROUNDINGS = 16 * float(np.finfo(np.float64).eps)


def meets_itself(corners: Ints) -> Ints | None:
    """Where an outline crosses, touches or covers itself.

    Args:
        corners: int64 [n, 2], in nanometres, within a metre of the origin.

    Returns:
        int64 [2], a corner near such a place, or near one where rounding hides whether sides meet; None if they surely
        have no point in common but the corners between them.
    """
    corners = corners[(corners != np.roll(corners, 1, axis=0)).any(axis=1)]
    try:
        _Sides(corners, np.roll(corners, -1, axis=0), np.arange(len(corners)), len(corners)).sweep()
    except _MeetError as meeting:
        return np.asarray(corners[meeting.side])
    return None


class _MeetError(Exception):
    """Sides meet, or are too close for rounding to tell."""

    def __init__(self, side: int) -> None:
        super().__init__(side)
        self.side = side


class _Sides:
    """Some sides of an outline of so many, their numbers, and slabs between horizontal lines that no vertex lies on."""

    def __init__(self, start: Ints, end: Ints, number: Indices, count: int) -> None:
        self.start, self.end, self.number, self.count = start, end, number, count
        rises = (self.end[:, 1] >= self.start[:, 1])[:, None]
        low, high = np.where(rises, self.start, self.end), np.where(rises, self.end, self.start)
        self.ends = np.stack([low, high]).astype(np.float64)
        self.slope = (high[:, 0] - low[:, 0]) / np.maximum(high[:, 1] - low[:, 1], 1)
        self.margin = _ROUNDINGS * float(abs(self.ends).max(initial=0.0))
        heights, ends = np.sort(start[:, 1]), max(_FEWEST_ENDS, min(_MOST_ENDS, number.size // 1000))
        while True:
            self.lines = np.unique(heights[ends::ends]) - 0.5
            self.first, self.last = (np.searchsorted(self.lines, side[:, 1]) for side in (low, high))
            if (self.last - self.first).sum() <= _PIECES_PER_SIDE * number.size:
                break
            ends *= 2
        self.gap = np.zeros(number.size, dtype=np.intp)

    def sweep(self) -> None:
        """Look through all slabs."""
        far = np.flatnonzero(self.first < self.last)
        slab = np.concatenate([self.first, self.last[far]])
        order = np.argsort(slab, kind="stable")
        sides = np.concatenate([np.arange(self.first.size), far])[order]
        across = np.zeros(0, dtype=np.intp)
        for number, some in enumerate(np.split(sides, np.searchsorted(slab[order], np.arange(1, self.lines.size + 1)))):
            across = self._look_through(number, across, some)

    def _look_through(self, number: int, across: Indices, some: Indices) -> Indices:
        """Sides that cross the line above a slab, from those that cross the line below and those that end in it."""
        goes_on = self.last[across] > number
        through = across[goes_on]
        is_vertex = np.stack([self.first[some] == number, self.last[some] == number])
        gaps, places = np.empty(is_vertex.shape, dtype=np.intp), self.ends[:, some]
        above = through
        for k, line in enumerate((number - 1, number)):
            beyond = some[~is_vertex[k]]
            if beyond.size:
                height = self.lines[line]
                places[k, ~is_vertex[k], 0], places[k, ~is_vertex[k], 1] = self._at(beyond, height), height
            if k == 0:
                self.gap[across] = np.cumsum(goes_on)
            elif number < self.lines.size:
                above = np.concatenate([through, beyond])
                where = self._at(above, self.lines[line])
                self._ascend(through, where[: through.size])
                order = np.argsort(where, kind="stable")
                above = above[order]
                self._ascend(above, where[order])
                self.gap[above] = np.cumsum(order < through.size)
            gaps[k, ~is_vertex[k]] = self.gap[beyond]
            gaps[k, is_vertex[k]] = self._gaps(through, self.ends[k, some[is_vertex[k]]])
        self._require(gaps[0] == gaps[1], some)
        self._compare(some, gaps[0], places)
        return above

    def _at(self, sides: Indices, height: Floats | float) -> Floats:
        x, y = self.ends[0].T
        return np.asarray(x[sides] + (height - y[sides]) * self.slope[sides])

    def _require(self, held: Mask, sides: Indices) -> None:
        if not held.all():
            raise _MeetError(int(self.number[sides[np.argmin(held)]]))

    def _ascend(self, sides: Indices, places: Floats) -> None:
        self._require(np.diff(places) > self.margin, sides)

    def _gaps(self, through: Indices, points: Floats) -> Indices:
        """Number of the sides through a slab, in order, that lie before each point [n, 2] of it."""
        before, after = np.zeros(len(points), dtype=np.intp), np.full(len(points), through.size)
        for _ in range(through.size.bit_length()):
            middle = (before + after) // 2
            held = self._at(through[np.minimum(middle, through.size - 1)], points[:, 1]) < points[:, 0]
            held &= before < after
            before, after = np.where(held, middle + 1, before), np.where(held, after, middle)
        for shift in (-1, 0) if through.size else ():
            side = through[np.clip(before + shift, 0, through.size - 1)]
            self._require(abs(self._at(side, points[:, 1]) - points[:, 0]) > self.margin, side)
        return before

    def _compare(self, sides: Indices, gaps: Indices, places: Floats) -> None:
        """Compare pieces of sides between places [2, n, 2] in the same gap, where they overlap."""
        low, high = places.min(axis=0) - places.min(initial=0.0), places.max(axis=0) - places.min(initial=0.0) + 1
        # From each gap on as far as the next one begins; a nanometre is more than is rounded.
        low, high = (ends.T + gaps * (2.0 * high.max(initial=0.0)) for ends in (low, high))
        order, after = np.argsort(low), np.arange(1, sides.size + 1)
        counts = [np.searchsorted(low[k, order[k]], high[k, order[k]], side="right") - after for k in (0, 1)]
        k = int(counts[1].sum() < counts[0].sum())
        count, order = counts[k], order[k]
        if count.sum() > _PAIRS_PER_SIDE * sides.size and 2 * sides.size < self.number.size:
            _Sides(self.start[sides, ::-1], self.end[sides, ::-1], self.number[sides], self.count).sweep()
            return
        one = np.repeat(after - 1, count)
        other = one + 1 + np.arange(one.size) - np.repeat(np.cumsum(count) - count, count)
        one, other = order[one], order[other]
        overlap = (low[1 - k, one] <= high[1 - k, other]) & (low[1 - k, other] <= high[1 - k, one])
        one, other = sides[one[overlap]], sides[other[overlap]]
        self._require(self._apart(one, other), one)

    def _apart(self, one: Indices, other: Indices) -> Mask:
        """Whether pairs of sides have no point in common, but for a corner between them."""
        p, q, r, s = self.start[one], self.end[one], self.start[other], self.end[other]
        low = np.maximum(np.minimum(p, q), np.minimum(r, s))
        apart = (low > np.minimum(np.maximum(p, q), np.maximum(r, s))).any(axis=1)
        for a, b, c, d in ((p, q, r, s), (r, s, p, q)):
            apart |= _turn(a, b, c) * _turn(a, b, d) > 0
        for before, after, (a, b, c) in ((one, other, (p, q, s)), (other, one, (r, s, q))):
            joined = (self.number[before] + 1) % self.count == self.number[after]
            apart |= joined & ((_turn(a, b, c) != 0) | (((b - a) * (c - b)).sum(axis=1) > 0))
        return np.asarray(apart)


def _turn(a: Ints, b: Ints, c: Ints) -> Ints:
    """Which way a path over points [n, 2] turns: 1 left, -1 right, 0 not."""
    ab, ac = b - a, c - a
    return np.asarray(np.sign(ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]))
