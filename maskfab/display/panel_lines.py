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

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise, product
from typing import Literal

import numpy as np
from klayout import db
from scipy import ndimage, sparse
from scipy.sparse import csgraph

from maskfab.base.arrays import Ints, Mask
from maskfab.base.model import Panel, Point, side_by_side
from maskfab.base.units import NM_PER_UM
from maskfab.display.emitter_rules import Certificate, Proof
from maskfab.display.pixel_lines import WireRules

Axis = Literal["x", "y"]


AXES: tuple[Axis, Axis] = ("x", "y")


_SLABS_PER_LANE = 3


_AT_ONCE = 512
"""Slabs at most that are looked at together; a line turns more often than that."""


@dataclass(frozen=True, eq=False)
class PanelLines:
    """Lines of one metal across a panel.

    Attributes:
        axis: along which they run.
        paths: the middles of the lines in order, corner by corner from border to border, nanometres from the panel's
            lower left corner; none if not all of them were found.
    """

    axis: Axis
    paths: tuple[tuple[Point, ...], ...]

    def polygons(self, width_nm: int) -> list[db.Polygon]:
        """Outlines of the lines."""
        return [db.Path([db.Point(*corner) for corner in path], width_nm).polygon() for path in self.paths]


def panel_lines(panel: Panel, rules: WireRules, count: int, axis: Axis) -> PanelLines:
    """``count`` lines along an axis for every pixel across, through the panel's own cells.

    A line's metal stays within its own pixel and the next to either side; beyond the panel nothing is open.

    Args:
        panel: openings, orientations and gutters.
        rules: width, space and clearance.
        count: of lines for each pixel.
        axis: along which they run.
    """
    field = _Field.of(panel, rules, axis)
    utmost: list[Ints] = []
    limit: Ints | None = None
    for pixel in reversed(range(field.pixels)):
        column = field.column(pixel)
        for _ in range(count):
            passage = column.between(None, limit)
            if passage is None:
                return PanelLines(axis, ())
            utmost.append(passage.last)
            limit = field.beside(passage.last, -1)
    utmost.reverse()
    paths = []
    before: Ints | None = None
    for pixel in range(field.pixels):
        column = field.column(pixel)
        for own in range(count):
            passage = column.between(before, utmost[pixel * count + own])
            assert passage is not None, "the utmost is a way itself"
            across = passage.straight(field.pitch_nm * pixel + field.pitch_nm * (2 * own + 1) // (2 * count))
            paths.append(_corners(across, field.cuts, axis))
            before = field.beside(across, 1)
    return PanelLines(axis, tuple(paths))


@dataclass(frozen=True, eq=False)
class _Runs:
    """Free stretches across a panel, slab by slab and in order across.

    Attributes:
        slab: int64 [n], ascending.
        low, high: int64 [n] where the middle of a line may lie, both included.
    """

    slab: Ints
    low: Ints
    high: Ints

    def kept(self, where: Mask) -> _Runs:
        return _Runs(self.slab[where], self.low[where], self.high[where])


@dataclass(frozen=True, eq=False)
class _Passage:
    """The free stretches that a line from end to end can use, all of them.

    Attributes:
        free: the stretches that openings leave.
        runs: what limits leave of each.
        slabs: how many slabs there are.
    """

    free: _Runs
    runs: _Runs
    slabs: int

    @property
    def last(self) -> Ints:
        """Per slab, the farthest that a line can lie; int64 [slabs]."""
        ends = np.searchsorted(self.runs.slab, np.arange(self.slabs), side="right") - 1
        return self.runs.high[ends]

    def straight(self, wished: int) -> Ints:
        """Per slab, where a line lies that is near a place, and moves only where it must; int64 [slabs]."""
        low, high = self.runs.low.tolist(), self.runs.high.tolist()
        begin, end = (side.tolist() for side in _onward(self.free))
        places = np.searchsorted(self.runs.slab, np.arange(self.slabs + 1))
        # Mostly there is one stretch to go on in, which must be met: up to the next slab of several, all at once.
        several = np.append(np.flatnonzero(np.diff(places) > 1), self.slabs)
        ends = several[np.searchsorted(several, np.arange(self.slabs))].tolist()
        starts = places.tolist()
        across = np.empty(self.slabs, dtype=np.int64)

        def away(run: int) -> int:
            return int(max(low[run] - wished, wished - high[run]))

        at = min(range(starts[1]), key=away)
        least, most, since, came, here = low[at], high[at], 0, 0, 1
        while here < self.slabs:
            if ends[here] > here:
                part = slice(starts[here], starts[here] + min(ends[here] - here, _AT_ONCE))
                lows = np.maximum.accumulate(np.maximum(self.runs.low[part], least))
                highs = np.minimum.accumulate(np.minimum(self.runs.high[part], most))
                if passed := int(np.searchsorted(lows > highs, True)):
                    least, most, at = int(lows[passed - 1]), int(highs[passed - 1]), starts[here] + passed - 1
                    here += passed
                    continue
            ahead = begin[at]
            if (more := end[at] - ahead) > 1:
                met = [run for run in range(ahead, ahead + more) if high[run] >= least and low[run] <= most]
                ahead = min(met, key=away, default=ahead)
            if high[ahead] >= least and low[ahead] <= most:
                at, here = ahead, here + 1
                least = max(least, low[at])
                most = min(most, high[at])
                continue
            at = min(range(begin[at], end[at]), key=lambda run: max(low[run] - most, least - high[run]))
            goes = 1 if low[at] > most else -1
            # A line that came from where it goes back to went no farther than it had to.
            place = min(max(wished, least), most) if came in (0, goes) else most if goes > 0 else least
            across[since:here] = place
            least, most, since, came, here = low[at], high[at], here, goes, here + 1
        across[since:] = min(max(wished, least), most)
        return across


@dataclass(frozen=True, eq=False)
class _Column:
    """The part of a panel in which the lines of one pixel across may lie.

    Attributes:
        free: stretches that openings leave.
        slabs: how many slabs there are.
        steps: int64 [2, m] pairs of stretches, in neighbouring slabs, that meet: where one slab ends and the next
            begins, a line may lie where either lets it. Stretches of a slab lie apart, so both rows ascend.
    """

    free: _Runs
    slabs: int
    steps: Ints

    def between(self, first: Ints | None, last: Ints | None) -> _Passage | None:
        """Passage between two limits, int64 [slabs] both included; None if there is none.

        Args:
            first: least place in every slab; None for no limit.
            last: greatest place likewise.
        """
        free = self.free
        low = free.low if first is None else np.maximum(free.low, first[free.slab])
        high = free.high if last is None else np.minimum(free.high, last[free.slab])
        used = self._used(low <= high)
        return None if used is None else _Passage(free.kept(used), _Runs(free.slab, low, high).kept(used), self.slabs)

    def _used(self, left: Mask) -> Mask | None:
        """Which stretches, of those that are left, lie on a way from the first slab to the last; None without a way."""
        usable = left[self.steps[0]] & left[self.steps[1]]
        last = int(self.free.slab.searchsorted(self.slabs - 1))
        first = int(self.free.slab.searchsorted(0, side="right"))
        forth = self._reached(0, usable, np.flatnonzero(left[:first]))
        back = self._reached(1, usable, last + np.flatnonzero(left[last:]))
        used = forth & back
        return used if used.any() else None

    def _reached(self, side: Literal[0, 1], usable: Mask, starts: Ints) -> Mask:
        """Which stretches ways from some of them come to, by the steps that are kept, from that side of each."""
        many = np.concatenate(([0], np.cumsum(usable)))[self._begins[side]]
        onward = np.concatenate((self.steps[1 - side, usable], starts))
        rows = np.concatenate((many, [onward.size]))
        graph = sparse.csr_matrix((np.ones(onward.size), onward, rows), shape=(many.size, many.size))
        reached = np.zeros(many.size, dtype=np.bool_)
        reached[csgraph.breadth_first_order(graph, many.size - 1, return_predecessors=False)] = True
        return reached[:-1]

    @cached_property
    def _begins(self) -> Ints:
        """Where the steps of every stretch begin, by its place in them, and where the last ends; int64 [2, n + 1]."""
        every = np.arange(self.free.slab.size + 1)
        return np.stack([np.searchsorted(side, every) for side in self.steps])


def _steps(runs: _Runs) -> Ints:
    """Pairs of stretches in neighbouring slabs that meet, int64 [2, m]."""
    begin, end = _onward(runs)
    return np.stack((np.repeat(np.arange(begin.size), np.maximum(end - begin, 0)), _in_rows(begin, end)))


def _onward(runs: _Runs) -> tuple[Ints, Ints]:
    """Of every stretch, the first of those that it meets in the next slab, which stand in a row, and the one after."""
    least = runs.low.min(initial=0)
    step = int(runs.high.max(initial=0) - least) + 1
    low, high = (runs.slab * step + across - least for across in (runs.low, runs.high))
    return np.searchsorted(high, low + step, side="left"), np.searchsorted(low, high + step, side="right")


def _in_rows(begin: Ints, end: Ints) -> Ints:
    """Numbers from every begin to before its end, one row after the other; none where the end does not come later."""
    many = np.maximum(end - begin, 0)
    return np.asarray(np.repeat(begin - (np.cumsum(many) - many), many) + np.arange(many.sum()))


@dataclass(frozen=True, eq=False)
class _Field:
    """A panel as lines along one axis see it: slabs across them, and in each where their middle may lie.

    Attributes:
        runs: of the whole panel.
        cuts: int64 [slabs + 1] where slabs begin and end along the lines.
        pixels: across.
        pitch_nm: of a pixel.
        rules: width, space and clearance.
    """

    runs: _Runs
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
        # The dots whose reach a slab lies in.
        first = np.searchsorted(along + panel.dot_nm + reach, cuts[:-1], side="right")
        last = np.searchsorted(along - reach, cuts[1:], side="left")
        sums = np.zeros((along.size + 1, across.size), dtype=np.int32)
        np.cumsum(upright, axis=0, out=sums[1:])
        shut = np.zeros((cuts.size - 1, across.size + 2), dtype=np.bool_)
        shut[:, 1:-1] = sums[np.maximum(last, first)] > sums[first]
        # A pixel beyond the panel the first and the last stretch end, as at openings.
        least, most = -panel.pitch_nm, ends_nm[1] + panel.pitch_nm
        shut[:, 0] = shut[:, -1] = True
        begins = np.concatenate(([least], across - reach, [most]))
        ends = np.concatenate(([least], across + panel.dot_nm + reach, [most]))
        slab, dot = np.nonzero(shut)
        same = slab[:-1] == slab[1:]
        low, high = ends[dot[:-1]], begins[dot[1:]]
        open_runs = same & (low <= high)
        runs = _Runs(slab[:-1][open_runs].astype(np.int64), low[open_runs], high[open_runs])
        return cls(runs, cuts, ends_nm[1] // panel.pitch_nm, panel.pitch_nm, rules)

    def column(self, pixel: int) -> _Column:
        """Where the lines of a pixel across may lie."""
        half = self.rules.line_nm // 2
        least, most = (pixel - 1) * self.pitch_nm + half, (pixel + 2) * self.pitch_nm - half
        # Of every slab, those that reach between the two stand in a row.
        begin = np.searchsorted(self._highs, self._slabs + least, side="left")
        end = np.searchsorted(self._lows, self._slabs + most, side="right")
        near = _in_rows(begin, end)
        low, high = np.maximum(self.runs.low[near], least), np.minimum(self.runs.high[near], most)
        free = _Runs(self.runs.slab[near], low, high)
        return _Column(free, self.cuts.size - 1, _steps(free))

    def beside(self, across: Ints, side: Literal[1, -1]) -> Ints:
        """The nearest that the next line on a side may come to a line, slab by slab."""
        lane = self.rules.line_nm + self.rules.space_nm
        held = np.append(side * across, np.iinfo(np.int64).min)
        nearest = np.asarray(np.maximum.reduceat(held, self._near)[::2], dtype=np.int64)
        return side * (nearest + lane)

    @cached_property
    def _slabs(self) -> Ints:
        """A number for every slab, so far apart that places across, added to it, ascend from slab to slab."""
        return np.asarray(np.arange(self.cuts.size - 1) * (self.pixels + 4) * self.pitch_nm)

    @cached_property
    def _lows(self) -> Ints:
        """Where the stretches begin, ascending over all slabs."""
        return np.asarray(self._slabs[self.runs.slab] + self.runs.low)

    @cached_property
    def _highs(self) -> Ints:
        """Where the stretches end, ascending likewise."""
        return np.asarray(self._slabs[self.runs.slab] + self.runs.high)

    @cached_property
    def _near(self) -> Ints:
        """The slabs less than a lane away from every slab, the first and the one after the last in turn."""
        lane = self.rules.line_nm + self.rules.space_nm
        first = np.searchsorted(self.cuts[1:], self.cuts[:-1] - lane, side="right")
        after = np.searchsorted(self.cuts[:-1], self.cuts[1:] + lane, side="left")
        return np.stack((first, after), axis=1).ravel()


def _dot_edges(panel: Panel, count: int) -> Ints:
    """Lower edges of dots along a side of a panel."""
    cell, dot = np.divmod(np.arange(count, dtype=np.int64), panel.opening.dots)
    return np.asarray(cell * panel.pitch_nm + panel.cell_size.dot_edges_nm[dot])


def _cuts(edges: Ints, dot_nm: int, end: int, reach: int, lane: int) -> Ints:
    """Where slabs begin and end; twice where one dot's reach ends as another's begins, for a line may pass there."""
    begins, ends = edges - reach, edges + dot_nm + reach
    steps = np.arange(0, end, max(1, lane // _SLABS_PER_LANE), dtype=np.int64)
    every = np.unique(np.concatenate((begins, ends, steps, [0, end])))
    both = np.sort(np.concatenate((every, np.intersect1d(begins, ends))))
    return np.asarray(both[(both >= 0) & (both <= end)])


def _corners(across: Ints, cuts: Ints, axis: Axis) -> tuple[Point, ...]:
    """The middle of a line, corner by corner."""
    moved = np.flatnonzero(np.diff(across)) + 1
    x = np.repeat(across[np.concatenate(([0], moved))], 2)
    y = np.concatenate((cuts[:1], np.repeat(cuts[moved], 2), cuts[-1:]))
    apart = np.concatenate(([True], (np.diff(x) != 0) | (np.diff(y) != 0)))
    along, to = y[apart].tolist(), x[apart].tolist()
    return tuple(zip(to, along, strict=True)) if axis == "y" else tuple(zip(along, to, strict=True))


_BESIDE = ((0, 0), (0, 1), (1, 0), (1, 1), (1, -1))
"""Rows and columns on to the cells in which a chain goes on; those before are met from the other end."""


_TOUCHING = np.ones((3, 3), dtype=np.int8)


def panel_cut(panel: Panel, rules: WireRules, count: int, axis: Axis) -> Certificate | None:
    """A chain of openings that too few lines pass; None if every chain lets enough of them through.

    Args:
        panel: openings, orientations and gutters.
        rules: width, space and clearance.
        count: lines along the axis for every pixel across, which keep within that pixel and the next to either side;
            beyond the panel nothing is open.
        axis: along which the lines run.
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
        tail, head: int64 [m] openings that are near each other.
        passing: int64 [m] lines that pass between.
        between: int64 [m, 4] across and along of the nearest corners, of the one and of the other.
        pixels: across.
        pitch_nm: of a pixel.
        rules: width, space and clearance.
    """

    ends: Ints
    tops: Ints
    tail: Ints
    head: Ints
    passing: Ints
    between: Ints
    pixels: int
    pitch_nm: int
    rules: WireRules

    @classmethod
    def of(cls, panel: Panel, rules: WireRules, axis: Axis) -> _Chains:
        cells = panel.orientations if axis == "y" else panel.orientations.T
        patterns = {int(kind): panel.pattern(int(kind)) for kind in np.unique(cells)}
        pieces = {kind: _pieces(pattern if axis == "y" else pattern.T, panel) for kind, pattern in patterns.items()}
        rows, columns = cells.shape
        sizes = np.array([[len(pieces[int(kind)]) for kind in row] for row in cells], dtype=np.int64)
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
        tails, heads, gaps, places = [], [], [], []
        for up, right in _BESIDE:
            # Cells and those that lie so beside them.
            here = cells[: rows - up, max(0, -right) : columns - max(0, right)]
            there = cells[up:, max(0, right) : columns + min(0, right)]
            for kind, other in product(pieces, pieces):
                at = np.argwhere((here == kind) & (there == other)) + np.array([0, max(0, -right)])
                if not at.size:
                    continue
                gap, place = _near(pieces[kind], pieces[other], np.array([up, right]) * pitch, dot)
                one, two = np.divmod(np.arange(gap.size), max(len(pieces[other]), 1))
                tails.append((first[at[:, 0], at[:, 1]][:, None] + one).ravel())
                heads.append((first[at[:, 0] + up, at[:, 1] + right][:, None] + two).ravel())
                gaps.append(np.tile(gap, len(at)))
                places.append((place + np.tile(at[:, None, ::-1] * pitch, 2)).reshape(-1, 4))
        room = np.concatenate(gaps) + rules.space_nm - 2 * rules.clearance_nm
        return cls(
            ends,
            tops,
            np.concatenate(tails),
            np.concatenate(heads),
            np.maximum(room // (rules.line_nm + rules.space_nm), 0),
            np.concatenate(places),
            columns,
            pitch,
            rules,
        )

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
        link = np.flatnonzero(((self.tail == one) & (self.head == other)) | ((self.tail == other) & (self.head == one)))
        best = link[self.passing[link].argmin()]
        x0, y0, x1, y1 = self.between[best].tolist()
        way: tuple[Point, Point] = ((x0, y0), (x1, y1)) if self.tail[best] == one else ((x1, y1), (x0, y0))
        return int(self.passing[best]), way

    def cheapest(self, from_first: Ints, to_last: Ints) -> tuple[int, list[int]]:
        """The chain of openings that fewest lines pass, from the first side to the last, and how many pass it.

        Args:
            from_first: int64 [n] lines that pass between the first side and every opening.
            to_last: int64 [n] between it and the last side.
        """
        size = self.ends.shape[0]
        every, start, stop = np.arange(size), size, size + 1
        tail = np.concatenate((self.tail, np.full(size, start), every))
        head = np.concatenate((self.head, every, np.full(size, stop)))
        cost = np.concatenate((self.passing, from_first, to_last))
        # One more than the cost for every link, so that of equal chains the shortest is taken.
        links = size + 2
        graph = _least(tail, head, cost * links + 1, links).tocsr()
        distance, before = csgraph.dijkstra(graph, directed=False, indices=start, return_predecessors=True)
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
        return (
            *points,
            (int(self.ends[last, 1]), int(self.tops[last, 1])),
            (high, int(self.tops[last, 1])),
        )


def _least(tail: Ints, head: Ints, cost: Ints, size: int) -> sparse.coo_matrix:
    """A graph of the cheapest of all links between two places."""
    low, high = np.minimum(tail, head), np.maximum(tail, head)
    order = np.lexsort((cost, high, low))
    low, high, cost = low[order], high[order], cost[order]
    first = np.concatenate(([True], (np.diff(low) != 0) | (np.diff(high) != 0)))
    return sparse.coo_matrix((cost[first], (low[first], high[first])), shape=(size, size))


def _pieces(upright: Mask, panel: Panel) -> list[Ints]:
    """Openings of a cell, each as the lower left corners of its rim's dots, along and across, from the cell's own."""
    labels, count = ndimage.label(upright, structure=_TOUCHING)
    padded = np.pad(upright, 1)
    inner = padded[:-2, 1:-1] & padded[2:, 1:-1] & padded[1:-1, :-2] & padded[1:-1, 2:]
    rim = np.where(inner, 0, labels)
    return [np.argwhere(rim == number) * panel.dot_nm + panel.gutter_nm // 2 for number in range(1, int(count) + 1)]


def _near(ones: list[Ints], others: list[Ints], step: Ints, dot: int) -> tuple[Ints, Ints]:
    """Gaps between all openings of a cell and all of another, and the dots between which they are.

    Returns:
        int64 [pairs] and [pairs, 4], across and along of the two dots.
    """
    gaps, places = [], []
    for one, other in product(ones, others):
        there = other + step
        apart = np.abs(one[:, None] - there).max(axis=2)
        i, j = np.unravel_index(int(apart.argmin()), apart.shape)
        gaps.append(max(int(apart[i, j]) - dot, 0))
        places.append((one[i, 1], one[i, 0], there[j, 1], there[j, 0]))
    return np.array(gaps, dtype=np.int64), np.array(places, dtype=np.int64).reshape(-1, 4) + dot // 2


def _certificate(
    chains: _Chains,
    rules: WireRules,
    passing: int,
    wanted: int,
    pixels: tuple[int, int],
    chain: list[int],
    axis: Axis,
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
