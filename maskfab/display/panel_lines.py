"""Lines across a whole panel, each within a pixel of its own: drawn through its cells, or proved not to pass.

The middle of a line keeps half a line and the clearance from every opening, a line and a space from the next line, in
the Chebyshev sense. Lines of one metal do not cross, so they keep their order, and one that lies as far to one side as
it can leaves the others all the room that there is: from the last line to the first, each is laid as far to the last
side as openings, its pixels and the line after it allow (F. M. Maley, Single-Layer Wire Routing and Compaction, 1990).
If all are found, each is then laid as straight as it goes between the line before and that utmost.

Lines run on from row to row and never turn back. Across, they may lie at any nanometre; along, the panel is cut into
slabs at every edge that matters and no thicker than a third of a lane, within which a line is straight.

A proof that lines cannot cross is a chain of openings from flank to flank that lets too few of them pass: between two
openings a gap d holds at most (d + space - 2 clearance) / (line + space) of them, and lines that keep to some pixels
across all pass every chain of openings from one side of these to the other, wherever it runs (a cut of a single-layer
routing, Maley).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise, product
from typing import Literal

import numpy as np
import scipy
from klayout import db

from maskfab.base.arrays import Ints, Labels, Mask
from maskfab.base.model import Panel, Point, side_by_side
from maskfab.base.units import NM_PER_UM
from maskfab.display.emitter_rules import Certificate, Proof
from maskfab.display.pixel_lines import WireRules

Axis = Literal["x", "y"]

AXES: tuple[Axis, Axis] = ("x", "y")

_SLABS_PER_LANE = 3


@dataclass(frozen=True, eq=False)
class PanelLines:
    """Lines of one metal across a panel.

    Attributes:
        paths: the middles of the lines in order, corner by corner from border to border, nanometres from the panel's
            lower left corner; none if not all of them were found.
        kept: whether they came with the program and were proved again; no search found them.
    """

    axis: Axis
    paths: tuple[tuple[Point, ...], ...]
    kept: bool = False

    @classmethod
    def of_corners(cls, axis: Axis, corners: Ints, kept: bool = False) -> PanelLines:
        """Lines of their :attr:`corners`."""
        begins = np.flatnonzero(np.diff(corners[:, 0])) + 1
        return cls(axis, tuple(tuple(map(tuple, path.tolist())) for path in np.split(corners[:, 1:], begins)), kept)

    @property
    def corners(self) -> Ints:
        """Number of its line, x and y of every corner, int64 [n, 3]."""
        numbers = np.repeat(np.arange(len(self.paths)), [len(path) for path in self.paths])
        return np.column_stack([numbers, np.concatenate(self.paths)])

    def polygons(self, width_nm: int) -> list[db.Polygon]:
        """Outlines of the lines."""
        return [db.Path([db.Point(*corner) for corner in path], width_nm).polygon() for path in self.paths]


def panel_lines(panel: Panel, rules: WireRules, count: int, axis: Axis) -> PanelLines:
    """``count`` lines along an axis for every pixel across, through the panel's own cells.

    A line's metal stays within its own pixel and the next to either side; beyond the panel nothing is open.
    """
    field = _Field.of(panel, rules, axis)
    if not field.low.size:
        return PanelLines(axis, ())
    half, pitch = rules.line_nm // 2, field.pitch_nm
    pixels = np.repeat(np.arange(field.pixels), count).tolist()
    utmost: list[tuple[Ints, Ints]] = []
    way = field.begins[1:] - 1
    limit = np.full(field.band.size, pitch * (field.pixels + 2), dtype=np.int64)
    for pixel in reversed(pixels):
        limit = np.minimum(limit, pitch * (pixel + 2) - half)
        found = field.way(way, limit, 1)
        if found is None:
            return PanelLines(axis, ())
        way = found
        limit = np.minimum(field.high[way][field.band], limit)
        if limit.min() < pitch * (pixel - 1) + half:
            return PanelLines(axis, ())
        utmost.append((way, limit))
        limit = field.beside(limit, -1)
    paths = []
    way, limit = field.begins[:-1], np.full(field.band.size, -pitch, dtype=np.int64)
    for number, pixel in enumerate(pixels):
        limit = np.maximum(limit, pitch * (pixel - 1) + half)
        found = field.way(way, limit, -1)
        assert found is not None, "the utmost is a way itself"
        way = found
        wished = pitch * pixel + pitch * (2 * (number % count) + 1) // (2 * count)
        turns, places = field.straight((way, np.maximum(field.low[way][field.band], limit)), utmost.pop(), wished)
        paths.append(_corners(turns, places, field.cuts, axis))
        limit = field.beside(np.repeat(places, np.diff(turns, append=limit.size)), 1)
    return PanelLines(axis, tuple(paths))


def in_their_pixels(lines: PanelLines, panel: Panel, rules: WireRules, count: int) -> bool:
    """Whether there are ``count`` lines for every pixel across, each from border to border without turning back, with
    its metal within its own pixel and the next to either side."""
    upright = lines.axis == "y"
    (beside, end), half, pitch = panel.size_nm[:: 1 if upright else -1], rules.line_nm // 2, panel.pitch_nm
    if len(lines.paths) != count * (beside // pitch) or not all(lines.paths):
        return False
    number, across, along = lines.corners[:, (0, 1, 2) if upright else (0, 2, 1)].T
    pixel, step = number // count, np.diff(number)
    on, over = np.diff(along)[step == 0], np.diff(across)[step == 0]
    first, last = np.append(1, step) > 0, np.append(step, 1) > 0
    return bool(
        (along[first] == 0).all()
        and (along[last] == end).all()
        and (on >= 0).all()
        and ((on == 0) | (over == 0)).all()
        and (across - half >= pitch * (pixel - 1)).all()
        and (across + half <= pitch * (pixel + 2)).all()
    )


@dataclass(frozen=True, eq=False)
class _Field:
    """A panel as lines along one axis see it: slabs across them, and in each where their middle may lie.

    Slabs that follow each other and are free alike make a band. A line goes on from a stretch of a band to any that it
    meets in the next: there it may lie where either lets it. Stretches on no way from end to end are left out, so that
    every one between two ways lies on a third, between them.

    Attributes:
        low, high: int64 [n] stretches, band by band and in order across, both ends included.
        begins: int64 [bands + 1] where the stretches of a band begin.
        band: int64 [slabs] of every slab.
        cuts: int64 [slabs + 1] where slabs begin and end along the lines.
    """

    low: Ints
    high: Ints
    begins: Ints
    band: Ints
    cuts: Ints
    pixels: int
    pitch_nm: int
    rules: WireRules

    @classmethod
    def of(cls, panel: Panel, rules: WireRules, axis: Axis) -> _Field:
        clear = side_by_side(panel.patterns[panel.orientations])
        upright = clear if axis == "y" else clear.T
        along, across = (_dot_edges(panel, side) for side in upright.shape)
        ends_nm = [side // panel.opening.dots * panel.pitch_nm for side in upright.shape]
        reach = rules.line_nm // 2 + rules.clearance_nm
        cuts = _cuts(along, panel.dot_nm, ends_nm[0], reach, rules.line_nm + rules.space_nm)
        # Where dots whose reach a slab lies in are open, eight dots to a byte.
        first = np.searchsorted(along + panel.dot_nm + reach, cuts[:-1], side="right")
        last = np.searchsorted(along - reach, cuts[1:], side="left")
        rows = np.packbits(np.pad(upright, ((0, 1), (0, 0))), axis=1)
        near = np.bitwise_or.reduceat(rows, np.stack((first, np.maximum(last, first)), axis=1).ravel(), axis=0)[::2]
        near[last <= first] = 0
        fresh = np.append(True, (near[1:] != near[:-1]).any(axis=1))
        shut = np.pad(np.unpackbits(near[fresh], axis=1, count=across.size), ((0, 0), (1, 1)), constant_values=1)
        # A pixel beyond the panel the first and the last stretch end, as at openings.
        least, most = -panel.pitch_nm, ends_nm[1] + panel.pitch_nm
        begins = np.concatenate(([least], across - reach, [most]))
        ends = np.concatenate(([least], across + panel.dot_nm + reach, [most]))
        band, dot = np.nonzero(shut)
        low, high = ends[dot[:-1]], begins[dot[1:]]
        kept = (band[:-1] == band[1:]) & (low <= high)
        low, high, band = low[kept], high[kept], band[:-1][kept]
        bands = np.arange(fresh.sum() + 1)
        used = _used(*_met(low, high, band), (band == 0, band == bands[-2]))
        return cls(
            low[used],
            high[used],
            np.searchsorted(band[used], bands),
            np.cumsum(fresh) - 1,
            cuts,
            ends_nm[1] // panel.pitch_nm,
            panel.pitch_nm,
            rules,
        )

    def way(self, within: Ints, limit: Ints, side: Literal[1, -1]) -> Ints | None:
        """The stretches, band by band, of the way that lies farthest to a side; None if some band has none left for it.

        Args:
            within: int64 [bands] stretches that it does not pass on that side.
            limit: int64 [slabs] places that it does not pass there.
        """
        near, nearest = (self.low, np.minimum) if side > 0 else (self.high, np.maximum)
        limits, way = nearest.reduceat(limit, self._slabs), within
        while (beyond := side * (near[way] - limits) > 0).any():
            way = way - side * beyond
            if (way < self.begins[:-1]).any() or (way >= self.begins[1:]).any():
                return None
        # Farther than where the band before leads are dead ends, and farther than where the one after does, too.
        forth, back = self._ahead[side], self._before[side]
        return _led(_led(way, forth, side)[::-1], back, side)[::-1]

    def straight(self, lowest: tuple[Ints, Ints], highest: tuple[Ints, Ints], wished: int) -> tuple[Ints, Ints]:
        """A line between two ways that is near a place, and moves only where it must.

        Args:
            lowest, highest: int64 [bands] stretches of the two, and int64 [slabs] the farthest that the line may lie.

        Returns:
            The slabs from which on it lies elsewhere, and where, int64 [turns] each.
        """
        (one, low), (other, high) = lowest, highest
        several = one != other
        # Slabs in a row that leave it one and the same room are looked at together.
        fresh = np.append(True, (low[1:] != low[:-1]) | (high[1:] != high[:-1]))
        fresh[self._slabs[several | np.append(False, several[:-1])]] = True
        starts = np.flatnonzero(fresh)
        band = self.band[np.append(starts[1:], low.size) - 1]
        rooms = zip(*(of.tolist() for of in (starts, one[band], other[band], low[starts], high[starts])), strict=True)
        lows, highs, nearest, farthest = self._lists
        turns, places, came, at = [0], [], 0, -1
        least, most = int(low.min()), int(high.max())
        for here, first, last, start, end in rooms:
            if first == last:
                at = first
            elif at < first:
                # Comparisons take a third of the time of min and max, and this is most of a search's.
                near, far = nearest[at], farthest[at]
                near, far = first if near < first else near, last if far > last else far
                at = near
                if near < far:
                    led = range(near, far + 1)
                    ends = [(start if it == first else lows[it], end if it == last else highs[it], it) for it in led]
                    at = _chosen(ends, least, most, wished)
            low_here = start if at == first else lows[at]
            high_here = end if at == last else highs[at]
            if low_here <= most and high_here >= least:
                least = low_here if low_here > least else least
                most = high_here if high_here < most else most
                continue
            goes = 1 if low_here > most else -1
            # A line that came from where it goes back to went no farther than it had to.
            places.append(min(max(wished, least), most) if came in (0, goes) else most if goes > 0 else least)
            turns.append(here)
            least, most, came = low_here, high_here, goes
        places.append(min(max(wished, least), most))
        return np.array(turns), np.array(places)

    def beside(self, across: Ints, side: Literal[1, -1]) -> Ints:
        """The nearest that the next line on a side may come to a line, slab by slab."""
        farther = np.maximum if side > 0 else np.minimum
        begin, end, levels = self._near
        # Level by level the farthest of 1, 2, 4 ... slabs in a row; two of such cover all that are near.
        farthest = np.empty((levels, across.size), dtype=np.int64)
        farthest[:] = across
        for level in range(1, levels):
            step, last = 1 << level - 1, farthest[level - 1]
            farther(last[:-step], last[step:], out=farthest[level, :-step])
        lane = self.rules.line_nm + self.rules.space_nm
        return np.asarray(farther(farthest.ravel()[begin], farthest.ravel()[end]) + side * lane)

    @cached_property
    def _near(self) -> tuple[Ints, Ints, int]:
        """Two places that cover the slabs less than a lane away from every one, in a table of 1, 2, 4 ... in a row."""
        lane = self.rules.line_nm + self.rules.space_nm
        first = np.searchsorted(self.cuts[1:], self.cuts[:-1] - lane, side="right")
        after = np.searchsorted(self.cuts[:-1], self.cuts[1:] + lane, side="left")
        level = np.frexp(after - first)[1] - 1
        row = level * self.band.size
        return row + first, row + after - (1 << level), int(level.max()) + 1

    @cached_property
    def _slabs(self) -> Ints:
        return np.searchsorted(self.band, np.arange(self.begins.size - 1))

    @cached_property
    def _lists(self) -> tuple[list[int], ...]:
        """Ends of every stretch, and the first and last that it meets next; the last leads to all of the first band."""
        lists = self.low, self.high, np.append(self._ahead[-1], 0), np.append(self._ahead[1], self.low.size)
        return tuple(each.tolist() for each in lists)

    @cached_property
    def _ahead(self) -> dict[int, Ints]:
        """Stretches farthest to either side among those that every one meets in the next band."""
        first, after = _met(self.low, self.high, np.repeat(np.arange(self.begins.size - 1), np.diff(self.begins)))
        return {-1: first, 1: after - 1}

    @cached_property
    def _before(self) -> dict[int, Ints]:
        """Stretches farthest to either side among those that every one meets in the band before."""
        every = np.arange(self.low.size)
        ahead = self._ahead
        return {-1: np.searchsorted(ahead[1], every), 1: np.searchsorted(ahead[-1], every, side="right") - 1}


def _met(low: Ints, high: Ints, band: Ints) -> tuple[Ints, Ints]:
    """First of the stretches that every one meets in the next band, which stand in a row, and the one after them."""
    least = low.min(initial=0)
    step = int(high.max(initial=0) - least) + 1
    start, end = (band * step + across - least for across in (low, high))
    return np.searchsorted(end, start + step, side="left"), np.searchsorted(start, end + step, side="right")


def _used(begin: Ints, after: Ints, ends: tuple[Mask, Mask]) -> Mask:
    """Stretches on a way from one end to the other, from those that each leads to."""
    many = np.maximum(after - begin, 0)
    tail = np.repeat(np.arange(many.size), many)
    head = np.repeat(begin - (np.cumsum(many) - many), many) + np.arange(many.sum())
    used = np.ones(many.size, dtype=np.bool_)
    for one, other, end in ((tail, head, ends[0]), (head, tail, ends[1])):
        # One more place leads to all of an end.
        starts = np.flatnonzero(end)
        rows, columns = np.append(one, np.full(starts.size, many.size)), np.append(other, starts)
        graph = scipy.sparse.csr_matrix((np.ones(rows.size), (rows, columns)), shape=(many.size + 1,) * 2)
        reached = np.zeros(many.size + 1, dtype=np.bool_)
        reached[scipy.sparse.csgraph.breadth_first_order(graph, many.size, return_predecessors=False)] = True
        used &= reached[:-1]
    return used


def _chosen(ends: list[tuple[int, int, int]], least: int, most: int, wished: int) -> int:
    """The stretch to go on in, of several by their ends: near the place wished if a line need not turn there."""
    met = [each for each in ends if each[1] >= least and each[0] <= most]
    if met:
        return min(met, key=lambda each: max(each[0] - wished, wished - each[1]))[2]
    return min(ends, key=lambda each: max(each[0] - most, least - each[1]))[2]


def _led(way: Ints, links: Ints, side: Literal[1, -1]) -> Ints:
    """A way, drawn in from a side to where each of its stretches leads at the utmost."""
    farther = np.flatnonzero(side * (way[1:] - links[way[:-1]]) > 0)
    if not farther.size:
        return way
    led = way.tolist()
    for before in farther.tolist():
        here, utmost = before + 1, links.item(led[before])
        while here < len(led) and side * (led[here] - utmost) > 0:
            led[here] = utmost
            here, utmost = here + 1, links.item(utmost)
    return np.array(led)


def _dot_edges(panel: Panel, count: int) -> Ints:
    cell, dot = np.divmod(np.arange(count, dtype=np.int64), panel.opening.dots)
    return np.asarray(cell * panel.pitch_nm + panel.cell_size.dot_edges_nm[dot])


def _cuts(edges: Ints, dot_nm: int, end: int, reach: int, lane: int) -> Ints:
    """Where slabs begin and end; twice where one dot's reach ends as another's begins, for a line may pass there."""
    begins, ends = edges - reach, edges + dot_nm + reach
    steps = np.arange(0, end, max(1, lane // _SLABS_PER_LANE), dtype=np.int64)
    every = np.unique(np.concatenate((begins, ends, steps, [0, end])))
    both = np.sort(np.concatenate((every, np.intersect1d(begins, ends))))
    return np.asarray(both[(both >= 0) & (both <= end)])


def _corners(turns: Ints, places: Ints, cuts: Ints, axis: Axis) -> tuple[Point, ...]:
    x = np.repeat(places, 2)
    y = np.concatenate((cuts[:1], np.repeat(cuts[turns[1:]], 2), cuts[-1:]))
    apart = np.concatenate(([True], (np.diff(x) != 0) | (np.diff(y) != 0)))
    along, to = y[apart].tolist(), x[apart].tolist()
    return tuple(zip(to, along, strict=True)) if axis == "y" else tuple(zip(along, to, strict=True))


_BESIDE = ((0, 0), (0, 1), (1, 0), (1, 1), (1, -1))
"""Rows and columns on to the cells in which a chain goes on; those before are met from the other end."""

_TOUCHING = np.ones((3, 3), dtype=np.int8)


def panel_cut(panel: Panel, rules: WireRules, count: int, axis: Axis) -> Certificate | None:
    """A chain of openings that too few lines pass; None if every chain lets enough of them through.

    Args:
        count: lines along the axis for every pixel across, which keep within that pixel and the next to either side;
            beyond the panel nothing is open.
    """
    chains = _Chains.of(panel, rules, axis)
    if not chains.ends.size:
        return None
    passing, chain = chains.cheapest(chains.beside(count, -1), chains.beside(count, 1))
    if passing >= count * chains.pixels:
        return None
    return _certificate(chains, rules, *chains.shortest(chain, count), axis)


@dataclass(frozen=True, eq=False)
class _Chains:
    """Openings of a panel as lines along y see it, and what passes between them.

    Attributes:
        ends: int64 [n, 2] the least and the greatest coordinate across of every opening.
        tops: int64 [n, 2] coordinates along the lines at these two.
        tail, head: int64 [m] openings that are near each other, the one of the lower number first.
        passing: int64 [m] lines that pass between.
        first: int64, of every cell, the number of its first opening.
        pieces: of every kind of cell, its openings as in :func:`_pieces`.
    """

    ends: Ints
    tops: Ints
    tail: Ints
    head: Ints
    passing: Ints
    cells: Labels
    first: Ints
    pieces: Mapping[int, list[Ints]]
    panel: Panel
    rules: WireRules

    @classmethod
    def of(cls, panel: Panel, rules: WireRules, axis: Axis) -> _Chains:
        cells = panel.orientations if axis == "y" else panel.orientations.T
        kinds, held = np.unique(cells, return_inverse=True)
        patterns = {int(kind): panel.pattern(int(kind)) for kind in kinds}
        pieces = {kind: _pieces(pattern if axis == "y" else pattern.T, panel) for kind, pattern in patterns.items()}
        rows, columns = cells.shape
        sizes = np.array([len(own) for own in pieces.values()])[held].reshape(cells.shape)
        first = (np.cumsum(sizes) - sizes.ravel()).reshape(sizes.shape)
        pitch, dot = panel.pitch_nm, panel.dot_nm
        total = int(sizes.sum())
        ends, tops = np.empty((total, 2), dtype=np.int64), np.empty((total, 2), dtype=np.int64)
        for kind, own in pieces.items():
            at = np.argwhere(cells == kind)
            for number, piece in enumerate(own):
                low, high = piece[piece[:, 1].argmin()], piece[piece[:, 1].argmax()]
                members = first[at[:, 0], at[:, 1]] + number
                ends[members] = pitch * at[:, 1:] + (low[1], high[1] + dot)
                tops[members] = pitch * at[:, :1] + (low[0], high[0])
        tails, heads, passing = ([np.empty(0, dtype=np.int64)] for _ in range(3))
        for up, right in _BESIDE:
            # Cells and those that lie so beside them, by the first of their openings.
            here = np.s_[: rows - up, max(0, -right) : columns - max(0, right)]
            there = np.s_[up:, max(0, right) : columns + min(0, right)]
            for kind, other in product(pieces, pieces):
                met = (cells[here] == kind) & (cells[there] == other)
                if not met.any() or not pieces[kind] or not pieces[other]:
                    continue
                gaps = _gaps(pieces[kind], pieces[other], np.array([up, right]) * pitch, dot)
                # Two of one cell are met once.
                one, two = np.nonzero(np.triu(gaps >= 0, 1) if up == right == 0 else gaps >= 0)
                tails.append((first[here][met][:, None] + one).ravel())
                heads.append((first[there][met][:, None] + two).ravel())
                passing.append(np.tile(_passing(gaps[one, two], rules), int(met.sum())))
        tail, head, lines = (np.concatenate(each) for each in (tails, heads, passing))
        return cls(ends, tops, tail, head, lines, cells, first, pieces, panel, rules)

    @property
    def pixels(self) -> int:
        return int(self.cells.shape[1])

    @property
    def pitch_nm(self) -> int:
        return self.panel.pitch_nm

    def beside(self, count: int, side: Literal[1, -1]) -> Ints:
        """Lines of all that can pass on one side of every opening, int64 [n].

        Those of pixels farther to that side have room; of any pixel and those before it, as many as lie between the
        opening and where the pixel's lines end.
        """
        pixels = np.arange(self.pixels)
        others = pixels if side < 0 else self.pixels - 1 - pixels
        return np.asarray(
            (count * others + self.room(np.arange(self.ends.shape[0])[:, None], pixels, side)).min(axis=1)
        )

    def room(self, opening: Ints, pixel: Ints, side: Literal[1, -1]) -> Ints:
        """Lines that lie between openings and where the lines of pixels end."""
        lane, spare = self.rules.line_nm + self.rules.space_nm, self.rules.space_nm - self.rules.clearance_nm
        if side < 0:
            free = self.ends[opening, 0] - self.pitch_nm * (pixel - 1)
        else:
            free = self.pitch_nm * (pixel + 2) - self.ends[opening, 1]
        return np.asarray(np.maximum((free + spare) // lane, 0))

    def shortest(self, chain: list[int], count: int) -> tuple[int, int, tuple[int, int], list[int]]:
        """The part of a chain that proves most simply that too few lines pass: for fewest pixels, then openings.

        Returns:
            Lines that pass, lines that are wanted, the first and the last of their pixels, and the part.
        """
        nodes = np.array(chain)
        passed = np.concatenate(([0], np.cumsum([self._link(*pair)[0] for pair in pairwise(chain)], dtype=np.int64)))
        near = np.arange(3)
        first = np.clip((self.ends[nodes, 0] // self.pitch_nm)[:, None] + near, 0, self.pixels - 1)
        last = np.clip((self.ends[nodes, 1] // self.pitch_nm)[:, None] - near, 0, self.pixels - 1)
        # By opening and pixel where the part begins, then by opening and pixel where it ends.
        own = last - first[:, :, None, None] + 1
        passing = (
            self.room(nodes[:, None], first, -1)[:, :, None, None]
            + (passed - passed[:, None])[:, None, :, None]
            + self.room(nodes[:, None], last, 1)
        )
        links = (np.arange(nodes.size) - np.arange(nodes.size)[:, None])[:, None, :, None]
        proves = (own > 0) & (links >= 0) & (passing < count * own)
        price = np.where(proves, own * (nodes.size + 1) + links, np.iinfo(np.int64).max)
        i, at, j, to = (int(k) for k in np.unravel_index(int(price.argmin()), price.shape))
        pixels = int(first[i, at]), int(last[j, to])
        return int(passing[i, at, j, to]), count * (pixels[1] - pixels[0] + 1), pixels, chain[i : j + 1]

    def _link(self, one: int, other: int) -> tuple[int, tuple[Point, Point]]:
        """Lines that pass between two openings of a chain, and where, across and along."""
        tail, head = ((self._own(opening)) for opening in sorted((one, other)))
        apart = np.abs(tail[:, None] - head).max(axis=2)
        near = np.unravel_index(int(apart.argmin()), apart.shape)
        (y0, x0), (y1, x1) = (
            (own[at] + self.panel.dot_nm // 2).tolist() for own, at in zip((tail, head), near, strict=True)
        )
        way: tuple[Point, Point] = ((x0, y0), (x1, y1)) if one < other else ((x1, y1), (x0, y0))
        return int(_passing(np.maximum(apart.min() - self.panel.dot_nm, 0), self.rules)), way

    def _own(self, opening: int) -> Ints:
        """An opening as its rim's dots, along and across, from the panel's corner."""
        cell = int(self.first.ravel().searchsorted(opening, side="right")) - 1
        place = np.array(np.unravel_index(cell, self.cells.shape))
        return self.pieces[int(self.cells.flat[cell])][opening - int(self.first.flat[cell])] + place * self.pitch_nm

    def cheapest(self, from_first: Ints, to_last: Ints) -> tuple[int, list[int]]:
        """The chain of openings that fewest lines pass, from the first side to the last, and how many pass it."""
        size = self.ends.shape[0]
        every, start, stop = np.arange(size), size, size + 1
        tail = np.concatenate((self.tail, every, every))
        head = np.concatenate((self.head, np.full(size, start), np.full(size, stop)))
        cost = np.concatenate((self.passing, from_first, to_last))
        # One more than the cost for every link, so that of equal chains the shortest is taken.
        links = size + 2
        graph = scipy.sparse.coo_matrix((cost * links + 1, (tail, head)), shape=(links, links)).tocsr()
        distance, before = scipy.sparse.csgraph.dijkstra(graph, directed=False, indices=start, return_predecessors=True)
        chain, at = [], int(before[stop])
        while at != start:
            chain.append(at)
            at = int(before[at])
        return int(distance[stop] // links), chain[::-1]

    def corners(self, chain: list[int], low: int, high: int) -> tuple[Point, ...]:
        """A line along a chain, across and along, from one coordinate across to another."""
        points = [(low, int(self.tops[chain[0], 0])), (int(self.ends[chain[0], 0]), int(self.tops[chain[0], 0]))]
        for pair in pairwise(chain):
            points += self._link(*pair)[1]
        last = chain[-1]
        return (*points, (int(self.ends[last, 1]), int(self.tops[last, 1])), (high, int(self.tops[last, 1])))


def _passing(gap: Ints, rules: WireRules) -> Ints:
    """Lines that pass between openings a gap apart."""
    room = gap + rules.space_nm - 2 * rules.clearance_nm
    return np.asarray(np.maximum(room // (rules.line_nm + rules.space_nm), 0))


def _pieces(upright: Mask, panel: Panel) -> list[Ints]:
    """Openings of a cell, each as the lower left corners of its rim's dots, along and across, from the cell's own."""
    labels, count = scipy.ndimage.label(upright, structure=_TOUCHING)
    padded = np.pad(upright, 1)
    inner = padded[:-2, 1:-1] & padded[2:, 1:-1] & padded[1:-1, :-2] & padded[1:-1, 2:]
    rim = np.where(inner, 0, labels)
    return [np.argwhere(rim == number) * panel.dot_nm + panel.gutter_nm // 2 for number in range(1, int(count) + 1)]


def _gaps(ones: list[Ints], others: list[Ints], step: Ints, dot: int) -> Ints:
    """Gaps between all openings of a cell and all of another, a step away; int64 [ones, others]."""
    rims = np.concatenate(others) + step
    begins = np.cumsum([0, *map(len, others[:-1])])
    nearest = [np.maximum(*(np.abs(one[:, None, side] - rims[:, side]) for side in (0, 1))).min(axis=0) for one in ones]
    return np.asarray(np.maximum(np.minimum.reduceat(np.array(nearest), begins, axis=1) - dot, 0))


def _certificate(
    chains: _Chains, rules: WireRules, passing: int, wanted: int, pixels: tuple[int, int], chain: list[int], axis: Axis
) -> Certificate:
    kind = "columns" if axis == "y" else "rows"
    first, last = pixels
    own = f"{kind} {first + 1} to {last + 1}" if last > first else f"{kind[:-1]} {first + 1}"
    low, high = first - 1, last + 2
    statement = (
        f"the {wanted} lines along {axis} of {own} keep within a pixel of {'these' if last > first else 'it'}, and no "
        f"more than {passing} of {rules.line_nm / NM_PER_UM:g} um, {rules.space_nm / NM_PER_UM:g} um apart and "
        f"{rules.clearance_nm / NM_PER_UM:g} um from openings, pass a chain of {len(chain)} openings across"
    )
    points = chains.corners(chain, low * chains.pitch_nm, high * chains.pitch_nm)
    along = points if axis == "y" else tuple((y, x) for x, y in points)
    numbers = {"lines": float(passing), "wanted": float(wanted)}
    return Certificate(Proof.FLOW, statement, numbers, chain_nm=along)
