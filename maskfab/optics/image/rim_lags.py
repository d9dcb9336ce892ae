r"""Contribution of the shapes of cut dots to an autocorrelation into which they enter with their mean transmissions.

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

from maskfab.base.arrays import Floats, Indices
from maskfab.model import Stop, frozen
from maskfab.optics.image.overlap import has_closed_form, shared_area
from maskfab.optics.image.rim_parts import RimParts
from maskfab.optics.pupil.aperture import Lattice
from maskfab.optics.pupil.pupil import Pupil

# Pairs of a lag and a part of a cut dot: so many are sifted at a time, in the fastest cache, for those that matter, and
# so many of these looked at.
_PAIRS_AT_A_TIME, _SIFTED_AT_A_TIME, _MET_AT_A_TIME = 400_000, 16_384, 8_192
_UNLIKE, _NEAR_CUT, _CUT = 1, 2, 4
# From an interval to itself, the next ones along x, along y, and both; and the bit that tells of the first.
_QUARTERS = [(0, 0), (0, 1), (1, 0), (1, 1)]
_FIRST_CLEAR_BIT = 3


@dataclass(frozen=True, eq=False)
class RimLags:
    """The cut dots of a pupil, as a correction of the autocorrelation of mean transmissions.

    Attributes:
        x, y: the pupil's lattices.
        dots: the cut dots.
        kind: uint8 [ny, nx], what of an interval and the next ones along x and y a bit each tells: whether they are
            unlike, whether one of them is cut, and whether the first is; and in a binary mask which ones are whole and
            clear. 0 in a margin as wide as lags reach.
        grey: float64, transmission of what the stop leaves whole, in a margin of one dark interval, if not binary.
        margin: of ``kind``, intervals on either side along y and along x.
        spread_um2: what the means lack at lag 0, and the table has been given there.
    """

    x: Lattice
    y: Lattice
    dots: CutDots
    kind: NDArray[np.uint8]
    grey: Floats | None
    margin: tuple[int, int]
    spread_um2: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "kind", frozen(self.kind))
        if self.grey is not None:
            object.__setattr__(self, "grey", frozen(self.grey))

    def correction_um2(self, lag_x_um: Floats, lag_y_um: Floats) -> Floats:
        """Correction to a table of means, given its due at lag 0, at lags [n], in square micrometres."""
        total = self._correction_um2(lag_x_um, lag_y_um)
        # Between lag 0 and the next ones the table is linear.
        at_zero = np.clip(1 - abs(lag_x_um) / self.x.dot_um, 0, None) * np.clip(
            1 - abs(lag_y_um) / self.y.dot_um, 0, None
        )
        return np.asarray(total - self.spread_um2 * at_zero)

    def _correction_um2(self, lag_x_um: Floats, lag_y_um: Floats) -> Floats:
        total = np.zeros(lag_x_um.size)
        width = self.kind.shape[1]
        place = (self.dots.row + self.margin[0]) * width + self.dots.column + self.margin[1]
        place_of_part = place[self.dots.parts.dot]
        batch = max(1, _PAIRS_AT_A_TIME // place_of_part.size)
        for start in range(0, lag_x_um.size, batch):
            part = slice(start, start + batch)
            # A dot meets those ahead of it and those behind; two cut dots are counted once.
            for sign in (1.0, -1.0):
                lag = sign * np.stack([lag_x_um[part], lag_y_um[part]])
                for along_y in _shifts(self.y, lag[1], self.margin[0]):
                    for along_x in _shifts(self.x, lag[0], self.margin[1]):
                        found = _sifted(self.kind.ravel(), place_of_part, along_y.intervals * width + along_x.intervals)
                        meeting = _Meeting(self, along_x, along_y, *found)
                        for some in meeting.few_at_a_time():
                            total[part] += some.with_whole_um2()
                        if sign > 0:
                            total[part] += meeting.with_cut_um2(place, lag)
        return total

    def transmissions(self, where: Indices) -> NDArray[np.int8] | Floats:
        """Of intervals at flat indices [n] of ``kind``, where it is not 0, and the next ones along x, along y and both.

        Returns:
            [4, n].
        """
        if self.grey is None:
            bits = np.arange(_FIRST_CLEAR_BIT, _FIRST_CLEAR_BIT + len(_QUARTERS), dtype=np.uint8)
            return (self.kind.take(where) >> bits[:, None] & 1).view(np.int8)
        (above, before), across, wide = self.margin, self.grey.shape[1], self.kind.shape[1]
        first = where - where // wide * (wide - across) - ((above - 1) * across + before - 1)
        return np.stack([self.grey.take(first + (j * across + i)) for j, i in _QUARTERS])


@dataclass(frozen=True, eq=False)
class CutDots:
    """Dots that a stop cuts, and how it does.

    Attributes:
        row, column: intp [k], intervals, row by row.
        transmission, mean: float64 [k], amplitude, and its mean over what the stop leaves and takes.
        start_um: float64 [2, k], where they begin along x and y.
        stop: the lens stop.
        parts: of the dots, in the quadrants of the stop.
    """

    row: Indices
    column: Indices
    transmission: Floats
    mean: Floats
    start_um: Floats
    stop: Stop
    parts: RimParts

    @classmethod
    def of(cls, pupil: Pupil, chosen: Indices) -> CutDots:
        row, column, transmission = pupil.rim_row[chosen], pupil.rim_column[chosen], pupil.rim_transmission[chosen]
        x, y = (
            np.stack([edges[at], edges[at + 1]])
            for edges, at in ((pupil.x.edges_um(), column), (pupil.y.edges_um(), row))
        )
        parts = RimParts.of(pupil.stop, x, y, transmission)
        mean = pupil.rim_moments[chosen, 0, 0]
        return cls(row, column, transmission, mean, np.stack([x[0], y[0]]), pupil.stop, parts)


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
    binary = bool(((pupil.whole == 0) | (pupil.whole == 1)).all())
    whole = np.pad(pupil.whole.astype(np.uint8) if binary else pupil.whole, 1)
    # Beyond a gutter dots of another cell do not count, so then any clear one makes a difference.
    first = np.zeros((), whole.dtype) if pupil.x.has_gutter or pupil.y.has_gutter else whole[:-1, :-1]
    rows, columns = pupil.whole.shape
    kind = np.zeros((rows + 2 * margin_y, columns + 2 * margin_x), dtype=np.uint8)
    about = kind[margin_y - 1 : margin_y + rows, margin_x - 1 : margin_x + columns]
    for bit, (j, i) in enumerate(_QUARTERS, _FIRST_CLEAR_BIT):
        other = whole[j : rows + 1 + j, i : columns + 1 + i]
        about |= (first != other).view(np.uint8) * np.uint8(_UNLIKE)
        if binary:
            about |= other.astype(np.uint8) << np.uint8(bit)
    for j, i in _QUARTERS:
        kind[dots.row + margin_y - j, dots.column + margin_x - i] |= _NEAR_CUT
    kind[dots.row + margin_y, dots.column + margin_x] |= _CUT
    kind.flags.writeable = whole.flags.writeable = False
    spread = float((dots.mean * (dots.transmission - dots.mean)).sum()) * pupil.x.dot_um * pupil.y.dot_um
    grey = None if binary else whole.astype(np.float64, copy=False)
    return RimLags(pupil.x, pupil.y, dots, kind, grey, (margin_y, margin_x), spread)


def _sifted(
    kind: NDArray[np.uint8], place: Indices, offset: Indices
) -> tuple[Indices, Indices, Indices, NDArray[np.uint8]]:
    """Numbers of lags and of parts, ascending, whose meeting changes anything, its flat index and kind."""
    rows = max(1, _SIFTED_AT_A_TIME // offset.size)
    pairs, places, kinds = [], [], []
    for start in range(0, place.size, rows):
        where = (place[start : start + rows, None] + offset).ravel()
        met = kind.take(where)
        found = np.flatnonzero(met & (_UNLIKE | _NEAR_CUT) != 0)
        pairs.append(found + start * offset.size)
        places.append(where.take(found))
        kinds.append(met.take(found))
    pair = np.concatenate(pairs)
    ends = np.searchsorted(pair, offset.size * np.arange(place.size + 1))
    part = np.repeat(np.arange(place.size), np.diff(ends))
    return pair - offset.size * part, part, np.concatenate(places), np.concatenate(kinds)


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
        """Number of intervals from each one onward to the interval met first, [n]."""
        return np.asarray(np.clip(self.cells * self.lattice.period + self.dots, -self.limit, self.limit - 1))

    def meets(self, at: Indices, interval: Indices, step: int | Indices) -> NDArray[np.bool_]:
        """Whether intervals, moved onward by these lags and a step, are still dots of the cell that is meant."""
        local = interval % self.lattice.period + self.dots[at] + step
        return np.asarray((local >= 0) & (local < self.lattice.dots))


def _shifts(lattice: Lattice, lag_um: Floats, limit: int) -> Iterator[_Shift]:
    """One way to move on by lags; with gutters two, by the next smaller and by the next larger cell lag."""
    cell = np.floor(lag_um / lattice.pitch_um) if lattice.has_gutter else np.zeros_like(lag_um)
    for cells in (cell, cell + 1) if lattice.has_gutter else (cell,):
        within = (lag_um - cells * lattice.pitch_um) / lattice.dot_um
        dots = np.floor(within)
        yield _Shift(lattice, cells.astype(np.intp), dots.astype(np.intp), 1 - (within - dots), limit)


@dataclass(frozen=True, eq=False)
class _Meeting:
    """Parts of cut dots that lags move onto dots that matter.

    Attributes:
        rim: whose dots they are.
        along_x, along_y: where the lags take them.
        at, part, where: intp [n], which lag, which part, ascending, and the flat index of the interval met first.
        kind: uint8 [n], of that interval.
    """

    rim: RimLags
    along_x: _Shift
    along_y: _Shift
    at: Indices
    part: Indices
    where: Indices
    kind: NDArray[np.uint8]

    def few_at_a_time(self) -> Iterator[_Meeting]:
        """The meetings, so few at a time that they stay in the fastest cache."""
        for start in range(0, self.at.size, _MET_AT_A_TIME):
            some = slice(start, start + _MET_AT_A_TIME)
            yield _Meeting(
                self.rim, self.along_x, self.along_y,
                self.at[some], self.part[some], self.where[some], self.kind[some],
            )  # fmt: skip

    def with_whole_um2(self) -> Floats:
        """Change of the overlap with whole dots by shapes, for each lag."""
        share = np.stack([self.along_x.edge, self.along_y.edge]).take(self.at, axis=1)
        excess = self.rim.dots.parts.excess_um2(self.part, share, self._quarters())
        return np.asarray(np.bincount(self.at, excess, self.along_x.edge.size), dtype=np.float64)

    def _quarters(self) -> NDArray[np.int8] | Floats:
        """Transmissions [4, n] of the intervals met first, and of the next ones along x, along y and both."""
        values, dots = self.rim.transmissions(self.where), self.rim.dots
        for step, shift, interval in ((1, self.along_x, dots.column), (0, self.along_y, dots.row)):
            if shift.lattice.has_gutter:
                met = interval.take(dots.parts.dot.take(self.part))
                values *= np.stack([shift.meets(self.at, met, way[step]) for way in _QUARTERS])
        return values

    def with_cut_um2(self, place: Indices, lag_um: Floats) -> Floats:
        """Change of the overlap with cut dots by shapes, for each lag.

        Args:
            place: flat index of all cut dots.
            lag_um: float64 [2, n], x first.
        """
        near = np.flatnonzero((self.kind & _NEAR_CUT > 0) & (self.part < place.size))
        j, i = np.array(_QUARTERS).T
        met = self.where[near] + (j * self.rim.kind.shape[1] + i)[:, None]
        way, k = np.nonzero(self.rim.kind.take(met) & _CUT)
        return self._with_cut(near[k], np.searchsorted(place, met[way, k]), j[way], i[way], lag_um)

    def _with_cut(self, near: Indices, second: Indices, j: Indices, i: Indices, lag_um: Floats) -> Floats:
        """Change of the overlap for pairs of a meeting and a dot that lies j and i intervals on from where it is."""
        dots = self.rim.dots
        at, first = self.at[near], self.part[near]
        clear, mean = dots.transmission, dots.mean
        box, meant = [], np.ones(at.size, dtype=np.bool_)
        for shift, start, interval, step in (
            (self.along_x, dots.start_um[0], dots.column, i), (self.along_y, dots.start_um[1], dots.row, j)
        ):  # fmt: skip
            edge = shift.edge[at]
            box += [start[first] + shift.lattice.dot_um * end for end in (edge * step, np.where(step, 1.0, edge))]
            if shift.lattice.has_gutter:
                meant &= shift.meets(at, interval[first], step)
        shared = shared_area(dots.stop, np.stack(box), lag_um[:, at])
        area = (box[1] - box[0]) * (box[3] - box[2])
        found = clear[first] * clear[second] * shared - mean[first] * mean[second] * area
        return np.asarray(np.bincount(at, found * meant, lag_um.shape[1]), dtype=np.float64)
