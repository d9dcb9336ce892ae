"""Proof that lines cannot cross a panel: a chain of openings from flank to flank that lets too few of them pass.

Lines of one metal keep a line and a space apart in the Chebyshev sense, so that between two openings a gap d holds at
most (d + space - 2 clearance) / (line + space) of them. Lines that keep to some pixels across all pass every chain of
openings from one side of these to the other, wherever it runs (a cut of a single-layer routing: F. M. Maley,
Single-Layer Wire Routing and Compaction, 1990).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise, product
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, sparse
from scipy.sparse import csgraph

from maskfab.base.arrays import Ints
from maskfab.display.emitters.placement import Certificate, Proof
from maskfab.display.wires.gutter import WireRules
from maskfab.display.wires.panel_routing import Axis
from maskfab.model import Panel, Point
from maskfab.units import NM_PER_UM

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
        pieces = {kind: _pieces(each if axis == "y" else each.T, panel) for kind, each in patterns.items()}
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
        """For every opening, how many of all lines can pass on one side of it, int64 [n].

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
        passed = np.concatenate(([0], np.cumsum([self._link(*each)[0] for each in pairwise(chain)], dtype=np.int64)))
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
        for each in pairwise(chain):
            points += self._link(*each)[1]
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


def _pieces(upright: NDArray[np.bool_], panel: Panel) -> list[Ints]:
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
