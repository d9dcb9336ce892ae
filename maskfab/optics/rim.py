"""The shapes of dots that the stop cuts, in the autocorrelation of a pupil: closed forms at every lag.

A stop is a unit disc or a square of side 2 about the origin, stretched along x and y; an annulus is the difference of
two discs. Areas of rectangles inside a stop and its shifted copy are closed forms, and so are the parts of cut dots
left of lines and below others. Stretched so that its half sides are 1, a stop is a unit disc or a square; the dark
middle of an annulus is one more disc, taken away. Cut dots are parted at the axes, and every part is mirrored into the
first quadrant. There the rim y(x) = sqrt(1 - x²) falls, and of a part that begins at l and b

    ∫_l^x clip(y(u), b, y₁) - b du = (y₁ - b)(min(x, x₁) - l) + ∫_{x₁}^{max(x, x₁)} y(u) - b du,    y(x₁) = y₁,

is clear, with ∫_0^x y = (x y(x) + asin x) / 2. Left of and below a point of the disc all is clear; right of and above
one outside it nothing is, so that what two lines leave follows from what either does.

The dots enter the autocorrelation with their mean transmissions, and their shapes add to it. A shifted cut dot meets up
to four whole ones in rectangles, and what of these is clear follows from

    D_i(ξ, η) = clear area of dot i left of ξ and below η, less the mean's share of it,

at the point that the rectangles have in common; where the four are alike, shapes change nothing. Where two cut dots
meet, that part of their rectangle counts which both stops leave. Areas are closed forms, so every lag is exact.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Floats, Indices, Labels, Mask
from maskfab.base.model import Frozen
from maskfab.job.camera import Stop
from maskfab.optics.pupil import Lattice, Pupil

# So many rectangles stay in the fastest cache, and so many rows of dots in the next one.
_AT_A_TIME, _ROWS_AT_A_TIME = 4_096, 16


def apart(stop: Stop, lag_x_um: Floats, lag_y_um: Floats) -> Mask:
    """Whether a stop moved by lags surely shares nothing with itself."""
    width, height = stop.sides_um
    x, y = lag_x_um / width, lag_y_um / height
    return np.asarray(x**2 + y**2 >= 1 if stop.round else np.maximum(abs(x), abs(y)) >= 1)


def shared_area(stop: Stop, box_um: Floats, lag_um: Floats) -> Floats:
    """Area of rectangles inside a stop and inside the stop moved back by a lag.

    Args:
        box_um: float64 [4, n], x0, x1, y0, y1.
        lag_um: float64 [2, n], x, y.
    """
    width, height = stop.sides_um
    unit = np.array([2 / width, 2 / height])
    lag = lag_um * unit[:, None]
    box = box_um * np.repeat(unit, 2)[:, None]
    if not stop.round:
        low = np.maximum(box[::2], np.maximum(-1, -1 - lag))
        high = np.minimum(box[1::2], np.minimum(1, 1 - lag))
        return np.asarray(np.clip(high - low, 0.0, None).prod(axis=0) * (width * height / 4))
    share = stop.inner_share
    pairs = [(1.0, 1.0), (1.0, share), (share, 1.0), (share, share)] if share else [(1.0, 1.0)]
    area = np.zeros(box.shape[1])
    for own, moved in pairs:
        area += (1 if own == moved else -1) * _in_both_discs(box, lag, own, moved)
    return area * (width * height / 4)


def _in_both_discs(box: Floats, lag: Floats, own_radius: float, moved_radius: float) -> Floats:
    """Area of rectangles in a disc about the origin and in one a lag behind, split at their radical axis."""
    area, split = np.empty(box.shape[1]), []
    for start in range(0, area.size, _AT_A_TIME):
        some = slice(start, start + _AT_A_TIME)
        power = _power(lag[:, some], own_radius, moved_radius)
        area[some], is_split = _in_bounding_disc(box[:, some], lag[:, some], power, own_radius, moved_radius)
        split.append(start + np.flatnonzero(is_split))
    if split:
        k = np.concatenate(split)
        power = _power(lag[:, k], own_radius, moved_radius)
        area[k] = _on_the_axis(box[:, k], lag[:, k], power, own_radius, moved_radius)
    return area


def _power(lag: Floats, own_radius: float, moved_radius: float) -> Floats:
    """Half of what the moved circle's power of the origin is over the own one's."""
    power: Floats = ((lag**2).sum(axis=0) + own_radius**2 - moved_radius**2) / 2
    return power


def _in_bounding_disc(
    box: Floats, lag: Floats, power: Floats, own_radius: float, moved_radius: float
) -> tuple[Floats, Mask]:
    """Area of rectangles inside the disc that bounds their middle, and whether the radical axis splits them."""
    height = (box[0] + box[1]) / 2 * lag[0] + (box[2] + box[3]) / 2 * lag[1] + power
    beyond = height >= 0
    radius = np.where(beyond, moved_radius, own_radius)
    area = _in_disc((box + np.repeat(lag * beyond, 2, axis=0)) / radius)
    area *= radius**2
    reach = (abs(lag[0]) * (box[1] - box[0]) + abs(lag[1]) * (box[3] - box[2])) / 2
    return area, abs(height) < reach


def _in_disc(sides: Floats) -> Floats:
    """Area of rectangles [4, n] inside a unit disc: what lies above their bottoms, less what lies above their tops.

    Between the same ends, a line below the axis has as much of the disc below it as its mirror image above.
    """
    lines = np.clip(sides[2:], -1.0, 1.0)
    # No line is at -0.
    lines += 0.0
    chord = _height(lines)
    ends = np.clip(sides[:2, None], -chord, chord)
    integral = _integral(ends)
    beyond = integral[1] - integral[0]
    beyond -= abs(lines) * (ends[1] - ends[0])
    bottom, top = np.copysign(beyond, lines)
    area: Floats = bottom - top
    across = np.flatnonzero((lines[0] < 0) & (lines[1] >= 0))
    left, right = _integral(np.clip(sides[:2, across], -1.0, 1.0))
    area[across] += 2 * (right - left)
    return area


def _height(place: Floats) -> Floats:
    height = 1 - place
    height *= 1 + place
    return np.sqrt(height, out=height)


def _integral(place: Floats) -> Floats:
    """Integral of the height, from 0."""
    integral = _height(place)
    integral *= place
    integral += np.arcsin(place)
    integral *= 0.5
    return integral


def _on_the_axis(box: Floats, lag: Floats, power: Floats, own_radius: float, moved_radius: float) -> Floats:
    """The overlap where the radical axis splits rectangles, into two polygons with a single circle each."""
    return _by_the_axis(box[[0, 1, 1, 0]], box[[2, 2, 3, 3]], lag, power, own_radius, moved_radius)


def _by_the_axis(x: Floats, y: Floats, lag: Floats, power: Floats, own_radius: float, moved_radius: float) -> Floats:
    height = x * lag[0] + y * lag[1] + power
    moved_x, moved_y = _beside(x, y, height, lag)
    moved = _disc_area(moved_x + lag[0], moved_y + lag[1], moved_radius)
    return moved + _disc_area(*_beside(x, y, -height, -lag), own_radius)


def area_in_both_discs(x: Floats, y: Floats, lag: tuple[float, float], hole: float = 0.0) -> Floats:
    """Area of convex polygons inside a unit disc and inside it moved back by a lag, less what its round hole takes.

    Args:
        x, y: float64 [v, n], corners, anticlockwise.
        lag: of the disc that is moved.
        hole: radius of the dark middle of an annulus.
    """
    if lag == (0.0, 0.0):
        return _disc_area(x, y, 1.0) - (_disc_area(x, y, hole) if hole else 0.0)
    both, area = np.array(lag)[:, None], np.zeros(x.shape[1])
    for own, moved in [(1.0, 1.0), (1.0, hole), (hole, 1.0), (hole, hole)] if hole else [(1.0, 1.0)]:
        area += (1 if own == moved else -1) * _by_the_axis(x, y, both, _power(both, own, moved), own, moved)
    return area


def _beside(x: Floats, y: Floats, height: Floats, normal: Floats) -> tuple[Floats, Floats]:
    """Polygons [2 v, n] of corners [v, n] clipped to a half plane: those outside move onto its line."""
    slope = (normal**2).sum(axis=0)
    back = np.minimum(height, 0.0) / slope
    following = _next(height)
    crosses = (height >= 0) != (following >= 0)
    share = height / np.where(crosses, height - following, 1.0)

    def clipped(corner: Floats, along: Floats) -> Floats:
        inside = corner - back * along
        between = np.where(crosses, corner + share * (_next(corner) - corner), inside)
        return np.stack([inside, between], axis=1).reshape(2 * len(corner), -1 if corner.size else 0)

    return clipped(x, normal[0]), clipped(y, normal[1])


def _disc_area(x: Floats, y: Floats, radius: float) -> Floats:
    """Area inside a disc about the origin of polygons [v, n]: over every side, its triangle with the origin."""
    span_x, span_y = _next(x) - x, _next(y) - y
    a, b = span_x**2 + span_y**2, x * span_x + y * span_y
    root2 = b**2 - a * (x**2 + y**2 - radius**2)
    meets = (root2 > 0) & (a > 0)
    root, scale = np.sqrt(np.where(meets, root2, 0.0)), np.where(meets, a, 1.0)
    first, last = (np.where(meets, np.clip((sign * root - b) / scale, 0.0, 1.0), 0.0) for sign in (-1, 1))
    in_x, in_y, out_x, out_y = x + first * span_x, y + first * span_y, x + last * span_x, y + last * span_y
    sectors = _angle(x, y, in_x, in_y) + _angle(out_x, out_y, _next(x), _next(y))
    result: Floats = (radius**2 * sectors + in_x * out_y - in_y * out_x).sum(axis=0) / 2
    return result


def _next(values: Floats) -> Floats:
    return np.concatenate([values[1:], values[:1]])


def _angle(x0: Floats, y0: Floats, x1: Floats, y1: Floats) -> Floats:
    return np.arctan2(x0 * y1 - y0 * x1, x0 * x1 + y0 * y1)


# Whether parts are mirrored along x and along y.
_QUADRANTS = [(False, False), (False, True), (True, False), (True, True)]


@dataclass(frozen=True, eq=False)
class RimParts(Frozen):
    """Parts of cut dots, each in one quadrant of the stop.

    Attributes:
        dot: intp [m], whose part; the first k parts are one of every dot, in order.
        mirrored: int8 [2, m], 1 for parts mirrored along x, and along y.
        table: float64 [8, 2, m]: where the parts lie along either axis, see :class:`_Along`; last, what areas of the
            stretched stop count, and the clear one of each part.
    """

    dot: Indices
    mirrored: Labels
    table: Floats
    round: bool

    @classmethod
    def of(cls, stop: Stop, x_um: Floats, y_um: Floats, transmission: Floats) -> RimParts:
        """Parts of dots [k] between x_um [2, k] and y_um [2, k] that a stop cuts, which is no polygon."""
        discs = [(1.0, 1.0), (stop.inner_share, -1.0)] if stop.inner_share else [(1.0, 1.0)]
        width, height = stop.sides_um
        tables, areas = [], []
        for share, sign in discs:
            weight = sign * share**2 * width * height / 4 * transmission
            ends = np.stack([x_um * (2 / (share * width)), y_um * (2 / (share * height))])
            for mirrored in _QUADRANTS:
                along = _Along.of(stop.round, ends, mirrored)
                area = _Lines.of(along, np.ones(along.start.shape)).before[0]
                tables.append(np.stack([*along, np.stack([weight, weight * area])]))
                areas.append(area)
        dots, area = np.arange(transmission.size), np.stack(areas)
        first = np.argmax(area, axis=0)
        rest = area > 0
        rest[first, dots] = False
        others, other_dots = np.nonzero(rest)
        place, dot = np.concatenate([first, others]), np.concatenate([dots, other_dots])
        mirrors = np.array(_QUADRANTS * len(discs), dtype=np.int8)
        return cls(dot, mirrors[place].T, np.stack(tables, axis=-2)[..., place, dot], stop.round)

    def excess_um2(self, part: Indices, share: Floats, quarters: Labels | Floats) -> Floats:
        """Area that quarters of parts' dots pass if they transmit unlike amounts, less the mean's share of it.

        Args:
            part: intp [n], ascending.
            share: [2, n] where lines across x and across y divide the dots, 0 to 1.
            quarters: [4, n] transmissions of those left and below, right and below, left and above, right and above;
                those of the last are taken to be let through by the whole dot.
        """
        held = slice(part[0], part[-1] + 1)
        count = np.diff(np.searchsorted(part, np.arange(held.start, held.stop + 1)))
        columns = np.repeat(self.table[..., held], count, axis=2)
        weight, clear = columns[-1]
        mirrored = np.repeat(self.mirrored[:, held], count, axis=1)
        here, right, above = quarters[:3] - quarters[3]
        twist = here - right - above
        steps = np.stack([above, right])
        # Mirroring changes sides.
        steps += mirrored[::-1] * twist
        turn = 1 - 2 * mirrored
        steps *= turn
        twist *= turn[0] * turn[1]
        share = abs(share - mirrored)
        lines = _Lines.of(_Along(*columns[:-1]), share)
        sides = lines.before
        sides *= weight
        both = lines.rectangle()
        both *= weight
        if self.round:
            # What lies beyond a corner outside the disc is dark.
            both = np.where(lines.place[1] < lines.height[0], both, sides[0] + sides[1] - clear)
        means = clear * share
        sides -= means
        sides *= steps.astype(np.float64, copy=False)
        both -= share[0] * means[1]
        both *= twist.astype(np.float64, copy=False)
        both += sides[1]
        both += sides[0]
        return both


class _Along(NamedTuple):
    """Where parts lie along x and along y, mirrored into the first quadrant; float64 [2, n] each.

    Attributes:
        start, step: where their dots begin, and the way to the ends.
        low: where the parts begin.
        first, last: where the rim's run through them begins and ends.
        across: how far they reach along the other axis.
        base: what makes the area before a line begin at 0.
    """

    start: Floats
    step: Floats
    low: Floats
    first: Floats
    last: Floats
    across: Floats
    base: Floats

    @classmethod
    def of(cls, is_round: bool, ends: Floats, mirrored: tuple[bool, bool]) -> _Along:
        """Lags of dots that begin and end, float64 [2, 2, k], along x and along y."""
        ends = np.stack([-axis[::-1] if flip else axis for axis, flip in zip(ends, mirrored, strict=True)])
        start = ends[:, 0]
        # Also for dots beyond a disc, whose areas rounding may leave above 0.
        low, high = np.clip(ends, 0, 1).swapaxes(0, 1)
        first, last = (np.clip(_part_height(end[::-1]), low, high) for end in (high, low)) if is_round else (high, high)
        across = (high - low)[::-1]
        base = low[::-1] * first - across * low - _part_integral(first, _part_height(first))
        return cls(start, ends[:, 1] - start, low, first, last, across, base)


class _Lines(NamedTuple):
    """Lines across parts, across x and across y; float64 [2, n] each.

    Attributes:
        low: where the part begins.
        place: of the line, from there on.
        on_rim: the nearest place at which the rim runs through the part.
        height: of the rim there.
        before: what is clear of the part before the line.
    """

    low: Floats
    place: Floats
    on_rim: Floats
    height: Floats
    before: Floats

    @classmethod
    def of(cls, along: _Along, share: Floats) -> _Lines:
        """Lines at shares of mirrored dots."""
        place = share * along.step
        place += along.start
        np.maximum(place, along.low, out=place)
        on_rim = np.maximum(place, along.first)
        np.minimum(on_rim, along.last, out=on_rim)
        height = _part_height(on_rim)
        before = np.minimum(place, along.first)
        before *= along.across
        before += _part_integral(on_rim, height)
        before -= along.low[::-1] * on_rim
        before += along.base
        return cls(along.low, place, on_rim, height, before)

    def rectangle(self) -> Floats:
        """Area of the rectangle before lines across both axes, as far as the rim runs."""
        sides = np.minimum(self.place, self.on_rim)
        sides -= self.low
        return np.asarray(sides[0] * sides[1])


def _part_height(place: Floats) -> Floats:
    height = place * place
    np.subtract(1, height, out=height)
    return np.sqrt(height, out=height)


def _part_integral(place: Floats, height: Floats) -> Floats:
    """Integral of the rim's height, from 0."""
    integral = np.arcsin(place)
    integral += place * height
    integral *= 0.5
    return integral


# Pairs of a lag and a part of a cut dot: so many are sifted at a time, in the fastest cache, for those that matter, and
# so many of these looked at.
_PAIRS_AT_A_TIME, _SIFTED_AT_A_TIME, _MET_AT_A_TIME = 400_000, 16_384, 8_192
_UNLIKE, _NEAR_CUT, _CUT = 1, 2, 4
# From an interval to itself, the next ones along x, along y, and both; and the bit that tells of the first.
_QUARTERS = [(0, 0), (0, 1), (1, 0), (1, 1)]
_FIRST_CLEAR_BIT = 3


@dataclass(frozen=True, eq=False)
class RimLags(Frozen):
    """The cut dots of a pupil, as a correction of the autocorrelation of mean transmissions.

    Attributes:
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

    @property
    def stop(self) -> Stop:
        return self.dots.stop

    @property
    def cut_dots(self) -> int:
        """Their number."""
        return self.dots.row.size

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
                        pairs = _sifted(self.kind.ravel(), place_of_part, along_y.intervals * width + along_x.intervals)
                        meeting = _Meeting(self, along_x, along_y, *pairs)
                        for some in meeting.few_at_a_time():
                            total[part] += some.with_whole_um2()
                        if sign > 0:
                            total[part] += meeting.with_cut_um2(place, lag)
        return total

    def transmissions(self, where: Indices) -> Labels | Floats:
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
    # Circles, rings, ellipses and rectangles have closed forms, polygons have none.
    if not chosen.size or pupil.stop.outline_um:
        return None
    dots = CutDots.of(pupil, chosen)
    margin_y, margin_x = (
        min(int(min(reach_um / lattice.dot_um, size)) + 2 * lattice.period + 2, size + 1)
        for lattice, size in zip((pupil.y, pupil.x), pupil.whole.shape, strict=True)
    )
    rows, columns = pupil.whole.shape
    bits = _bits(pupil.whole)
    binary, whole = bits is not None, np.pad(pupil.whole, 1) if bits is None else bits
    kind = np.zeros((rows + 2 * margin_y, columns + 2 * margin_x), dtype=np.uint8)
    for start in range(0, rows + 1, _ROWS_AT_A_TIME):
        some = whole[start : start + _ROWS_AT_A_TIME + 1]
        about = kind[margin_y - 1 + start :, margin_x - 1 : margin_x + columns][: len(some) - 1]
        # Beyond a gutter dots of another cell do not count, so then any clear one makes a difference.
        first = np.zeros((), whole.dtype) if pupil.x.has_gutter or pupil.y.has_gutter else some[:-1, :-1]
        for bit, (j, i) in enumerate(_QUARTERS, _FIRST_CLEAR_BIT):
            other = some[j : len(some) - 1 + j, i : columns + 1 + i]
            about |= (first != other).view(np.uint8) * np.uint8(_UNLIKE)
            if binary:
                about |= other.astype(np.uint8, copy=False) << np.uint8(bit)
    for j, i in _QUARTERS:
        kind[dots.row + margin_y - j, dots.column + margin_x - i] |= _NEAR_CUT
    kind[dots.row + margin_y, dots.column + margin_x] |= _CUT
    kind.flags.writeable = whole.flags.writeable = False
    spread = float((dots.mean * (dots.transmission - dots.mean)).sum()) * pupil.x.dot_um * pupil.y.dot_um
    grey = None if binary else whole.astype(np.float64, copy=False)
    return RimLags(pupil.x, pupil.y, dots, kind, grey, (margin_y, margin_x), spread)


def _bits(whole: Floats) -> NDArray[np.uint8] | None:
    """Ones where dots are clear, in a margin of one zero, [ny + 2, nx + 2]; None if some are neither clear nor dark."""
    bits = np.zeros((whole.shape[0] + 2, whole.shape[1] + 2), dtype=np.uint8)
    for start in range(0, len(whole), _ROWS_AT_A_TIME):
        some = whole[start : start + _ROWS_AT_A_TIME]
        clear = some == 1
        if np.count_nonzero(clear) != np.count_nonzero(some != 0):
            return None
        bits[start + 1 : start + 1 + len(some), 1:-1] = clear
    return bits


def _sifted(
    kind: NDArray[np.uint8], place: Indices, offset: Indices
) -> tuple[Indices, Indices, Indices, NDArray[np.uint8]]:
    """Numbers of lags and of parts, ascending, whose meeting changes anything, its flat index and kind."""
    rows = max(1, _SIFTED_AT_A_TIME // offset.size)
    pairs, places, kinds = [], [], []
    for start in range(0, place.size, rows):
        where = (place[start : start + rows, None] + offset).ravel()
        met = kind.take(where)
        meeting = np.flatnonzero(met & (_UNLIKE | _NEAR_CUT) != 0)
        pairs.append(meeting + start * offset.size)
        places.append(where.take(meeting))
        kinds.append(met.take(meeting))
    pair = np.concatenate(pairs)
    ends = np.searchsorted(pair, offset.size * np.arange(place.size + 1))
    part = np.repeat(np.arange(place.size), np.diff(ends))
    return pair - offset.size * part, part, np.concatenate(places), np.concatenate(kinds)


@dataclass(frozen=True, eq=False)
class _Shift:
    """Where lags along one axis take a dot.

    Attributes:
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

    def meets(self, at: Indices, interval: Indices, which: Indices, step: int | Indices) -> Mask:
        """Whether ``which`` of the intervals, moved onward by lags and a step, are still dots of the cell meant."""
        local = (interval % self.lattice.period).take(which) + self.dots.take(at) + step
        # Below 0 it is a large number.
        return np.asarray(local.view(np.uintp) < self.lattice.dots)


def _shifts(lattice: Lattice, lag_um: Floats, limit: int) -> Iterator[_Shift]:
    """One way to move on by lags; with gutters two, by the next smaller and by the next larger cell lag."""
    cell = np.floor(lag_um / lattice.pitch_um) if lattice.has_gutter else np.zeros_like(lag_um)
    for cells in (cell, cell + 1) if lattice.has_gutter else (cell,):
        within = (lag_um - cells * lattice.pitch_um) / lattice.dot_um
        dots = np.floor(within)
        yield _Shift(lattice, cells.astype(np.intp), dots.astype(np.intp), 1 - (within - dots), limit)


@dataclass(frozen=True, eq=False)
class _Meeting:
    """Parts of cut dots that lags move onto dots that matter: lag, part (ascending), index and kind of interval."""

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

    def _quarters(self) -> Labels | Floats:
        """Transmissions [4, n] of the intervals met first, and of the next ones along x, along y and both."""
        values, dots = self.rim.transmissions(self.where), self.rim.dots
        for step, shift, interval in ((1, self.along_x, dots.column), (0, self.along_y, dots.row)):
            if shift.lattice.has_gutter:
                which = dots.parts.dot.take(self.part)
                here, onward = (shift.meets(self.at, interval, which, k) for k in (0, 1))
                values *= np.stack([onward if way[step] else here for way in _QUARTERS])
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
                meant &= shift.meets(at, interval, first, step)
        shared = shared_area(dots.stop, np.stack(box), lag_um[:, at])
        area = (box[1] - box[0]) * (box[3] - box[2])
        excess = clear[first] * clear[second] * shared - mean[first] * mean[second] * area
        return np.asarray(np.bincount(at, excess * meant, lag_um.shape[1]), dtype=np.float64)
