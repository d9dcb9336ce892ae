"""The exact autocorrelation of polygons behind the stop, for masks whose edges lie on no grid of dots.

    C(s) = ∫∫ a(r) a(r + s) d²r                                              (Goodman, Fourier Optics, 6.3)

is the area that the clear region shares with itself, moved by -s, inside the stop and inside the stop moved as far. The
region is cut into trapezoids with level sides. Two of them share a convex polygon, whose width is linear between at
most four heights, so that its area is a closed form. Where a circle cuts that polygon its arcs are integrated, not
replaced by chords (:mod:`maskfab.optics.rim`).

On a lattice of lags, all of them at once are had from means over small squares whose side divides the lattice's step.
At such lags squares meet squares, and what their shapes change is at most the autocorrelation of their standard
deviations (Cauchy-Schwarz): a bound for every lag, good enough to tell where the exact value is worth its time.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from klayout import db

from maskfab.base.arrays import Floats, Indices, Mask, fast_length
from maskfab.base.model import frozen
from maskfab.base.units import NM_PER_UM
from maskfab.job.camera import Stop
from maskfab.optics.rim import area_in_both_discs
from maskfab.optics.stop_edges import cutting_box, stop_box, stop_region

Raster = Callable[[Floats], Floats]
"""Gives the clear shares of squares, rows from the lowest on, between lines that are alike along both axes, in µm."""

# Cuts of slanted edges are rounded to a unit: as fine as coordinates bear.
_LARGEST_COORDINATE = 900_000_000
_MOST_BINS = 1000
# Squares along the stop, and most of them along a step of the lattice.
_SQUARES, _MOST_PARTS = 4000, 32
# A rim of many chords stands for the circle in rasters.
_OF_CHORDS = 1e-8

MOST_TRAPEZOIDS = 20_000
"""A lag of them takes 12 ms, and an analysis asks for three thousand."""


@dataclass(frozen=True, eq=False)
class OutlineLags:
    """Trapezoids of a clear region, in half sides of the stop.

    Attributes:
        stop: which cuts them, if it is round; any other stop has cut them.
        y: float64 [2, n], lower and upper side.
        left, right: float64 [2, n], ends of the lower and of the upper side.
        box: float64 [2, n], the lesser of the left ends and the greater of the right ones.
        starts, held: trapezoids that lie in bins of the plane, and where each bin's begin, row by row.
        bins: number of bins along x and along y.
    """

    stop: Stop
    raster: Raster
    y: Floats
    left: Floats
    right: Floats
    box: Floats
    starts: Indices
    held: Indices
    bins: tuple[int, int]

    @property
    def count(self) -> int:
        """Number of trapezoids."""
        return int(self.y.shape[1])

    @property
    def rounding(self) -> float:
        """Share of the clear area by which the autocorrelation may err: stops with corners are cut on a grid."""
        return 1e-11 if self.stop.round else 1e-8

    def autocorrelation_um2(self, lag_x_um: Floats, lag_y_um: Floats) -> Floats:
        """The area shared at lags [n], in square micrometres."""
        width, height = self.stop.sides_um
        lags = zip((lag_x_um * (2 / width)).tolist(), (lag_y_um * (2 / height)).tolist(), strict=True)
        return np.array([self._shared(x, y) for x, y in lags]) * (width * height / 4)

    def on_lattice(self, step_um: float, count: int) -> tuple[Floats, Floats]:
        """The autocorrelation at whole steps, and a bound of the error of each, in square micrometres.

        Returns:
            float64 [count, 2 count - 1] each, lags from 0 on along y, and from -(count - 1) steps on along x.
        """
        cells = math.ceil(self.stop.diameter_um / step_um)
        parts = int(np.clip(_SQUARES // cells, 1, _MOST_PARTS))
        side = step_um / parts
        shares = self.raster(side * (np.arange(cells * parts + 1, dtype=np.float64) - cells * parts / 2))
        size = fast_length(cells + min(count, cells))
        powers = np.zeros((2, size, size // 2 + 1))
        for row in range(parts):
            for column in range(parts):
                means = shares[row::parts, column::parts]
                for kind, values in enumerate((means, np.sqrt(means * (1 - means)))):
                    spectrum = np.fft.rfft2(values, (size, size))
                    powers[kind] += spectrum.real**2 + spectrum.imag**2
        lags = np.arange(1 - count, count)
        reached = abs(lags) < cells
        tables = np.zeros((2, count, 2 * count - 1))
        for table, power in zip(tables, powers, strict=True):
            rows = min(count, cells)
            table[:rows, reached] = np.fft.irfft2(power, (size, size))[:rows, lags[reached] % size] * side**2
        # What shapes change raises lag 0 by all of it.
        values, errors = tables
        values[0, count - 1] += errors[0, count - 1]
        errors[0, count - 1] = 0.0
        return values, errors + (_OF_CHORDS + self.rounding) * values[0, count - 1]

    def _shared(self, lag_x: float, lag_y: float) -> float:
        own, other = self._pairs(lag_x, lag_y)
        strip = _Strip.of(self, own, other, lag_x, lag_y)
        if not self.stop.round:
            return float(strip.area().sum())
        inside, outside = strip.by_discs(self.stop.inner_share, lag_x, lag_y)
        on_rim = strip.chosen(~inside & ~outside)
        x, y = on_rim.corners()
        cut = area_in_both_discs(x, y, (lag_x, lag_y), self.stop.inner_share)
        return float(strip.chosen(inside).area().sum()) + float(cut.sum())

    def _pairs(self, lag_x: float, lag_y: float) -> tuple[Indices, Indices]:
        """Trapezoids, and those whose boxes they meet when moved by a lag."""
        left, right = self.box
        low, high = self.y
        own = np.flatnonzero((left < 1 - lag_x) & (right > -1 - lag_x) & (low < 1 - lag_y) & (high > -1 - lag_y))
        own_left, own_right = self.box[:, own] + lag_x
        own_low, own_high = self.y[:, own] + lag_y
        columns, rows = self.bins
        first_x, last_x = _bin(own_left, columns), _bin(own_right, columns)
        first_y, last_y = _bin(own_low, rows), _bin(own_high, rows)
        across = last_x - first_x + 1
        place, number = _expanded(across * (last_y - first_y + 1))
        up = number // across[place]
        row, column = first_y[place] + up, first_x[place] + number - up * across[place]
        where = row * columns + column
        begun = self.starts[where]
        of_bin, number = _expanded(self.starts[where + 1] - begun)
        place, other = place[of_bin], self.held[begun[of_bin] + number]
        corner_x, corner_y = np.maximum(own_left[place], left[other]), np.maximum(own_low[place], low[other])
        met = (corner_x < np.minimum(own_right[place], right[other])) & (
            corner_y < np.minimum(own_high[place], high[other])
        )
        # A pair is met in the bin of its boxes' common corner alone.
        met &= (_bin(corner_x, columns) == column[of_bin]) & (_bin(corner_y, rows) == row[of_bin])
        own = own[place]
        return own[met], other[met]


def outline_lags(shapes: db.Region, stop: Stop, centre_nm: tuple[float, float], raster: Raster) -> OutlineLags | None:
    """Merged polygons, or such as do not overlap, made ready for any lag; None if they are too many.

    Args:
        shapes: what is clear, in nanometres.
        centre_nm: where the optical axis meets the plate, to half a nanometre.
        raster: of the same.
    """
    scale = 1 if stop.round else 2 * max(1, int(_LARGEST_COORDINATE / (2.2 * stop.diameter_um * NM_PER_UM)))
    near = shapes.interacting(db.Region(db.Box(*stop_box(stop, centre_nm))))
    centre = np.array(centre_nm)
    if not stop.round:
        near &= cutting_box(stop, centre_nm)
        near.transform(db.ICplxTrans(float(scale)))
        near.move(*np.rint(-scale * centre).astype(int).tolist())
        near &= stop_region(stop, NM_PER_UM * scale)
        centre = np.zeros(2)
    # KLayout rounds where it cuts slanted edges, and cuts those that lie along x and y in the right places.
    level = near.rectilinear().decompose_trapezoids_to_region()
    parts = [_trapezoids(part) for part in (level, near.non_rectilinear())]
    if any(part is None for part in parts):
        return None
    y, left, right = np.concatenate([part for part in parts if part is not None], axis=2)
    across, up = (2 / (side * NM_PER_UM * scale) for side in stop.sides_um)
    y, left, right = (y - centre[1]) * up, (left - centre[0]) * across, (right - centre[0]) * across
    return None if y.shape[1] > MOST_TRAPEZOIDS else _binned(stop, raster, y, left, right)


def _trapezoids(polygons: db.Region) -> Floats | None:
    """Heights, left ends and right ends of trapezoids, float64 [3, 2, n], their lower sides first.

    Every polygon is cut at the heights of all its corners.
    """
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
    levels, places = np.unique(np.stack([np.tile(owner, 2), np.concatenate([low, high])]), axis=1, return_inverse=True)
    first, last = places.reshape(2, -1)
    if (last - first).sum() > 4 * MOST_TRAPEZOIDS:
        return None
    edge, number = _expanded(last - first)
    strip = first[edge] + number
    y = np.stack([levels[1, strip], levels[1, strip + 1]])
    x = at_low[edge] + (y - low[edge]) * ((at_high - at_low) / (high - low))[edge]
    order = np.lexsort((x.sum(axis=0), strip))
    left, right = order[::2], order[1::2]
    return np.stack([y[:, left], x[:, left], x[:, right]])


def _binned(stop: Stop, raster: Raster, y: Floats, left: Floats, right: Floats) -> OutlineLags:
    box = np.stack([np.minimum(*left), np.maximum(*right)])
    ends = (box[0], box[1]), (y[0], y[1])
    columns, rows = (int(np.clip(2 / max(float((b - a).mean()), 1e-9), 1, _MOST_BINS)) for a, b in ends)
    (first_x, last_x), (first_y, last_y) = (
        [_bin(end, count) for end in axis] for axis, count in zip(ends, (columns, rows), strict=True)
    )
    across = last_x - first_x + 1
    held, number = _expanded(across * (last_y - first_y + 1))
    where = (first_y[held] + number // across[held]) * columns + first_x[held] + number % across[held]
    order = np.argsort(where, kind="stable")
    starts = np.searchsorted(where[order], np.arange(columns * rows + 1))
    return OutlineLags(
        stop, raster, frozen(y), frozen(left), frozen(right), frozen(box), starts, held[order], (columns, rows)
    )


def _bin(place: Floats, count: int) -> Indices:
    return np.clip((place + 1) * (count / 2), 0, count - 1).astype(np.intp)


def _expanded(counts: Indices) -> tuple[Indices, Indices]:
    """Whose each of so many items is, and its number among them."""
    owner = np.repeat(np.arange(counts.size), counts)
    return owner, np.arange(owner.size) - np.repeat(np.cumsum(counts) - counts, counts)


@dataclass(frozen=True, eq=False)
class _Strip:
    """Heights that pairs of trapezoids share, and their sides at either end.

    Attributes:
        y: float64 [2, n], of the ends.
        left, right: float64 [2, 2, n], at the ends, of the own trapezoid and of the other.
    """

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

    def chosen(self, which: Mask) -> _Strip:
        return _Strip(self.y[:, which], self.left[..., which], self.right[..., which])

    def by_discs(self, hole: float, lag_x: float, lag_y: float) -> tuple[Mask, Mask]:
        """Which pairs share nothing but what both discs hold, and which nothing that they do."""
        left, right = np.maximum(*np.minimum(*self.left)), np.minimum(*np.maximum(*self.right))
        inside, outside = np.ones(left.size, dtype=np.bool_), left >= right
        for move_x, move_y in ((0.0, 0.0), (lag_x, lag_y)):
            far, near = np.zeros(left.size), np.zeros(left.size)
            for low, high in ((left + move_x, right + move_x), self.y + move_y):
                far += np.maximum(low**2, high**2)
                near += np.where((low < 0) & (high > 0), 0.0, np.minimum(low**2, high**2))
            inside &= (far < 1) & (near >= hole**2)
            outside |= (near >= 1) | (far <= hole**2)
        return inside & ~outside, outside

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
