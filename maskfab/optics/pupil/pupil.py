"""The pupil: openings cut by the lens stop, the stop's edge integrated instead of stepped.

A dot that the stop cuts keeps the exact shape of what is left of it, as its moments in Legendre polynomials.
The zeroth moment alone is the usual grey rim; the higher ones carry the curve.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.polynomial.legendre import leggauss
from numpy.typing import NDArray

from maskfab.base.arrays import Floats, Indices
from maskfab.model import Stop, frozen
from maskfab.optics.functions.legendre import legendre, legendre_integrals
from maskfab.optics.pupil.aperture import Aperture, Lattice, zeros
from maskfab.optics.pupil.polygon_stop import polygon_cover, polygon_moments

Range = tuple[Indices, Indices]

RIM_ORDERS = 10
"""Legendre orders that a cut dot gets at once, enough for most cameras; :meth:`Pupil.moments` gives any number."""

_SLICE_NODES = 12
_SLICES = 3
# Angle above which a dot is cut into slices.
_WIDE_SLICE = 0.1
_ROWS_AT_A_TIME = 128
# Cut dots times orders whose slices stay in the processor's cache; memory for more at once costs more than the sums.
_ORDERS_AT_A_TIME = 5120


@dataclass(frozen=True, eq=False)
class Pupil:
    """Clear dots inside the stop.

    Attributes:
        x, y: lattices whose edges bound the intervals.
        whole: float64 [ny, nx] transmission of the intervals that the stop leaves whole; 0 elsewhere.
        whole_variance: float64 [ny, nx] its variance within each of them.
        rim_row, rim_column: intp [k] intervals that the stop cuts and that transmit.
        rim_moments: float64 [k, orders, orders]; ``[i, q, p]`` is the mean over interval i of
            transmission x P_q(eta) x P_p(xi) inside the stop, xi and eta in [-1, 1].
        rim_transmission: float64 [k], amplitude of the cut intervals.
        stop: the lens stop.
        stop_um: where in the lattices its middle is.
    """

    x: Lattice
    y: Lattice
    whole: Floats
    whole_variance: Floats
    rim_row: NDArray[np.intp]
    rim_column: NDArray[np.intp]
    rim_moments: Floats
    rim_transmission: Floats
    stop: Stop
    stop_um: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        for name in ("whole", "whole_variance", "rim_moments", "rim_transmission"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    @classmethod
    def of_whole_dots(cls, x: Lattice, y: Lattice, whole: Floats, stop: Stop) -> Pupil:
        """A pupil whose stop takes or leaves whole intervals, as if its edge followed them."""
        none = np.zeros(0, dtype=np.intp)
        moments = np.zeros((0, RIM_ORDERS, RIM_ORDERS))
        return cls(x, y, whole, zeros(whole.shape), none, none, moments, np.zeros(0), stop)

    @property
    def mean_transmission(self) -> Floats:
        """Amplitude averaged over each interval, float64 [ny, nx]: the grey-rim picture of the pupil; read-only."""
        grey = self.whole.copy()
        grey[self.rim_row, self.rim_column] = self.rim_moments[:, 0, 0]
        grey.flags.writeable = False
        return grey

    @property
    def variance(self) -> Floats:
        """Variance of the amplitude within each interval, float64 [ny, nx], left out of the grey rim; read-only."""
        share = self.rim_moments[:, 0, 0] / self.rim_transmission
        spread = self.whole_variance.copy()
        spread[self.rim_row, self.rim_column] = self.rim_transmission**2 * np.clip(share * (1 - share), 0, None)
        spread.flags.writeable = False
        return spread

    @cached_property
    def field_integral_um2(self) -> float:
        """Integral of the amplitude: the field on the axis."""
        widths, heights = np.diff(self.x.edges_um()), np.diff(self.y.edges_um())
        area = heights[self.rim_row] * widths[self.rim_column]
        return float(heights @ self.whole @ widths + area @ self.rim_moments[:, 0, 0])

    @cached_property
    def energy_um2(self) -> float:
        """Integral of the squared amplitude: all transmitted energy; the clear area if the mask is binary."""
        widths, heights = np.diff(self.x.edges_um()), np.diff(self.y.edges_um())
        rows = [
            heights[part] @ (self.whole[part] ** 2 + self.whole_variance[part])
            for part in (slice(start, start + _ROWS_AT_A_TIME) for start in range(0, heights.size, _ROWS_AT_A_TIME))
        ]
        # A cut dot of amplitude t has t² where it is clear, and t times its share is its mean.
        area = heights[self.rim_row] * widths[self.rim_column]
        return float(sum(rows) @ widths + area @ (self.rim_transmission * self.rim_moments[:, 0, 0]))

    def moments(self, orders: int) -> Floats:
        """``rim_moments`` of so many orders, [k, orders, orders]; more than are stored are integrated afresh."""
        if orders <= self.rim_moments.shape[1]:
            return self.rim_moments[:, :orders, :orders]
        x, y = (axis.edges_um() - at for axis, at in zip((self.x, self.y), self.stop_um, strict=True))
        return _moments(x, y, self.rim_row, self.rim_column, self.rim_transmission, self.stop, orders)


def cut(aperture: Aperture, stop: Stop) -> Pupil:
    """The part of an aperture inside a centred stop."""
    x, y = aperture.x.edges_um(), aperture.y.edges_um()
    whole, variance, row, column = _parted(aperture, stop)
    transmits = aperture.transmission[row, column] != 0
    row, column = row[transmits], column[transmits]
    transmission = aperture.transmission[row, column]
    moments = _moments(x, y, row, column, transmission, stop, RIM_ORDERS)
    return Pupil(aperture.x, aperture.y, whole, variance, row, column, moments, transmission, stop)


def share_inside(x: Lattice, y: Lattice, stop: Stop) -> Floats:
    """Share of every interval's area that lies inside a centred stop, [ny, nx]."""
    across, up = x.edges_um(), y.edges_um()
    clear = np.broadcast_to(1.0, (up.size - 1, across.size - 1))
    whole, _, row, column = _parted(Aperture(x, y, clear, zeros(clear.shape)), stop)
    share = whole.copy()
    share[row, column] = _moments(across, up, row, column, clear[row, column], stop, 1)[:, 0, 0]
    return share


def _parted(aperture: Aperture, stop: Stop) -> tuple[Floats, Floats, Indices, Indices]:
    """Transmission and variance of the intervals inside the stop, 0 elsewhere; rows and columns of those it cuts."""
    x, y = aperture.x.edges_um(), aperture.y.edges_um()
    varies = any(aperture.variance.strides)
    if stop.outline_um:
        inside, row, column = polygon_cover(x, y, np.array(stop.outline_um))
        whole, variance = (np.where(inside, values, 0.0) for values in (aperture.transmission, aperture.variance))
        return whole, variance if varies else zeros(whole.shape), row, column
    ranges = _ellipse_ranges if stop.round else _box_ranges
    (first, last), (begin, end) = ranges(x, y, stop)
    whole = _within(aperture.transmission, first, last)
    variance = _within(aperture.variance, first, last) if varies else zeros(whole.shape)
    row, column = _between(begin, end, first, last)
    if stop.inner_share:
        (first, last), (begin, end) = _ellipse_ranges(x, y, _middle(stop))
        whole = _without(whole, begin, end)
        variance = _without(variance, begin, end) if varies else variance
        place = np.union1d(
            row * x.size + column, np.ravel_multi_index(_between(begin, end, first, last), (y.size, x.size))
        )
        row, column = np.divmod(place, x.size)
    return whole, variance, row, column


def _middle(stop: Stop) -> Stop:
    """The dark middle of an annulus."""
    return replace(stop.scaled(stop.inner_share, stop.inner_share), inner_share=0.0)


def _within(values: Floats, first: Indices, last: Indices) -> Floats:
    """The values in columns first to last - 1 of every row, zero elsewhere; read-only."""
    column, start, stop = (number.astype(np.int32) for number in (np.arange(values.shape[1]), first, last))
    kept = np.where((column >= start[:, None]) & (column < stop[:, None]), values, 0.0)
    kept.flags.writeable = False
    return kept


def _without(values: Floats, begin: Indices, end: Indices) -> Floats:
    """The values, zero in columns begin to end - 1 of every row; read-only."""
    kept = values.copy()
    for j in np.flatnonzero(begin < end):
        kept[j, begin[j] : end[j]] = 0.0
    kept.flags.writeable = False
    return kept


def _between(begin: Indices, end: Indices, first: Indices, last: Indices) -> tuple[Indices, Indices]:
    """Rows and columns, row by row, of what lies in begin to end - 1 but not in first to last - 1."""
    empty = first >= last
    starts = np.stack([begin, np.where(empty, end, last)], axis=1).ravel()
    counts = np.clip(np.stack([np.where(empty, end, first), end], axis=1).ravel() - starts, 0, None)
    row = np.repeat(np.repeat(np.arange(begin.size), 2), counts)
    column = np.arange(row.size) + np.repeat(starts - (np.cumsum(counts) - counts), counts)
    return row, column


def _ellipse_ranges(x: Floats, y: Floats, stop: Stop) -> tuple[Range, Range]:
    """Columns of every row that lie wholly inside the ellipse, and those that lie in it at least in part."""
    radius2 = (stop.diameter_um / 2) ** 2
    x, y = (edges * scale for edges, scale in zip((x, y), _to_circle(stop), strict=True))
    inside = _at_most(_farthest(x) ** 2, radius2 - _farthest(y) ** 2, "right")
    touched = _at_most(_nearest_to_zero(x) ** 2, radius2 - _nearest_to_zero(y) ** 2, "left")
    return inside, touched


def _to_circle(stop: Stop) -> tuple[float, float]:
    """Stretches along x and y that make an ellipse the circle of its longer side."""
    width, height = stop.sides_um
    return stop.diameter_um / width, stop.diameter_um / height


def _box_ranges(x: Floats, y: Floats, stop: Stop) -> tuple[Range, Range]:
    half_x, half_y = (side / 2 for side in stop.sides_um)
    tolerance = 1e-9 * stop.diameter_um
    inside = np.where(_farthest(y) <= half_y + tolerance, half_x + tolerance, -1.0)
    touched = np.where(_nearest_to_zero(y) < half_y - tolerance, half_x - tolerance, -1.0)
    return _at_most(_farthest(x), inside, "right"), _at_most(_nearest_to_zero(x), touched, "left")


def _at_most(distance: Floats, limit: Floats, side: Literal["left", "right"]) -> Range:
    """Columns whose distance, which falls and then rises, is below each limit, or equal to it if side is "right"."""
    middle = int(np.argmin(distance))
    before = np.searchsorted(distance[middle::-1], limit, side)
    after = np.searchsorted(distance[middle:], limit, side)
    return middle + 1 - before, middle + after


def _farthest(edges: Floats) -> Floats:
    return np.maximum(abs(edges[:-1]), abs(edges[1:]))


def _nearest_to_zero(edges: Floats) -> Floats:
    straddles = (edges[:-1] < 0) & (edges[1:] > 0)
    return np.where(straddles, 0.0, np.minimum(abs(edges[:-1]), abs(edges[1:])))


def _moments(
    x: Floats, y: Floats, row: Indices, column: Indices, transmission: Floats, stop: Stop, orders: int
) -> Floats:
    """Moments of cut dots, [k, orders, orders]."""
    boxes = np.stack([x[column], x[column + 1], y[row], y[row + 1]], axis=1)
    moments = _stop_moments(boxes, stop, orders)
    moments *= transmission[:, None, None]
    moments.flags.writeable = False
    return moments


def _stop_moments(boxes: Floats, stop: Stop, orders: int) -> Floats:
    """Moments of box x stop, [k, orders, orders]; stretching both alike leaves them as they are."""
    if stop.outline_um:
        return polygon_moments(boxes, np.array(stop.outline_um), orders)
    if not stop.round:
        return _box_moments(boxes, stop, orders)
    moments = _circle_moments(boxes * np.repeat(_to_circle(stop), 2), stop.diameter_um / 2, orders)
    return moments - _stop_moments(boxes, _middle(stop), orders) if stop.inner_share else moments


def _box_moments(boxes: Floats, stop: Stop, orders: int) -> Floats:
    """Moments of box x rectangle: products of one-dimensional ones, exact by Gauss-Legendre."""
    moments = []
    for k, side in zip((0, 2), stop.sides_um, strict=True):
        low, high = boxes[:, k], boxes[:, k + 1]
        start, end = (np.clip(2 * (x - low) / (high - low) - 1, -1, 1) for x in (-side / 2, side / 2))
        moments.append((legendre_integrals(end, orders) - legendre_integrals(start, orders)).T / 2)
    along_x, along_y = moments
    return along_y[:, :, None] * along_x[:, None, :]


def _circle_moments(boxes: Floats, radius: float, orders: int) -> Floats:
    """Moments of box x disc, [k, orders, orders], by slices of constant y = R sin(theta).

    Over theta the half chord R cos(theta) is smooth even at the poles, so Gauss-Legendre between the angles at which
    the disc's edge crosses the box's sides converges to rounding. At a pole y is quadratic in theta, and the integrand
    of a degree near 3 x orders. Along x a moment is an integral up to the right end of a slice less that up to the left
    one. Ends on the box's own sides need no quadrature: from -1 to 1 all orders but the zeroth vanish.
    """
    rule = leggauss(max(_SLICE_NODES, -(-3 * orders // 2) + 1))
    moments = np.empty((len(boxes), orders, orders))
    block = -(-_ORDERS_AT_A_TIME // orders)
    for start in range(0, len(boxes), block):
        some = slice(start, start + block)
        moments[some] = _sliced_moments(boxes[some], radius, orders, rule)
    return moments


def _sliced_moments(boxes: Floats, radius: float, orders: int, rule: tuple[Floats, Floats]) -> Floats:
    """Moments of box x disc by a rule on [-1, 1] for the slices that end on the disc's edge."""
    box, first, last = _slices(boxes, radius)
    left, right, bottom, top = boxes[box].T
    chord = radius * np.cos((first + last) / 2)
    moments = np.zeros((len(boxes), orders, orders))
    full = (-chord < right) & (right <= chord)
    heights = (2 * (radius * np.sin(end[full]) - bottom[full]) / (top - bottom)[full] - 1 for end in (first, last))
    low, high = (legendre_integrals(np.clip(eta, -1, 1), orders) for eta in heights)
    _add_by_box(moments[:, :, 0], box[full], (high - low).T / 2)
    slices, side = np.nonzero(np.stack([(left < -chord) & (-chord < right), (left < chord) & (chord < right)], axis=1))
    first, last, left, right, bottom, top = (each[slices, None] for each in (first, last, left, right, bottom, top))
    nodes, weights = rule
    theta = first + (last - first) * ((nodes + 1) / 2)
    edge = radius * np.cos(theta) * np.where(side, 1.0, -1.0)[:, None]
    along_y = legendre(np.clip(2 * (radius * np.sin(theta) - bottom) / (top - bottom) - 1, -1, 1), orders)
    along_y *= (last - first) / (top - bottom) * (weights / 4) * edge
    along_x = legendre_integrals(np.clip(2 * (edge - left) / (right - left) - 1, -1, 1), orders)
    _add_by_box(moments, box[slices], along_y.transpose(1, 0, 2) @ along_x.transpose(1, 2, 0))
    return moments


def _slices(boxes: Floats, radius: float) -> tuple[Indices, Floats, Floats]:
    """Boxes cut where the disc's edge crosses their sides: number of the box, ascending; first and last angle."""
    x0, x1, y0, y1 = boxes.T

    def angle(y: Floats) -> Floats:
        result: Floats = np.arcsin(np.clip(y / radius, -1, 1))
        return result

    half_chords = np.sqrt(np.clip(radius**2 - np.stack([x0, x1], axis=1) ** 2, 0, None))
    first, last = angle(y0), angle(y1)
    inner = np.where(last - first > _WIDE_SLICE, np.linspace(first, last, _SLICES + 1)[1:-1], first).T
    kinks = angle(np.concatenate([half_chords, -half_chords], axis=1))
    breaks = np.clip(np.concatenate([kinks, inner], axis=1), first[:, None], last[:, None])
    breaks = np.sort(np.concatenate([first[:, None], breaks, last[:, None]], axis=1), axis=1)
    # Most dots have one or two slices that are not empty.
    box, slot = np.nonzero(np.diff(breaks, axis=1))
    return box, breaks[box, slot], breaks[box, slot + 1]


def _add_by_box(moments: Floats, box: Indices, slices: Floats) -> None:
    """Add what slices hold to the boxes that they are of, ascending."""
    turn = np.arange(box.size) - np.searchsorted(box, box)
    for k in range(int(turn.max(initial=-1)) + 1):
        moments[box[turn == k]] += slices[turn == k]
