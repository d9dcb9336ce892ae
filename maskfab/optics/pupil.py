"""The pupil: openings cut by the lens stop, the stop's edge integrated instead of stepped.

A transmission lies on a rectilinear grid in the plane of the stop, the optical axis at the origin. Wires dim the dots
that they cross, with a mean amplitude and a mean power that are exact for upright outlines. A dot that the stop cuts
keeps the exact shape of what is left of it, as its moments in Legendre polynomials: the zeroth alone is the usual grey
rim, the higher ones carry the curve.

Of a stop of straight sides the moments are sums over its edges. By Green's theorem an integral over what a polygon and
a box have in common is one along the polygon's edges,

    ∫∫ P_q(η) P_p(ξ) dξ dη = ∮ A_p(ξ) P_q(η) dη,    A_p(ξ) = ∫_{-1}^ξ P_p,

in the box's own coordinates ξ, η, both kept within [-1, 1]. On an edge the integrand is a polynomial between the points
at which it enters and leaves the box's width, so Gauss-Legendre nodes between these give it exactly.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Floats, Indices, Labels, Mask, distinct
from maskfab.base.errors import JobError
from maskfab.base.model import ORIENTATIONS, Frozen, Panel, Polygon, orient, refined
from maskfab.base.units import NM_PER_UM
from maskfab.job.camera import Stop
from maskfab.optics.polynomials import gauss_legendre, legendre, legendre_integrals


def veil(panel: Panel) -> tuple[Floats, Floats]:
    """Mean amplitude and mean power over each dot behind the wires, float64 [8, dots, dots] by orientation.

    A wire passes the amplitude sqrt(transmission) where it lies, once for each track however its outlines overlap;
    different tracks multiply.

    Raises:
        JobError: MF120 if an outline has an edge that is neither horizontal nor vertical.
    """
    lines = panel.cell_size.dot_edges_nm
    drawn = [track for track in panel.tracks if track.transmission < 1]
    points = [np.array(polygon).ravel() for track in drawn for polygon in track.polygons]
    cuts = np.concatenate([lines, *points, *(panel.pitch_nm - point for point in points)])
    # The same cuts in x and y, and mirrored, so that a turn is a turn of the array.
    edges = distinct(cuts[(cuts >= lines[0]) & (cuts <= lines[-1])])
    middle = (edges[1:] + edges[:-1]) / 2
    shares = np.diff(edges) / panel.dot_nm
    starts = np.searchsorted(edges, lines[:-1])
    power = np.ones((ORIENTATIONS, middle.size, middle.size))
    for track in drawn:
        covered = np.zeros(power.shape[1:], dtype=np.bool_)
        for polygon in track.polygons:
            covered |= _inside(polygon, middle)
        for k in range(ORIENTATIONS):
            power[k][orient(covered, k) if track.turns else covered] *= track.transmission
    area = shares[:, None] * shares
    amplitude, mean_power = (
        np.add.reduceat(np.add.reduceat(values * area, starts, axis=1), starts, axis=2)
        for values in (np.sqrt(power), power)
    )
    return amplitude, mean_power


def _inside(polygon: Polygon, middle: Floats) -> Mask:
    """Whether points of a square grid lie in a polygon: an odd number of its upright edges to their right."""
    inside = np.zeros((middle.size, middle.size), dtype=np.bool_)
    for (x0, y0), (x1, y1) in zip(polygon, (*polygon[1:], polygon[0]), strict=True):
        if x0 != x1 and y0 != y1:
            what = f"a wire's edge from ({x0}, {y0}) to ({x1}, {y1}) nm is neither horizontal nor vertical"
            raise JobError("MF120", what, where="wires", cure="Draw wires with horizontal and vertical edges")
        if x0 == x1:
            inside ^= ((middle > min(y0, y1)) & (middle < max(y0, y1)))[:, None] & (middle < x0)
    return inside


@dataclass(frozen=True)
class Lattice:
    """One axis of a panel: ``cells`` cells of ``dots`` dots each, an opaque strip between neighbouring cells.

    Attributes:
        start_um: lower edge of the first dot.
        pitch_um: distance between cells, at least dots x dot.
    """

    start_um: float
    cells: int
    dots: int
    dot_um: float
    pitch_um: float

    @property
    def has_gutter(self) -> bool:
        return self.pitch_um > self.dots * self.dot_um * (1 + 1e-12)

    @property
    def period(self) -> int:
        """Intervals from one cell to the next: its dots, and the strip if there is one."""
        return self.dots + 1 if self.has_gutter else self.dots

    @property
    def length_um(self) -> float:
        """From the lower edge of the first dot to the upper one of the last."""
        return (self.cells - 1) * self.pitch_um + self.dots * self.dot_um

    def edges_um(self) -> Floats:
        """Every dot edge once, ascending. With gutters the strip between two cells is one interval."""
        if not self.has_gutter:
            return self.start_um + self.dot_um * np.arange(self.cells * self.dots + 1, dtype=np.float64)
        first = self.start_um + self.pitch_um * np.arange(self.cells, dtype=np.float64)[:, None]
        return (first + self.dot_um * np.arange(self.dots + 1, dtype=np.float64)).ravel()

    def dot_index(self) -> Indices:
        """Interval number of every dot, [cells, dots]; the gutter strips are left out."""
        return np.arange(self.cells)[:, None] * self.period + np.arange(self.dots)

    def trimmed(self, half_width_um: float) -> Lattice:
        """The lattice without the cells at either end that lie beyond [-half_width, half_width].

        As many are left out at one end as at the other, so that a lattice about the axis stays one; where a cell's
        edge falls on the limit, rounding would else keep it on one side alone.
        """
        first = self.start_um + self.pitch_um * np.arange(self.cells)
        near = np.flatnonzero((first < half_width_um) & (first + self.dots * self.dot_um > -half_width_um))
        if not near.size:
            return self
        spare = min(int(near[0]), self.cells - 1 - int(near[-1]))
        start = self.start_um + spare * self.pitch_um
        return Lattice(start, self.cells - 2 * spare, self.dots, self.dot_um, self.pitch_um)


@dataclass(frozen=True, eq=False)
class Aperture(Frozen):
    """Transmission of the openings before the stop cuts them.

    Attributes:
        transmission: float64 [ny, nx] mean amplitude in [0, 1] of every interval pair; uint8 if asked for so.
        variance: float64 [ny, nx] variance of the amplitude within each; zero where an interval is uniform.
    """

    x: Lattice
    y: Lattice
    transmission: Floats
    variance: Floats


def finer_aperture(openings: Aperture, times: int) -> Aperture:
    """Openings on dots that are finer by a factor along each side; gutters stay as they are."""
    x, y = (replace(axis, dots=times * axis.dots, dot_um=axis.dot_um / times) for axis in (openings.x, openings.y))
    coarse = np.ix_(openings.y.dot_index().ravel(), openings.x.dot_index().ravel())
    fine = np.ix_(y.dot_index().ravel(), x.dot_index().ravel())

    def spread(values: Floats) -> Floats:
        shape = y.edges_um().size - 1, x.edges_um().size - 1
        if not any(values.strides):
            return zeros(shape)
        repeated = np.zeros(shape)
        repeated[fine] = refined(values[coarse], times)
        repeated.flags.writeable = False
        return repeated

    return Aperture(x, y, spread(openings.transmission), spread(openings.variance))


def covered_aperture(x: Lattice, y: Lattice, coverage: Floats) -> Aperture:
    """An aperture from the share of every interval that is clear, [ny, nx]; intervals clear in part keep their
    variance c (1 - c), so that energies and error bars stay true."""
    variance = 1 - coverage
    variance *= coverage
    variance.flags.writeable = False
    return Aperture(x, y, coverage, variance)


def panel_aperture(panel: Panel, half_width_um: float = np.inf, *, as_bytes: bool = False) -> Aperture:
    """The design's own aperture: dots straight from the opening and the orientation map, no polygons involved.

    Args:
        half_width_um: cells farther than this from the axis are left out.
        as_bytes: dots that are clear or dark are uint8, an eighth of the memory; enough for a table of lags.
    """
    dot, pitch, gutter = panel.dot_nm / NM_PER_UM, panel.cell_size.pitch_um, panel.gutter_nm / NM_PER_UM
    rows, columns = panel.orientations.shape

    def lattice(cells: int) -> Lattice:
        return Lattice(-cells * pitch / 2 + gutter / 2, cells, panel.opening.dots, dot, pitch)

    whole_x, whole_y = lattice(columns), lattice(rows)
    x, y = whole_x.trimmed(half_width_um), whole_y.trimmed(half_width_um)
    column = round((x.start_um - whole_x.start_um) / x.pitch_um)
    row = round((y.start_um - whole_y.start_um) / y.pitch_um)
    chosen = panel.orientations[row : row + y.cells, column : column + x.cells]
    patterns = panel.patterns
    if not panel.tracks:
        transmission = _laid_out(patterns.view(np.uint8) if as_bytes else patterns, chosen, x, y)
        return Aperture(x, y, transmission, zeros(transmission.shape))
    turns = np.arange(len(patterns)) % ORIENTATIONS
    amplitude, power = (patterns * values[turns] for values in veil(panel))
    spread = np.clip(power - amplitude**2, 0, None)
    transmission = _laid_out(amplitude, chosen, x, y)
    # Rounding leaves specks where a dot is uniform; real spreads are far above them.
    spread[spread < 1e-14] = 0
    variance = _laid_out(spread, chosen, x, y) if spread.any() else zeros(transmission.shape)
    return Aperture(x, y, transmission, variance)


def _laid_out(oriented: Floats | Mask | NDArray[np.uint8], chosen: Labels, x: Lattice, y: Lattice) -> Floats:
    """Values of dots [8 openings, dots, dots] over all intervals by what each cell holds; 0 in gutters; read-only."""
    kind: Any = np.float64 if oriented.dtype == np.bool_ else oriented.dtype
    transmission: Floats = np.zeros((y.edges_um().size - 1, x.edges_um().size - 1), dtype=kind)
    # One row of cells at a time stays in the processor's cache; thousands of dots across would not.
    strip = np.zeros((y.dots, x.cells, x.period), dtype=kind)
    for j in range(y.cells):
        for k in distinct(chosen[j]):
            strip[:, chosen[j] == k, : x.dots] = oriented[k][:, None, :]
        rows = slice(j * y.period, j * y.period + y.dots)
        transmission[rows] = strip.reshape(y.dots, -1)[:, : transmission.shape[1]]
    transmission.flags.writeable = False
    return transmission


def zeros(shape: tuple[int, int]) -> Floats:
    """Read-only zeros that take no memory, however many."""
    return np.broadcast_to(0.0, shape)


# Edges this near to a lattice's line, in shares of the polygon's extent, lie on it.
_ON_LINE = 1e-9


def polygon_cover(x: Floats, y: Floats, corners: Floats) -> tuple[Mask, Indices, Indices]:
    """Which intervals of a lattice a polygon holds wholly, and which its edges cross.

    Args:
        x, y: edges of the intervals, ascending.
        corners: [n, 2] of a polygon whose sides do not cross, counter-clockwise.

    Returns:
        bool [ny, nx] of those held; rows and columns of those crossed, row by row.
    """
    tolerance = _ON_LINE * float(abs(corners).max())
    middle_x, middle_y = (x[1:] + x[:-1]) / 2, (y[1:] + y[:-1]) / 2
    crossed = np.zeros((middle_y.size, x.size), dtype=np.int16)
    turns = np.zeros((middle_y.size, x.size), dtype=np.int16)
    for (px, py), (qx, qy) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        low, high = min(py, qy), max(py, qy)
        first, last = _met(y, low, high, tolerance)
        row = np.arange(int(first), int(last))
        ends = [_along(px, py, qx, qy, np.clip(side, low, high)) for side in (y[row], y[row + 1])]
        if py == qy:
            ends = [np.full(row.size, px), np.full(row.size, qx)]
        begin, end = _met(x, np.minimum(*ends), np.maximum(*ends), tolerance)
        some = begin < end
        np.add.at(crossed, (row[some], begin[some]), 1)
        np.add.at(crossed, (row[some], end[some]), -1)
        passed = np.flatnonzero((py <= middle_y) != (qy <= middle_y))
        column = np.searchsorted(middle_x, _along(px, py, qx, qy, middle_y[passed]))
        np.add.at(turns, (passed, column), 1 if qy < py else -1)
    met = np.cumsum(crossed, axis=1)[:, :-1] > 0
    inside = (np.cumsum(turns, axis=1)[:, :-1] != 0) & ~met
    row, column = np.nonzero(met)
    return inside, row, column


def polygon_moments(boxes: Floats, corners: Floats, orders: int) -> Floats:
    """Means over boxes of P_q(eta) P_p(xi) inside a polygon, [k, orders, orders].

    Args:
        boxes: [k, 4], x0, x1, y0, y1.
        corners: [n, 2] of a polygon whose sides do not cross, counter-clockwise.
    """
    moments = np.zeros((len(boxes), orders, orders))
    nodes, weights = gauss_legendre(orders + 1)
    for (px, py), (qx, qy) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if py == qy:
            continue
        low, high = min(py, qy), max(py, qy)
        met = np.flatnonzero((boxes[:, 3] > low) & (boxes[:, 2] < high) & (boxes[:, 0] < max(px, qx)))
        x0, x1, y0, y1 = boxes[met].T
        ends = np.clip(np.stack([y0, y1], axis=1), low, high)
        if px != qx:
            sides = np.stack([_along(py, px, qy, qx, side) for side in (x0, x1)], axis=1)
            ends = np.sort(np.concatenate([ends, np.clip(sides, ends[:, :1], ends[:, 1:])], axis=1), axis=1)
        length = np.diff(ends, axis=1)[:, :, None]
        samples = (met.size, (ends.shape[1] - 1) * nodes.size)
        y = (ends[:, :-1, None] + length * (nodes + 1) / 2).reshape(samples)
        height, width = (y1 - y0)[:, None], (x1 - x0)[:, None]
        weight = np.sign(qy - py) * (length * weights / 2).reshape(samples) / (2 * height)
        xi = np.clip(2 * (_along(px, py, qx, qy, y) - x0[:, None]) / width - 1, -1, 1)
        eta = np.clip(2 * (y - y0[:, None]) / height - 1, -1, 1)
        moments[met] += np.einsum(
            "qks,ks,pks->kqp", legendre(eta, orders), weight, legendre_integrals(xi, orders), optimize=True
        )
    return moments


def _along(px: float, py: float, qx: float, qy: float, y: Floats) -> Floats:
    """x where the line through two points has these y."""
    if py == qy:
        return np.full(y.shape, px)
    return np.asarray(px + (y - py) * ((qx - px) / (qy - py)))


def _met(edges: Floats, low: Floats, high: Floats, tolerance: float) -> tuple[Indices, Indices]:
    """First and last + 1 of the intervals that low to high reaches into, lines themselves belonging to none."""
    begin = np.searchsorted(edges, low + tolerance, "right") - 1
    end = np.searchsorted(edges, high - tolerance, "left")
    return np.clip(begin, 0, edges.size - 1), np.clip(end, 0, edges.size - 1)


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
class Pupil(Frozen):
    """Clear dots inside the stop.

    Attributes:
        whole: float64 [ny, nx] transmission of the intervals that the stop leaves whole; 0 elsewhere.
        whole_variance: float64 [ny, nx] its variance within each of them.
        rim_row, rim_column: intp [k] intervals that the stop cuts and that transmit, row by row.
        rim_moments: float64 [k, orders, orders]; ``[i, q, p]`` is the mean over interval i of
            transmission x P_q(eta) x P_p(xi) inside the stop, xi and eta in [-1, 1].
        rim_transmission: float64 [k], amplitude of the cut intervals.
        stop_um: where in the lattices its middle is.
    """

    x: Lattice
    y: Lattice
    whole: Floats
    whole_variance: Floats
    rim_row: Indices
    rim_column: Indices
    rim_moments: Floats
    rim_transmission: Floats
    stop: Stop
    stop_um: tuple[float, float] = (0.0, 0.0)

    @classmethod
    def of_whole_dots(cls, x: Lattice, y: Lattice, whole: Floats, stop: Stop) -> Pupil:
        """A pupil whose stop takes or leaves whole intervals, as if its edge followed them."""
        none = np.zeros(0, dtype=np.intp)
        moments = np.zeros((0, RIM_ORDERS, RIM_ORDERS))
        return cls(x, y, whole, zeros(whole.shape), none, none, moments, np.zeros(0), stop)

    @property
    def reach_um(self) -> tuple[float, float]:
        """Farthest from the axis that an interval lies, along x and along y."""
        x, y = (float(abs(lattice.edges_um()).max()) for lattice in (self.x, self.y))
        return x, y

    def scaled(self, factor: float) -> Pupil:
        """A pupil that many times as clear."""
        return replace(
            self,
            whole=self.whole * factor,
            whole_variance=self.whole_variance * factor**2 if any(self.whole_variance.strides) else self.whole_variance,
            rim_moments=self.rim_moments * factor,
            rim_transmission=self.rim_transmission * factor,
        )

    @property
    def mean_transmission(self) -> Floats:
        """Amplitude averaged over each interval, float64 [ny, nx]: the grey-rim picture of the pupil; read-only."""
        grey = self.grey_rows(np.arange(len(self.whole)))
        grey.flags.writeable = False
        return grey

    def grey_rows(self, rows: Indices) -> Floats:
        """Some rows of the mean transmission, ascending, [n, nx]."""
        grey = self.whole[rows].astype(np.float64, copy=False)
        first, last = np.searchsorted(self.rim_row, [rows[0], rows[-1] + 1])
        place = np.searchsorted(rows, self.rim_row[first:last])
        held = rows[place] == self.rim_row[first:last]
        grey[place[held], self.rim_column[first:last][held]] = self.rim_moments[first:last, 0, 0][held]
        return grey

    @property
    def variance(self) -> Floats:
        """Variance of the amplitude within each interval, float64 [ny, nx], left out of the grey rim; read-only."""
        spread = self.whole_variance.copy()
        spread[self.rim_row, self.rim_column] = self.rim_variance
        spread.flags.writeable = False
        return spread

    @property
    def rim_variance(self) -> Floats:
        """Variance of the amplitude within each cut interval, [k]."""
        share = self.rim_moments[:, 0, 0] / self.rim_transmission
        return np.asarray(self.rim_transmission**2 * np.clip(share * (1 - share), 0, None))

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
        varies = any(self.whole_variance.strides)
        rows = [
            heights[part] @ (self.whole[part] ** 2 + (self.whole_variance[part] if varies else 0))
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


def cut(aperture: Aperture, stop: Stop, orders: int = RIM_ORDERS) -> Pupil:
    """The part of an aperture inside a centred stop, dots that it cuts with moments of so many orders."""
    x, y = aperture.x.edges_um(), aperture.y.edges_um()
    whole, variance, row, column = _parted(aperture, stop)
    transmits = aperture.transmission[row, column] != 0
    row, column = row[transmits], column[transmits]
    transmission = aperture.transmission[row, column]
    moments = _moments(x, y, row, column, transmission, stop, orders)
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
    return replace(stop.scaled(stop.inner_share, stop.inner_share), inner_share=0.0)


def _within(values: Floats, first: Indices, last: Indices) -> Floats:
    """The values in columns first to last - 1 of every row, zero elsewhere; read-only."""
    clipped = np.zeros_like(values)
    for j in np.flatnonzero(first < last):
        clipped[j, first[j] : last[j]] = values[j, first[j] : last[j]]
    clipped.flags.writeable = False
    return clipped


def _without(values: Floats, begin: Indices, end: Indices) -> Floats:
    """The values, zero in columns begin to end - 1 of every row; read-only."""
    rest = values.copy()
    for j in np.flatnonzero(begin < end):
        rest[j, begin[j] : end[j]] = 0.0
    rest.flags.writeable = False
    return rest


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
    """Moments of cut dots, [k, orders, orders]; of mirror images those of one of them."""
    turned = np.ones((2, row.size, orders))
    if not stop.outline_um and all(abs(edges + edges[::-1]).max() <= _ON_LINE * edges[-1] for edges in (x, y)):
        for turn, index, count in zip(turned, (row, column), (y.size - 1, x.size - 1), strict=True):
            # P_p of a mirror image is (-1)^p times that of the other.
            turn[2 * index < count - 1, 1::2] = -1.0
        row, column = np.maximum(row, y.size - 2 - row), np.maximum(column, x.size - 2 - column)
    place, which = np.unique(row * x.size + column, return_inverse=True, return_counts=True)[:2]
    row, column = np.divmod(place, x.size)
    boxes = np.stack([x[column], x[column + 1], y[row], y[row + 1]], axis=1)
    moments = _stop_moments(boxes, stop, orders)[which]
    moments *= (transmission[:, None] * turned[0])[:, :, None] * turned[1][:, None, :]
    moments.flags.writeable = False
    return moments


def _stop_moments(boxes: Floats, stop: Stop, orders: int) -> Floats:
    """Moments of box x stop, [k, orders, orders]; stretching both alike leaves them as they are."""
    if stop.outline_um:
        return polygon_moments(boxes, np.array(stop.outline_um), orders)
    if not stop.round:
        along = []
        for k, side in zip((0, 2), stop.sides_um, strict=True):
            low, high = boxes[:, k], boxes[:, k + 1]
            start, end = (np.clip(2 * (x - low) / (high - low) - 1, -1, 1) for x in (-side / 2, side / 2))
            along.append((legendre_integrals(end, orders) - legendre_integrals(start, orders)).T / 2)
        along_x, along_y = along
        return along_y[:, :, None] * along_x[:, None, :]
    moments = _circle_moments(boxes * np.repeat(_to_circle(stop), 2), stop.diameter_um / 2, orders)
    return moments - _stop_moments(boxes, _middle(stop), orders) if stop.inner_share else moments


def _circle_moments(boxes: Floats, radius: float, orders: int) -> Floats:
    """Moments of box x disc, [k, orders, orders], by slices of constant y = R sin(theta).

    Over theta the half chord R cos(theta) is smooth even at the poles, so Gauss-Legendre between the angles at which
    the disc's edge crosses the box's sides converges to rounding. At a pole y is quadratic in theta, and the integrand
    of a degree near 3 x orders. Along x a moment is an integral up to the right end of a slice less that up to the left
    one. Ends on the box's own sides need no quadrature: from -1 to 1 all orders but the zeroth vanish.
    """
    rule = gauss_legendre(max(_SLICE_NODES, -(-3 * orders // 2) + 1))
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
    first, last, left, right, bottom, top = (bound[slices, None] for bound in (first, last, left, right, bottom, top))
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
    turn = np.arange(box.size) - np.searchsorted(box, box)
    for k in range(int(turn.max(initial=-1)) + 1):
        moments[box[turn == k]] += slices[turn == k]
