"""Lines through one pixel: how many a gutter holds, how many cross the closed dots, and ports that fit every neighbour.

A dot carries one line; lines step between dots that share a side, since corners do not conduct. The count is a maximum
flow with capacities on the dots, and by Menger's theorem the fewest dots that cut one side off from the other. At fixed
ports lines meet those of any neighbour, however both pixels are turned.

Lines are drawn on a grid of their own, whose nodes lie one line and one space apart. A node is free where the square
round it, wide enough for half a line and the clearance to openings (or half a space), holds no opening; neighbours'
squares cover what lies between, so any path over free nodes keeps every rule. Lines along x and along y are on
different metals and cross freely.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from maskfab.base.arrays import Indices, Ints, Mask
from maskfab.base.model import Opening


@dataclass(frozen=True)
class WireRules:
    """Width and space of drawn lines, clearance of opaque ones from openings; the defaults are a judgement."""

    line_nm: int = 3000
    space_nm: int = 3000
    clearance_nm: int = 2500


def lines_per_layer(width_nm: int, rules: WireRules) -> int:
    """Most lines n of one layer with n line + (n - 1) space + 2 clearance <= width."""
    return max(0, (width_nm + rules.space_nm - 2 * rules.clearance_nm) // (rules.line_nm + rules.space_nm))


Direction = Literal["vertical", "horizontal"]

DIRECTIONS: tuple[Direction, Direction] = ("vertical", "horizontal")


class Net:
    """The flow network of a pixel in one direction, made once and asked for many sets of ports.

    Args:
        closed: bool [n, n], y up, True where a line may run.
        direction: vertical lines run from the lowest row to the highest, horizontal ones from the left to the right.
    """

    def __init__(self, closed: Mask, direction: Direction) -> None:
        self.direction = direction
        self._upright = np.ascontiguousarray(closed if direction == "vertical" else closed.T)
        self._ids = np.flatnonzero(self._upright)
        self._number = np.full(self._upright.shape, -1, dtype=np.int32)
        self._number.flat[self._ids] = np.arange(self._ids.size, dtype=np.int32)
        self._tail, self._head = _neighbours(self._number)

    def count(self, ports: Indices | None = None) -> int:
        """Most lines that start at the dots ``ports`` of the first side and end at the same ones of the last."""
        return int(self._solve(ports).flow_value)

    def paths(self, ports: Indices | None = None) -> tuple[Indices, ...]:
        """The lines themselves, first side to last, ordered along the first side; intp [k, 2] row and column.

        A dot carries one line, so that lines cannot cross, so those through ports come out at the port they went in by
        when all ports are used.
        """
        flow = self._solve(ports).flow.tocoo()
        used = flow.data > 0
        onward: dict[int, list[int]] = {}
        source = 2 * self._ids.size
        starts: list[int] = []
        for tail, head, units in zip(
            flow.row[used].tolist(), flow.col[used].tolist(), flow.data[used].tolist(), strict=True
        ):
            if tail == source:
                starts += [head // 2] * units
            elif tail % 2:  # from the way out of a dot to the way into the next, or to the sink
                onward.setdefault(tail // 2, []).extend([head // 2] * units)
        walks = [self._walk(start, onward) for start in sorted(starts)]
        return tuple(self._places(walk) for walk in walks)

    def _solve(self, ports: Indices | None) -> Any:
        size = self._ids.size
        dots = np.arange(size, dtype=np.int32)
        source, sink = 2 * size, 2 * size + 1
        ends = []
        for row in (0, -1):
            side = self._number[row] if ports is None else self._number[row, ports]
            ends.append(side[side >= 0])
        starts, stops = ends
        tails = (2 * dots, 2 * self._tail + 1, np.full(starts.size, source), 2 * stops + 1)
        heads = (2 * dots + 1, 2 * self._head, 2 * starts, np.full(stops.size, sink))
        tail, head = np.concatenate(tails), np.concatenate(heads)
        data = np.ones(tail.size, dtype=np.int32)
        graph = scipy.sparse.csr_matrix((data, (tail, head)), shape=(2 * size + 2, 2 * size + 2))
        return scipy.sparse.csgraph.maximum_flow(graph, source, sink)

    def _walk(self, start: int, onward: dict[int, list[int]]) -> list[int]:
        """One unit of flow from a dot to the sink, loops left out."""
        sink = self._ids.size  # half the sink's number, rounded down
        walk, place = [start], {start: 0}
        while (following := onward[walk[-1]].pop()) != sink:
            if following in place:
                for dot in walk[place[following] + 1 :]:
                    del place[dot]
                del walk[place[following] + 1 :]
            else:
                place[following] = len(walk)
                walk.append(following)
        return walk

    def _places(self, walk: list[int]) -> Indices:
        rows, columns = np.unravel_index(self._ids[walk], self._upright.shape)
        pair = (rows, columns) if self.direction == "vertical" else (columns, rows)
        return np.stack(pair, axis=1).astype(np.intp)


def _neighbours(number: NDArray[np.int32]) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Both ends of every step between closed dots that share a side."""
    tails, heads = [], []
    for here, there in ((number[:, :-1], number[:, 1:]), (number[:-1], number[1:])):
        both = (here >= 0) & (there >= 0)
        tails += [here[both], there[both]]
        heads += [there[both], here[both]]
    return np.concatenate(tails), np.concatenate(heads)


_MOST_TRIED = 400
"""Sets of ports before the best so far is returned as a lower bound."""


@dataclass(frozen=True)
class Ports:
    """Where the lines of any two pixels of a panel meet; where not ``exact``, the count is a lower bound."""

    places: tuple[int, ...]
    exact: bool

    @property
    def count(self) -> int:
        return len(self.places)


def ports(
    closed: Mask,
    directions: Sequence[Direction] = DIRECTIONS,
    *,
    symmetric: bool = True,
    enough: int | None = None,
    least: int = 0,
) -> Ports:
    """The most ports, the same at both ends, through which lines run in every given direction.

    With both directions and symmetric places, i together with n - 1 - i, they serve all eight orientations beside any
    neighbour; without quarter turns each direction may have its own, and without turns they need not be symmetric.

    A set that can be wired stays so without some of its lines, so a set that fails rules out all that hold it.

    Args:
        closed: bool [n, n], True where a line may run; one line per dot and layer.
        symmetric: whether the places must be mirror images of each other.
        enough: stop at so many; one more may come out where places are symmetric.
        least: fewer are of no use, so that none come out where there are no more.
    """
    n = closed.shape[0]
    nets = [Net(closed, direction) for direction in directions]
    sides = np.ones(n, dtype=np.bool_)
    for direction in directions:
        upright = closed if direction == "vertical" else closed.T
        sides &= upright[0] & upright[-1]
    if symmetric:
        free = np.flatnonzero(sides & sides[::-1])
        orbits = [tuple(sorted({int(i), n - 1 - int(i)})) for i in free if 2 * i <= n - 1]
    else:
        free = np.flatnonzero(sides)
        orbits = [(int(i),) for i in free]
    # Pairs first: each adds two ports, the middle dot only one.
    orbits.sort(key=len, reverse=True)
    ceiling = min(net.count(free) for net in nets) if free.size else 0
    if enough is not None:
        ceiling = min(ceiling, enough + symmetric)
    best: tuple[int, ...] = ()
    tried = 0
    if ceiling < least:
        return Ports(best, True)
    waiting: list[tuple[tuple[int, ...], int]] = [((), 0)]
    wanted = ceiling if enough is None else min(ceiling, enough)
    while waiting and len(best) < wanted:
        chosen, following = waiting.pop()
        most = len(chosen) + sum(len(orbit) for orbit in orbits[following:])
        if most <= len(best) or most < least or following == len(orbits):
            continue
        if tried >= _MOST_TRIED:
            return Ports(best, False)
        waiting.append((chosen, following + 1))
        larger = tuple(sorted(chosen + orbits[following]))
        if len(larger) > ceiling:
            continue
        tried += 1
        if all(net.count(np.array(larger)) == len(larger) for net in nets):
            best = max(best, larger, key=len)
            waiting.append((larger, following + 1))
    return Ports(best, True)


@dataclass(frozen=True, eq=False)
class RoutingGrid:
    """Nodes on which lines may run, bool [n, n], y up, and their coordinates from the pixel's lower left corner."""

    free: Mask
    places_nm: Ints


def routing_grids(opening: Opening, dot_nm: int, gutter_nm: int, rules: WireRules) -> Iterator[RoutingGrid]:
    """Grids on which lines of a pixel may run: as dense as the rules allow, and in step with the dots.

    The first has most nodes, the others lie in the middle of closed dots where dots are no wider than a lane.
    """
    least, side = rules.line_nm + rules.space_nm, opening.dots * dot_nm
    in_step = dot_nm // (dot_nm // least) if dot_nm >= least else dot_nm * -(-least // dot_nm)
    seen = set()
    for pitch in (least, in_step):
        for count in (side // pitch, side // pitch - 1):
            if count > 0 and (pitch, count) not in seen:
                seen.add((pitch, count))
                yield routing_grid(opening, dot_nm, gutter_nm, rules, pitch, count)


def routing_grid(
    opening: Opening, dot_nm: int, gutter_nm: int, rules: WireRules, pitch: int, count: int
) -> RoutingGrid:
    """``count`` x ``count`` nodes of a pitch, placed symmetrically about the pixel's centre.

    They must keep half a line and half a space from the border of the dots, so that lines of neighbours and of the
    gutter keep apart; those next to the border are free only if the way straight to it is.
    """
    side, half = opening.dots * dot_nm, gutter_nm // 2
    if (side - (count - 1) * pitch) % 2:
        # The centre lies between two nanometres: turned pixels meet one off, for which there must be room.
        pitch += 1
        count = min(count, side // pitch)
    # From the lower left corner of the dots on.
    places = (side - (count - 1) * pitch) // 2 + pitch * np.arange(count, dtype=np.int64)
    reach = max(rules.line_nm // 2 + rules.clearance_nm, -(-pitch // 2))
    low, high = places - reach, places + reach
    # Beyond half a gutter begins a neighbour, which may be open there.
    inside = (low >= -half) & (high <= side + half)
    low[0], high[-1] = 0, side
    start, stop = np.clip(low // dot_nm, 0, opening.dots), np.clip(-(-high // dot_nm), 0, opening.dots)
    sums = np.zeros((opening.dots + 1, opening.dots + 1), dtype=np.int64)
    sums[1:, 1:] = opening.mask.cumsum(axis=0).cumsum(axis=1)
    corners = [sums[np.ix_(y, x)] for y in (start, stop) for x in (start, stop)]
    clear = corners[3] - corners[2] - corners[1] + corners[0]
    return RoutingGrid((clear == 0) & inside[:, None] & inside, half + places)
