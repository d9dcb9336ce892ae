r"""What the shapes of cut dots add to an autocorrelation into which they enter with their mean transmissions.

A shifted cut dot meets up to four whole ones in rectangles, and what of these is clear follows from

    D_i(ξ, η) = clear area of dot i left of ξ and below η, less the mean's share of it,

at the point that the rectangles have in common; where the four are alike, shapes change nothing. Where two cut dots
meet, that part of their rectangle counts which both stops leave. Areas are closed forms, so every lag is exact.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maskfab.model import Stop, frozen
from maskfab.optics.aperture import Lattice
from maskfab.optics.overlap import Lines, area_before, has_closed_form, lines, shared_area
from maskfab.optics.pupil import Pupil

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]

# Pairs of a lag and a cut dot: so many are sifted at a time, in the fastest cache, for those that matter.
_PAIRS_AT_A_TIME, _SIFTED_AT_A_TIME = 131_072, 4_096
_UNLIKE, _CUT = 1, 2
_NEXT = (0, 1)


@dataclass(frozen=True, eq=False)
class RimLags:
    """The cut dots of a pupil, as a correction of the autocorrelation of mean transmissions.

    Attributes:
        x, y: the pupil's lattices.
        dots: the cut dots.
        whole: [ny, nx] transmission of what the stop leaves whole, in a margin of dark intervals; uint8 if binary.
        kind: uint8 like ``whole``: whether an interval and the next ones along x and y are unlike, and whether one of
            them is cut.
        margin: dark intervals on either side along y and along x.
        spread_um2: what the means lack at lag 0, and the table has been given there.
    """

    x: Lattice
    y: Lattice
    dots: CutDots
    whole: NDArray[np.uint8] | Floats
    kind: NDArray[np.uint8]
    margin: tuple[int, int]
    spread_um2: float

    def __post_init__(self) -> None:
        for name in ("whole", "kind"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    def correction_um2(self, lag_x_um: Floats, lag_y_um: Floats) -> Floats:
        """What a table of means, given its due at lag 0, lacks at lags [n], in square micrometres."""
        total = self._correction_um2(lag_x_um, lag_y_um)
        # Between lag 0 and the next ones the table is linear.
        at_zero = np.clip(1 - abs(lag_x_um) / self.x.dot_um, 0, None) * np.clip(
            1 - abs(lag_y_um) / self.y.dot_um, 0, None
        )
        return np.asarray(total - self.spread_um2 * at_zero)

    def _correction_um2(self, lag_x_um: Floats, lag_y_um: Floats) -> Floats:
        total = np.zeros(lag_x_um.size)
        width, matters = self.whole.shape[1], self.kind.ravel() != 0
        place = (self.dots.row + self.margin[0]) * width + self.dots.column + self.margin[1]
        batch = max(1, _PAIRS_AT_A_TIME // place.size)
        for start in range(0, lag_x_um.size, batch):
            part = slice(start, start + batch)
            # A dot meets those ahead of it and those behind; two cut dots are counted once.
            for sign in (1.0, -1.0):
                lag = sign * np.stack([lag_x_um[part], lag_y_um[part]])
                for along_y in _shifts(self.y, lag[1], self.margin[0]):
                    for along_x in _shifts(self.x, lag[0], self.margin[1]):
                        found = _sifted(matters, place, along_y.intervals * width + along_x.intervals)
                        meeting = _Meeting(self, along_x, along_y, *found)
                        total[part] += meeting.with_whole_um2()
                        if sign > 0:
                            total[part] += meeting.with_cut_um2(place, lag)
        return total


@dataclass(frozen=True, eq=False)
class CutDots:
    """Dots that a stop cuts, and how it does.

    Attributes:
        row, column: intp [k], intervals, row by row.
        transmission, mean: float64 [k], amplitude, and its mean over what the stop leaves and takes.
        stop: the lens stop.
        sides: of the dots: left, right, bottom, top.
        corner, ending, topping: float64 [k], area of the stop before a dot's first corner, the one at its right and
            the one at its top.
        area_um2: float64 [k], what the stop leaves.
    """

    row: Indices
    column: Indices
    transmission: Floats
    mean: Floats
    stop: Stop
    sides: tuple[Lines, Lines, Lines, Lines]
    corner: Floats
    ending: Floats
    topping: Floats
    area_um2: Floats

    @classmethod
    def of(cls, pupil: Pupil, chosen: Indices) -> CutDots:
        row, column, stop = pupil.rim_row[chosen], pupil.rim_column[chosen], pupil.stop
        x, y = pupil.x.edges_um(), pupil.y.edges_um()
        left, right = (lines(stop, 0, x[column + k]) for k in (0, 1))
        bottom, top = (lines(stop, 1, y[row + k]) for k in (0, 1))
        corner, ending, topping = (
            area_before(stop, left, bottom), area_before(stop, right, bottom), area_before(stop, left, top)
        )  # fmt: skip
        return cls(
            row, column, pupil.rim_transmission[chosen], pupil.rim_moments[chosen, 0, 0], stop,
            (left, right, bottom, top), corner, ending, topping,
            area_before(stop, right, top) - ending - topping + corner,
        )  # fmt: skip

    def before_um2(self, dot: Indices, x: Lines, y: Lines) -> Floats:
        """What the stop leaves of dots left of lines and below others."""
        left, _, bottom, _ = self.sides
        beside, below = area_before(self.stop, left.at(dot), y), area_before(self.stop, x, bottom.at(dot))
        return np.asarray(area_before(self.stop, x, y) - beside - below + self.corner[dot])

    def left_of_um2(self, dot: Indices, x: Lines) -> Floats:
        """What the stop leaves of dots left of lines."""
        _, _, bottom, top = self.sides
        part = area_before(self.stop, x, top.at(dot)) - area_before(self.stop, x, bottom.at(dot))
        return np.asarray(part - (self.topping - self.corner)[dot])

    def below_um2(self, dot: Indices, y: Lines) -> Floats:
        """What the stop leaves of dots below lines."""
        left, right, _, _ = self.sides
        part = area_before(self.stop, right.at(dot), y) - area_before(self.stop, left.at(dot), y)
        return np.asarray(part - (self.ending - self.corner)[dot])


def rim_lags(pupil: Pupil, reach_um: float) -> RimLags | None:
    """The cut dots of a pupil, for lags up to a reach along either axis; None if there are none, or of a polygon."""
    row, column = pupil.rim_row, pupil.rim_column
    chosen = np.flatnonzero((row % pupil.y.period < pupil.y.dots) & (column % pupil.x.period < pupil.x.dots))
    if not chosen.size or not has_closed_form(pupil.stop):
        return None
    dots = CutDots.of(pupil, chosen)
    margin_y, margin_x = (
        min(int(min(reach_um / lattice.dot_um, size)) + 2 * lattice.period + 2, size + 1)
        for lattice, size in zip((pupil.y, pupil.x), pupil.whole.shape, strict=True)
    )
    margins = ((margin_y, margin_y), (margin_x, margin_x))
    binary = bool(((pupil.whole == 0) | (pupil.whole == 1)).all())
    whole: NDArray[np.uint8] | Floats
    whole = np.pad(pupil.whole.astype(np.uint8), margins) if binary else np.pad(pupil.whole, margins)
    # Beyond a gutter dots of another cell do not count, so then any clear one makes a difference.
    first = np.zeros((), whole.dtype) if pupil.x.has_gutter or pupil.y.has_gutter else whole[:-1, :-1]
    kind = np.zeros(whole.shape, dtype=np.uint8)
    for j in _NEXT:
        for i in _NEXT:
            other = whole[j : whole.shape[0] - 1 + j, i : whole.shape[1] - 1 + i]
            kind[:-1, :-1] |= (first != other).view(np.uint8) * np.uint8(_UNLIKE)
    for j in _NEXT:
        for i in _NEXT:
            kind[dots.row + margin_y - j, dots.column + margin_x - i] |= _CUT
    spread = float((dots.mean * (dots.transmission - dots.mean)).sum()) * pupil.x.dot_um * pupil.y.dot_um
    return RimLags(pupil.x, pupil.y, dots, whole, kind, (margin_y, margin_x), spread)


def _sifted(matters: NDArray[np.bool_], place: Indices, offset: Indices) -> tuple[Indices, Indices, Indices]:
    """Numbers of lags and of dots whose meeting changes anything, and the flat index at which they meet."""
    rows = max(1, _SIFTED_AT_A_TIME // place.size)
    lags, dots = [], []
    for start in range(0, offset.size, rows):
        lag, dot = np.nonzero(matters[place + offset[start : start + rows, None]])
        lags.append(lag + start)
        dots.append(dot)
    at, dot = np.concatenate(lags), np.concatenate(dots)
    return at, dot, place[dot] + offset[at]


@dataclass(frozen=True, eq=False)
class _Shift:
    """Where lags along one axis take a dot.

    Attributes:
        lattice: along that axis.
        cells, dots: intp [n], whole cells and then whole dots onward.
        edge: float64 [n], the share of a dot at which the part on the interval met first ends.
        limit: most intervals that count; farther on all is dark.
    """

    lattice: Lattice
    cells: Indices
    dots: Indices
    edge: Floats
    limit: int

    @property
    def intervals(self) -> Indices:
        """How many intervals onward lies the interval met first, [n]."""
        return np.asarray(np.clip(self.cells * self.lattice.period + self.dots, -self.limit, self.limit - 1))

    def meets(self, at: Indices, interval: Indices, step: int) -> NDArray[np.bool_]:
        """Whether intervals, moved onward by these lags and a step, are still dots of the cell that is meant."""
        local = interval % self.lattice.period + self.dots[at] + step
        return np.asarray((local >= 0) & (local < self.lattice.dots))

    def part(self, at: Indices, step: int) -> tuple[Floats, Floats]:
        """Which part of a dot, 0 to 1, falls on the interval met first, or on the next."""
        edge = self.edge[at]
        return (edge, np.ones_like(edge)) if step else (np.zeros_like(edge), edge)


def _shifts(lattice: Lattice, lag_um: Floats, limit: int) -> Iterator[_Shift]:
    """One way to move on by lags; with gutters two, by the next smaller and by the next larger cell lag."""
    cell = np.floor(lag_um / lattice.pitch_um) if lattice.has_gutter else np.zeros_like(lag_um)
    for cells in (cell, cell + 1) if lattice.has_gutter else (cell,):
        within = (lag_um - cells * lattice.pitch_um) / lattice.dot_um
        dots = np.floor(within)
        yield _Shift(lattice, cells.astype(np.intp), dots.astype(np.intp), 1 - (within - dots), limit)


@dataclass(frozen=True, eq=False)
class _Meeting:
    """Cut dots that lags move onto dots that matter.

    Attributes:
        rim: whose dots they are.
        along_x, along_y: where the lags take them.
        at, dot, where: intp [n], which lag, which dot, and the flat index of the interval met first.
    """

    rim: RimLags
    along_x: _Shift
    along_y: _Shift
    at: Indices
    dot: Indices
    where: Indices

    def with_whole_um2(self) -> Floats:
        """What shapes change in the overlap with whole dots, for each lag."""
        here, right, above, beyond = (self._transmission(j, i) for j in _NEXT for i in _NEXT)
        dots = self.rim.dots
        total = np.zeros(self.along_x.edge.size)

        weight = here - right - above + beyond
        k = np.flatnonzero(weight)
        at, dot = self.at[k], self.dot[k]
        (share_x, x), (share_y, y) = self._edge(0, k), self._edge(1, k)
        excess = dots.before_um2(dot, x, y) - share_x * share_y * dots.area_um2[dot]
        total += np.bincount(at, weight[k] * dots.transmission[dot] * excess, total.size)

        for weight, axis, part in ((right - beyond, 1, dots.below_um2), (above - beyond, 0, dots.left_of_um2)):
            k = np.flatnonzero(weight)
            at, dot = self.at[k], self.dot[k]
            share, line = self._edge(axis, k)
            excess = part(dot, line) - share * dots.area_um2[dot]
            total += np.bincount(at, weight[k] * dots.transmission[dot] * excess, total.size)
        return total

    def _edge(self, axis: int, k: Indices) -> tuple[Floats, Lines]:
        """Where dots leave the interval met first along x (axis 0) or y, as a share of them and as a line."""
        dots = self.rim.dots
        shift, interval = (self.along_y, dots.row) if axis else (self.along_x, dots.column)
        share = shift.edge[self.at[k]]
        start = shift.lattice.edges_um()[interval[self.dot[k]]]
        return share, lines(dots.stop, axis, start + shift.lattice.dot_um * share)

    def _transmission(self, j: int, i: int) -> Floats:
        """Transmission of the interval met first, or of the next ones along y and x."""
        value = self.rim.whole.ravel()[self.where + (j * self.rim.whole.shape[1] + i)]
        if self.rim.x.has_gutter:
            value = value * self.along_x.meets(self.at, self.rim.dots.column[self.dot], i)
        if self.rim.y.has_gutter:
            value = value * self.along_y.meets(self.at, self.rim.dots.row[self.dot], j)
        return np.asarray(value, dtype=np.float64)

    def with_cut_um2(self, place: Indices, lag_um: Floats) -> Floats:
        """What shapes change in the overlap with cut dots, for each lag.

        Args:
            place: flat index of all cut dots.
            lag_um: float64 [2, n], x first.
        """
        total = np.zeros(lag_um.shape[1])
        near = np.flatnonzero(self.rim.kind.ravel()[self.where] & _CUT)
        for j in _NEXT:
            for i in _NEXT:
                wanted = self.where[near] + (j * self.rim.whole.shape[1] + i)
                other = np.minimum(np.searchsorted(place, wanted), place.size - 1)
                kept = np.flatnonzero(place[other] == wanted)
                total += self._with_cut(near[kept], other[kept], j, i, lag_um)
        return total

    def _with_cut(self, near: Indices, second: Indices, j: int, i: int, lag_um: Floats) -> Floats:
        """The same for pairs of a meeting and a dot that lies j and i intervals on from where it is."""
        dots, x, y = self.rim.dots, self.rim.x, self.rim.y
        at, first = self.at[near], self.dot[near]
        row, column = dots.row[first], dots.column[first]
        ends_x = x.edges_um()[column] + x.dot_um * np.stack(self.along_x.part(at, i))
        ends_y = y.edges_um()[row] + y.dot_um * np.stack(self.along_y.part(at, j))
        shared = shared_area(dots.stop, np.concatenate([ends_x, ends_y]), lag_um[:, at])
        area = (ends_x[1] - ends_x[0]) * (ends_y[1] - ends_y[0])
        clear, mean = dots.transmission, dots.mean
        found = clear[first] * clear[second] * shared - mean[first] * mean[second] * area
        for shift, interval, step in ((self.along_x, column, i), (self.along_y, row, j)):
            if shift.lattice.has_gutter:
                found = found * shift.meets(at, interval, step)
        return np.asarray(np.bincount(at, found, lag_um.shape[1]), dtype=np.float64)
