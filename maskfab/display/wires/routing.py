"""A grid of their own on which lines run through the closed area of a pixel.

Lines run on square nodes one line and one space apart. A node is free where the square round it, wide enough for half a
line and the clearance to openings (or half a space), holds no opening; neighbours' squares cover what lies between, so
any path over free nodes keeps every rule. Lines along x and along y are on different metals and cross freely.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Mask
from maskfab.display.wires.gutter import WireRules
from maskfab.model import Opening


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
