"""The exact autocorrelation of polygons behind the stop, for masks whose edges lie on no grid of dots.

    C(s) = ∫∫ a(r) a(r + s) d²r                                              (Goodman, Fourier Optics, 6.3)

is the area that the clear region shares with itself, moved by -s, inside the stop and inside the stop moved as far. The
region is cut into trapezoids with level sides. Two of them share a convex polygon, whose width is linear between at
most four heights, so that its area is a closed form. Where a circle cuts that polygon its arcs are integrated, not
replaced by chords (:mod:`maskfab.optics.rim`).

On a lattice of lags, all of them at once are had from means over small boxes whose sides divide the lattice's step. At
such lags boxes meet boxes, and what their shapes change is at most the autocorrelation of their standard deviations
(Cauchy-Schwarz): a bound for every lag, which tells where the exact value is worth its time, and all there is to tell
of polygons whose trapezoids are too many. Edges that run along x by X in all, and along y by Y, cross X/w + Y/h boxes
of width w and height h: the fewest, of so many boxes, where w : h = X : Y.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy
from klayout import db
from numpy.typing import NDArray

from maskfab.base.arrays import Floats, Indices, Mask, expanded, fast_length
from maskfab.base.model import frozen
from maskfab.base.units import NM_PER_UM
from maskfab.job.camera import Stop
from maskfab.optics.rim import area_in_both_discs
from maskfab.optics.stop_edges import cut_by_stop, cutting_box, far_and_near

Raster = Callable[[Floats, Floats, Floats], Floats]
"""Gives the clear shares, [ny, nx], of edges [n, 4] between lines along x and along y, all in µm."""

# Cuts of slanted edges are rounded to a unit: as fine as coordinates bear.
_LARGEST_COORDINATE = 900_000_000
_MOST_BINS = 1_000_000
# Boxes along the stop, were they squares, and most of these along a step of the lattice.
_SQUARES, _MOST_PARTS = 4000, 32
# Sides of boxes that edges cross in a second or two.
_MOST_CROSSED = 5_000_000
# Of the area, what transforms in single precision may lack.
_SINGLE = 2e-6
# A rim of many chords stands for the circle in rasters.
_OF_CHORDS = 1e-8
# Of more edges, or pairs of trapezoids that may meet, no lag is exact: each of them would take half a second or more.
_MOST_EDGES, _MOST_PARTS_CUT, _MOST_PAIRS = 500_000, 1_000_000, 3_000_000
_ROW = 1 << 33


@dataclass(frozen=True, eq=False)
class OutlineLags:
    """Trapezoids of a clear region, in half sides of the stop; none if they are too many for exact lags.

    Attributes:
        stop: which cuts them, if it is round; any other stop has cut them.
        edges_um, area_um2: of the region before the stop, see :func:`maskfab.optics.stop_edges.edges_in_stop`.
        raster: shares that such edges cover.
        y: float64 [2, n], lower and upper side.
        left, right: float64 [2, n], ends of the lower and of the upper side.
        box: float64 [2, n], the lesser of the left ends and the greater of the right ones.
        starts, held: trapezoids that lie in bins of the plane, and where each bin's begin, row by row.
        first: 1 where a bin is the first along x of the trapezoid held, 2 along y, and 3 of both.
        bins: number of bins along x and along y.
        pairs: number of those at which a lag looks; 0 if none is exact.
        turned: whether x and y of the trapezoids are those of the mask the other way round.
    """

    stop: Stop
    edges_um: Floats
    area_um2: float
    raster: Raster
    y: Floats
    left: Floats
    right: Floats
    box: Floats
    starts: Indices
    held: Indices
    first: NDArray[np.uint8]
    bins: tuple[int, int]
    pairs: int
    turned: bool

    @cached_property
    def whole(self) -> Mask:
        """Which trapezoids the stop does not cut."""
        far, near = _far_and_near(self.box, self.y)
        return (far < 1) & (near >= self.stop.inner_share**2) if self.stop.round else far < math.inf

    @cached_property
    def level(self) -> bool:
        """Whether all trapezoids are boxes."""
        return bool((self.left[0] == self.left[1]).all() and (self.right[0] == self.right[1]).all())

    @property
    def rounding(self) -> float:
        """Share of the clear area by which the autocorrelation may err: stops with corners are cut on a grid."""
        return 1e-11 if self.stop.round else 1e-8

    def autocorrelation_um2(self, lag_x_um: Floats, lag_y_um: Floats) -> Floats:
        """The area shared at lags [n], in square micrometres."""
        width, height = self.stop.sides_um
        lags = np.stack([lag_x_um * (2 / width), lag_y_um * (2 / height)])
        if self.turned:
            lags = lags[::-1]
        shared = np.zeros(lags.shape[1])
        if not shared.size:
            return shared
        # Lags that are nearer to each other than the sides of a bin share their pairs.
        group = (np.floor(lags / 2 * np.array(self.bins)[:, None]) * [[1], [1 << 20]]).sum(axis=0)
        order = np.argsort(group, kind="stable")
        for some in np.split(order, np.flatnonzero(np.diff(group[order])) + 1):
            low, high = lags[:, some].min(axis=1), lags[:, some].max(axis=1)
            pairs = self._pairs((low + high) / 2, (high - low) / 2)
            # What trapezoids share that no rim meets, no rim meets.
            whole = self.whole[pairs[0]] & self.whole[pairs[1]]
            held, cut = ((own[which], other[which]) for which in (whole, ~whole) for own, other in (pairs,))
            ends = [(ends[:, held[0]], ends[:, held[1]]) for ends in (self.box, self.y)] if self.level else []
            for k in some:
                lag_x, lag_y = lags[:, k].tolist()
                if self.level:
                    across, up = (
                        np.minimum(own[1] + lag, other[1]) - np.maximum(own[0] + lag, other[0])
                        for (own, other), lag in zip(ends, (lag_x, lag_y), strict=True)
                    )
                    shared[k] = np.maximum(across, 0.0) @ np.maximum(up, 0.0)
                else:
                    met = self._met(held, lag_x, lag_y)
                    shared[k] = _Strip.of(self, held[0][met], held[1][met], lag_x, lag_y).area().sum()
                met = self._met(cut, lag_x, lag_y)
                if met.size:
                    x, y = _Strip.of(self, cut[0][met], cut[1][met], lag_x, lag_y).corners()
                    shared[k] += area_in_both_discs(x, y, (lag_x, lag_y), self.stop.inner_share).sum()
        return shared * (width * height / 4)

    def on_lattice(self, step_um: float, count: int, boxes_across: int = _SQUARES) -> tuple[Floats, Floats]:
        """The autocorrelation at whole steps, and a bound of the error of each, in square micrometres.

        Args:
            boxes_across: about as many boxes as fill the stop, were they squares; the bound falls with their number.

        Returns:
            float64 [count, 2 count - 1] each, lags from 0 on along y, and from -(count - 1) steps on along x.
        """
        cells = math.ceil(self.stop.diameter_um / step_um)
        boxes = int(np.clip(boxes_across // cells, 1, _MOST_PARTS)) ** 2
        spans = abs(self.edges_um[:, 2:] - self.edges_um[:, :2])
        along_x, along_y = spans.sum(axis=0)
        # Slanted edges are cut at every box: where they are long and many boxes are fewer.
        crossed = 2 * math.sqrt(math.prod(spans[spans.all(axis=1)].sum(axis=0).tolist()) * boxes) / step_um
        boxes = max(1, int(boxes * min(1.0, _MOST_CROSSED / max(crossed, 1.0)) ** 2))
        rows = int(np.clip(math.sqrt(boxes * along_x / max(along_y, 1e-300)), 1, boxes))
        columns = boxes // rows
        x_lines, y_lines = (
            step_um / parts * (np.arange(cells * parts + 1, dtype=np.float64) - cells * parts / 2)
            for parts in (columns, rows)
        )
        shares = self.raster(self.edges_um, x_lines, y_lines).reshape(cells, rows, cells, columns)
        size = fast_length(cells + min(count, cells))
        powers = np.zeros((2, size, size // 2 + 1))
        for row, column in np.ndindex(rows, columns):
            alike = shares[:, row, :, column].astype(np.float32)
            for k, values in enumerate((alike, np.sqrt(alike * (1 - alike)))):
                waves = scipy.fft.rfft2(values, (size, size))
                powers[k] += waves.real**2 + waves.imag**2
        lags = np.arange(1 - count, count)
        reached = abs(lags) < cells
        tables = np.zeros((2, count, 2 * count - 1))
        for table, power in zip(tables, powers, strict=True):
            held = scipy.fft.irfft2(power, (size, size), overwrite_x=True)[: min(count, cells), lags[reached] % size]
            table[: len(held), reached] = held * (step_um**2 / (rows * columns))
        # At lag 0 shapes are known.
        values, errors = tables
        values[0, count - 1], errors[0, count - 1] = self.area_um2, 0.0
        return values, errors + (_OF_CHORDS + self.rounding + _SINGLE) * self.area_um2

    def _met(self, pairs: tuple[Indices, Indices], lag_x: float, lag_y: float) -> Indices:
        """Which pairs have boxes that share something, the first ones moved by a lag."""
        own, other = pairs
        met = np.ones(own.size, dtype=np.bool_)
        for ends, lag in ((self.box, lag_x), (self.y, lag_y)):
            met &= (ends[0, own] + lag < ends[1, other]) & (ends[1, own] + lag > ends[0, other])
        return np.flatnonzero(met)

    def _pairs(self, lag: Floats, slack: Floats) -> tuple[Indices, Indices]:
        """Trapezoids, and those whose boxes they may meet when moved by lags [2] or such as are so little off."""
        near, far = lag - slack, lag + slack
        left, right = self.box
        low, high = self.y
        own = np.flatnonzero((left < 1 - near[0]) & (right > -1 - far[0]) & (low < 1 - near[1]) & (high > -1 - far[1]))
        own_left, own_right = left[own] + near[0], right[own] + far[0]
        own_low, own_high = low[own] + near[1], high[own] + far[1]
        columns, rows = self.bins
        first_x, last_x = _bin(own_left, columns), _bin(own_right, columns)
        first_y, last_y = _bin(own_low, rows), _bin(own_high, rows)
        across = last_x - first_x + 1
        place, number = expanded(across * (last_y - first_y + 1))
        across, up = across[place], number // across[place]
        where = (first_y[place] + up) * columns + first_x[place] + number - up * across
        # A pair is met in the bin of its boxes' common corner alone: the first of either's along x, and along y.
        first = ((number - up * across == 0) + 2 * (up == 0)).astype(np.uint8)
        begun = self.starts[where]
        of_bin, number = expanded(self.starts[where + 1] - begun)
        number += begun[of_bin]
        met = np.flatnonzero((first[of_bin] | self.first[number]) == 3)
        return own[place[of_bin[met]]], self.held[number[met]]


def outline_lags(
    shapes: db.Region, stop: Stop, centre_nm: tuple[float, float], edges_um: Floats, area_um2: float, raster: Raster
) -> OutlineLags:
    """Merged polygons, or such as do not overlap, made ready for any lag; for those of a lattice if they are too many.

    Args:
        shapes: what is clear, in nanometres.
        centre_nm: where the optical axis meets the plate, to half a nanometre.
        edges_um, area_um2: of the same before the stop, see :func:`maskfab.optics.stop_edges.edges_in_stop`.
        raster: shares that such edges cover.
    """
    scale = 1 if stop.round else 2 * max(1, int(_LARGEST_COORDINATE / (2.2 * stop.diameter_um * NM_PER_UM)))
    no, bins, first = np.zeros((2, 0)), np.zeros(0, dtype=np.intp), np.zeros(0, dtype=np.uint8)
    unknown = OutlineLags(stop, frozen(edges_um), area_um2, raster, no, no, no, no, bins, bins, first, (1, 1), 0, False)
    if len(edges_um) > _MOST_EDGES:
        return unknown
    drawn, centre = shapes, np.array(centre_nm)
    if not stop.round:
        drawn = drawn & cutting_box(stop, centre_nm)
        drawn.transform(db.ICplxTrans(float(scale)))
        drawn.move(*np.rint(-scale * centre).astype(int).tolist())
        drawn, centre = cut_by_stop(drawn, stop, NM_PER_UM * scale), np.zeros(2)
    along_x, along_y = abs(edges_um[:, 2:] - edges_um[:, :2]).sum(axis=0)
    turned, sides_um = bool(along_y > along_x), stop.sides_um
    if turned:
        # Fewer edges are met at once, and polygons cut into fewer parts.
        drawn, centre, sides_um = drawn.transformed(db.Trans.M45), centre[::-1], sides_um[::-1]
        drawn.merged_semantics = False
    # KLayout rounds where it cuts slanted edges, and cuts those that lie along x and y in the right places.
    level = _trapezoids(drawn.rectilinear().decompose_trapezoids_to_region())
    slanted = _trapezoids(drawn.non_rectilinear())
    if level is None or slanted is None:
        return unknown
    y, left, right = np.concatenate([level, slanted], axis=2)
    across, up = (2 / (side * NM_PER_UM * scale) for side in sides_um)
    y, left, right = (y - centre[1]) * up, (left - centre[0]) * across, (right - centre[0]) * across
    return _binned(replace(unknown, turned=turned), y, left, right)


def _binned(unknown: OutlineLags, y: Floats, left: Floats, right: Floats) -> OutlineLags:
    """With trapezoids that the stop does not hide, if they are not too many."""
    box = np.stack([left.min(axis=0), right.max(axis=0)])
    far, near = _far_and_near(box, y)
    seen = (near < 1) & (far > unknown.stop.inner_share**2) if unknown.stop.round else far > 0
    sizes = [float((ends[1] - ends[0])[seen].mean()) if seen.any() else 2.0 for ends in (box, y)]
    # Bins of a mean box's sides, or larger ones in the same ratio.
    larger = max(1.0, math.sqrt(4 / math.prod(sizes) / _MOST_BINS))
    columns, rows = (int(np.clip(2 / (size * larger), 1, _MOST_BINS)) for size in sizes)
    # Neighbours in the plane are neighbours in memory.
    order = np.flatnonzero(seen)
    order = order[np.argsort(_bin(y[0, order], rows) * columns + _bin(box[0, order], columns), kind="stable")]
    y, left, right, box = (part[:, order] for part in (y, left, right, box))
    (first_x, last_x), (first_y, last_y) = (
        [_bin(end, count) for end in ends] for ends, count in ((box, columns), (y, rows))
    )
    across, up = last_x - first_x + 1, last_y - first_y + 1
    if (across * up).sum() > _MOST_PAIRS:
        return unknown
    held, number = expanded(across * up)
    row, column = number // across[held], number % across[held]
    where = (first_y[held] + row) * columns + first_x[held] + column
    order = np.argsort(where, kind="stable")
    starts = np.searchsorted(where[order], np.arange(columns * rows + 1))
    pairs = int((np.diff(starts) ** 2).sum())
    if pairs > _MOST_PAIRS:
        return unknown
    first = ((column == 0) + 2 * (row == 0)).astype(np.uint8)
    y, left, right, box = (frozen(part) for part in (y, left, right, box))
    starts, held, first = frozen(starts), frozen(held[order]), frozen(first[order])
    bins = columns, rows
    return replace(
        unknown, y=y, left=left, right=right, box=box, starts=starts, held=held, first=first, bins=bins, pairs=pairs
    )


def _trapezoids(polygons: db.Region) -> Floats | None:
    """Heights, left ends and right ends of trapezoids, float64 [3, 2, n], lower sides first; None if too many."""
    flat = [
        (n, edge.x1, edge.y1, edge.x2, edge.y2)
        for n, polygon in enumerate(polygons.each())
        for edge in polygon.each_edge()
        if edge.y1 != edge.y2
    ]
    owner, *ends = np.array(flat, dtype=np.int64).reshape(-1, 5).T
    x1, y1, x2, y2 = (end.astype(np.float64) for end in ends)
    swap = y1 > y2
    low, high, at_low, at_high = (np.where(swap, *pair) for pair in ((y2, y1), (y1, y2), (x2, x1), (x1, x2)))
    # Heights of corners, polygon by polygon: every edge has its two.
    heights = np.concatenate([low, high]).astype(np.int64)
    levels, places = np.unique(np.tile(owner, 2) * _ROW + heights, return_inverse=True)
    level_y = ((levels + _ROW // 2) % _ROW - _ROW // 2).astype(np.float64)
    first, last = places.reshape(2, -1)
    if (last - first).sum() > _MOST_PARTS_CUT:
        return None
    edge, number = expanded(last - first)
    strip = first[edge] + number
    y = np.stack([level_y[strip], level_y[strip + 1]])
    x = at_low[edge] + (y - low[edge]) * ((at_high - at_low) / (high - low))[edge]
    order = np.lexsort((x.sum(axis=0), strip))
    left, right = order[::2], order[1::2]
    return np.stack([y[:, left], x[:, left], x[:, right]])


def _far_and_near(box: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Squares of the largest and the least distance of boxes from the middle."""
    (far_x, near_x), (far_y, near_y) = far_and_near(*box), far_and_near(*y)
    return far_x**2 + far_y**2, near_x**2 + near_y**2


def _bin(place: Floats, count: int) -> Indices:
    return np.clip((place + 1) * (count / 2), 0, count - 1).astype(np.intp)


@dataclass(frozen=True, eq=False)
class _Strip:
    """Heights that pairs of trapezoids share, and the sides of both at either end: float64 [2, n], then [2, 2, n]."""

    y: Floats
    left: Floats
    right: Floats

    @classmethod
    def of(cls, lags: OutlineLags, own: Indices, other: Indices, lag_x: float, lag_y: float) -> _Strip:
        """Of trapezoids, and others that are moved back by a lag."""
        own_y, other_y = lags.y[:, own], lags.y[:, other] - lag_y
        y = np.stack([np.maximum(own_y[0], other_y[0]), np.minimum(own_y[1], other_y[1])])

        def at_ends(sides: Floats) -> Floats:
            parts = []
            for ends, at, moved in ((own_y, own, 0.0), (other_y, other, lag_x)):
                share = (y - ends[0]) / (ends[1] - ends[0])
                low, high = sides[:, at]
                parts.append(low + share * (high - low) - moved)
            return np.stack(parts, axis=1)

        return cls(y, at_ends(lags.left), at_ends(lags.right))

    def area(self) -> Floats:
        """Area of the pairs' common polygons, [n]."""
        share, width = self._widths()
        area = np.zeros(self.y.shape[1])
        for k in range(3):
            area += (share[k + 1] - share[k]) * _mean_above_zero(width[k], width[k + 1])
        return np.asarray(area * (self.y[1] - self.y[0]))

    def corners(self) -> tuple[Floats, Floats]:
        """Corners of the common polygons, anticlockwise, some of them alike; float64 [8, n] each."""
        share, width = self._widths()
        begin, end = np.zeros(share.shape[1]), np.ones(share.shape[1])
        for k in range(3):
            rises, falls = (width[k] < 0) & (width[k + 1] >= 0), (width[k] >= 0) & (width[k + 1] < 0)
            change = np.where(rises | falls, width[k] - width[k + 1], 1.0)
            crossing = share[k] + (share[k + 1] - share[k]) * width[k] / change
            begin, end = np.where(rises, crossing, begin), np.where(falls, crossing, end)
        # Nothing is shared where no width is above 0.
        end = np.where(width.max(axis=0) > 0, end, begin)
        places = np.clip(np.stack([begin, share[1], share[2], end]), begin, end)
        height = self.y[0] + places * (self.y[1] - self.y[0])
        x = np.concatenate([_right(self, places), _left(self, places)[::-1]])
        return x, np.concatenate([height, height[::-1]])

    def _widths(self) -> tuple[Floats, Floats]:
        """Shares of the way up between which widths are linear, and the widths there, float64 [4, n] each."""
        crossings = []
        for side in (self.left, self.right):
            below, above = side[0, 0] - side[0, 1], side[1, 0] - side[1, 1]
            crosses = below * above < 0
            crossings.append(np.where(crosses, below / np.where(crosses, below - above, 1.0), 0.0))
        none = np.zeros_like(crossings[0])
        share = np.stack([none, np.minimum(*crossings), np.maximum(*crossings), none + 1])
        return share, _right(self, share) - _left(self, share)


def _left(strip: _Strip, share: Floats) -> Floats:
    """Where common polygons begin at shares [k, n] of the way up."""
    (own, other), (above, other_above) = strip.left
    return np.asarray(np.maximum(own + share * (above - own), other + share * (other_above - other)))


def _right(strip: _Strip, share: Floats) -> Floats:
    (own, other), (above, other_above) = strip.right
    return np.asarray(np.minimum(own + share * (above - own), other + share * (other_above - other)))


def _mean_above_zero(first: Floats, last: Floats) -> Floats:
    """Mean of a linear function from one value to another, as far as it is above 0."""
    high, low = np.maximum(first, last), np.minimum(first, last)
    span = np.where(high > low, high - low, 1.0)
    positive = np.maximum(high, 0.0)
    return np.where(low >= 0, (high + low) / 2, positive**2 / (2 * span))
