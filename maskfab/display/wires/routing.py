"""Lines through the closed area of a pixel on a grid of their own: what can be drawn, and a bound on what could be.

Lines run on square nodes one line and one space apart. A node is free where the square round it, wide enough for half a
line and the clearance to openings (or half a space), holds no opening; neighbours' squares cover what lies between, so
any path over free nodes keeps every rule. Lines along x and along y are on different metals and cross freely.

No drawing has more lines than a chain of openings lets pass. Lines of one metal keep line + space apart in the
Chebyshev sense, so between two openings a gap d holds at most (d + space - 2 clearance) / (line + space) of them; the
cheapest chain of openings across a pixel, and on to that of its neighbour, bounds the number (a cut of a single-layer
routing: F. M. Maley, Single-Layer Wire Routing and Compaction, 1990).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maskfab.display.emitters.placement import Certificate, Proof
from maskfab.display.wires.flow import Direction
from maskfab.display.wires.gutter import WireRules
from maskfab.model import Opening
from maskfab.units import NM_PER_UM

Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class RoutingGrid:
    """Nodes on which lines may run.

    Attributes:
        free: bool [n, n], y up.
        places_nm: their coordinates along a side, the pixel's lower left corner, gutter included, the origin.
    """

    free: Mask
    places_nm: NDArray[np.int64]


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


def most_lines(
    opening: Opening, dot_nm: int, gutter_nm: int, rules: WireRules, direction: Direction
) -> tuple[int, Certificate]:
    """A bound on the lines of one metal across a pixel, its gutter included, and the chain of openings that proves it.

    The chain runs from flank to flank, half a gutter beyond the dots on either side, where a neighbour's goes on.
    """
    upright = opening.mask if direction == "vertical" else opening.mask.T
    n = opening.dots
    places = np.argwhere(_rims(upright))
    rows, columns = places[:, 0], places[:, 1]
    # Gaps between openings, and from openings to the left and the right flank, in dots.
    gaps = np.maximum(abs(rows[:, None] - rows), abs(columns[:, None] - columns)) - 1
    size = len(places)
    # In half nanometres of lane: two flanks share what passes between the outermost openings of two pixels.
    lane = 2 * (rules.line_nm + rules.space_nm)
    cost = np.full((size + 2, size + 2), 2 * (n * dot_nm + gutter_nm + rules.space_nm))
    cost[:size, :size] = lane * _passing(np.maximum(gaps, 0) * dot_nm, rules)
    for flank, away in ((size, columns), (size + 1, n - 1 - columns)):
        room = 2 * away * dot_nm + gutter_nm + rules.space_nm - 2 * rules.clearance_nm
        cost[flank, :size] = cost[:size, flank] = np.maximum(0, room)
    chain, total = _cheapest(cost, size, size + 1)
    total //= lane
    witness = np.zeros_like(upright)
    kept = [place for place in chain if place < size]
    witness[rows[kept], columns[kept]] = True
    ways = ("top to bottom", "left and right") if direction == "vertical" else ("left to right", "bottom and top")
    statement = (
        f"from {ways[0]} no more than {total} lines of {rules.line_nm / NM_PER_UM:g} um pass, "
        f"{rules.space_nm / NM_PER_UM:g} um apart and {rules.clearance_nm / NM_PER_UM:g} um from openings, "
        f"for a chain of {len(kept)} clear dots "
        f"between {ways[1]} leaves no more room"
    )
    picture = witness if direction == "vertical" else witness.T
    return total, Certificate(Proof.FLOW, statement, {"lines": total, "dots": len(kept)}, picture, dot_nm)


def _passing(gap_nm: NDArray[np.int64], rules: WireRules) -> NDArray[np.int64]:
    """Lines that pass between two openings so far apart."""
    room = gap_nm + rules.space_nm - 2 * rules.clearance_nm
    return np.asarray(np.maximum(0, room // (rules.line_nm + rules.space_nm)), dtype=np.int64)


def _rims(mask: Mask) -> Mask:
    """Clear dots with a closed neighbour or at the border; the others bound no gap."""
    padded = np.pad(mask, 1)
    inner = padded[:-2, 1:-1] & padded[2:, 1:-1] & padded[1:-1, :-2] & padded[1:-1, 2:]
    return np.asarray(mask & ~inner)


def _cheapest(cost: NDArray[np.int64], start: int, stop: int) -> tuple[list[int], int]:
    """The cheapest chain between two places, the one of fewest links among equals, and its cost."""
    links = cost.shape[0] + 1
    weight = cost * links + 1
    distance = weight[start].copy()
    before = np.full(distance.size, start)
    done = np.zeros(distance.size, dtype=bool)
    done[start] = True
    while not done[stop]:
        at = int(np.where(done, np.iinfo(np.int64).max, distance).argmin())
        done[at] = True
        through = distance[at] + weight[at]
        better = through < distance
        distance[better], before[better] = through[better], at
    chain, at = [], int(before[stop])
    while at != start:
        chain.append(at)
        at = int(before[at])
    return chain[::-1], int(distance[stop] // links)
