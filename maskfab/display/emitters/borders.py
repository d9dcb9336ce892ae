"""Gaps across the borders of pixels, for every pair of orientations that meet in a panel.

Clearance is pairwise, so pairs that share a side and pairs that share a corner are all there is to look at. A pair one
above the other is a pair side by side after a quarter turn, and a corner pair of one diagonal one of the other, so two
kinds of neighbours are enough: to the right, and up to the right.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations

import numpy as np
import scipy
from numpy.typing import NDArray

from maskfab.base.arrays import Labels, Mask
from maskfab.display.emitters.across_borders import border_margin
from maskfab.display.emitters.emitter_rules import EmitterGrid
from maskfab.model import ORIENTATIONS, orient

Pair = tuple[int, int]

TURNED_BACK = tuple(k // 4 * 4 + (k + 3) % 4 for k in range(ORIENTATIONS))
"""An orientation followed by a quarter turn clockwise."""


@dataclass(frozen=True)
class Meeting:
    """Two pixels that meet, and what is too close between them.

    Attributes:
        pair: orientations of the left (or lower left) and the right (or upper right) pixel.
        diagonal: whether they meet at a corner.
        gap: smallest Chebyshev gap between what must keep apart, in cells; at most the rule where it is kept.
    """

    pair: Pair
    diagonal: bool
    gap: int


@dataclass(frozen=True)
class Borders:
    """The gaps across borders of a panel.

    Attributes:
        side_pairs, diagonal_pairs: how many different pairs meet.
        side_violations, diagonal_violations: how many of them are closer than a rule.
        worst: the pair that falls shortest of its rule; None if no pixels meet.
        margin_nm: kept free along the pixel's sides, it makes every pair legal without a look at any.
    """

    side_pairs: int
    diagonal_pairs: int
    side_violations: int
    diagonal_violations: int
    worst: Meeting | None
    margin_nm: int

    @property
    def legal(self) -> bool:
        return self.side_violations + self.diagonal_violations == 0


def margin(grid: EmitterGrid) -> int:
    """The margin, in cells, that is enough on every side: max((colour gap - gutter) / 2, gap to openings - gutter)."""
    return max(border_margin(grid), grid.to_opening - grid.gutter)


def meetings(orientations: NDArray[np.int8]) -> tuple[frozenset[Pair], frozenset[Pair]]:
    """The pairs of a map that share a side, and those that share a corner, each as if beside or up to the right."""
    turned = np.array(TURNED_BACK)[orientations % ORIENTATIONS]
    plain = orientations % ORIENTATIONS

    def pairs(one: NDArray[np.integer], other: NDArray[np.integer]) -> set[Pair]:
        codes = np.unique(one.astype(int) * ORIENTATIONS + other)
        return {divmod(int(code), ORIENTATIONS) for code in codes}

    beside = pairs(plain[:, :-1], plain[:, 1:]) | pairs(turned[:-1], turned[1:])
    # Up to the left, turned back by a quarter, is up to the right.
    across = pairs(plain[:-1, :-1], plain[1:, 1:]) | pairs(turned[:-1, 1:], turned[1:, :-1])
    return frozenset(beside), frozenset(across)


def borders(labels: Labels, opening: Mask, grid: EmitterGrid, orientations: NDArray[np.int8]) -> Borders:
    """Check every pair of neighbours of a panel.

    Args:
        labels: emitters of one pixel, int8 [n, n] on the grid's cells.
        opening: its clear cells, bool [n, n].
        grid: cells and rules.
        orientations: of the panel's pixels.
    """
    beside, across = meetings(orientations)
    turned = [(orient(labels, k), orient(opening, k)) for k in range(ORIENTATIONS)]
    shortfalls: list[tuple[int, Meeting]] = []
    for diagonal, pairs in ((False, beside), (True, across)):
        near = {a: _distances(*turned[a], grid, diagonal) for a in {a for a, _ in pairs}}
        for a, b in sorted(pairs):
            gap, rule = _gap(near[a], *turned[b], grid, diagonal)
            shortfalls.append((rule - gap, Meeting((a, b), diagonal, gap)))
    worst = max(shortfalls, key=lambda each: each[0], default=(0, None))
    wrong = [meeting for short, meeting in shortfalls if short > 0]
    at_corner = sum(meeting.diagonal for meeting in wrong)
    return Borders(
        len(beside), len(across), len(wrong) - at_corner, at_corner, worst[1], margin(grid) * grid.cell_nm
    )  # fmt: skip


Near = tuple[tuple[NDArray[np.int64], ...], NDArray[np.int64]]


def _distances(labels: Labels, opening: Mask, grid: EmitterGrid, diagonal: bool) -> Near:
    """Gaps from a pixel's colours, and from its opening, to every cell of its neighbour, [n, n] each; large if far.

    The last of the first part is the gap from emitters of any colour.
    """

    def gaps(mask: Mask) -> NDArray[np.int64]:
        n, reach = grid.cells, max(grid.colour_gap, grid.to_opening)
        far = n + grid.gutter
        canvas = np.ones((far + n if diagonal else n, far + n), dtype=bool)
        canvas[:n, :n] = ~mask
        seen = canvas[max(0, n - reach) if diagonal else 0 :, max(0, n - reach) :]
        if seen.all():
            return np.full((n, n), 2 * far)
        distance = scipy.ndimage.distance_transform_cdt(seen, metric="chessboard")
        return np.asarray(distance[-n:, -n:], dtype=np.int64) - 1

    emitting = labels > 0
    return (*(gaps(labels == k) for k in (1, 2, 3)), gaps(emitting)), gaps(opening)


def _gap(near: Near, labels: Labels, opening: Mask, grid: EmitterGrid, diagonal: bool) -> tuple[int, int]:
    """The gap that falls shortest of its rule, and that rule."""
    colours, from_opening = near
    found = [(grid.colour_gap, grid.colour_gap), (grid.to_opening, grid.to_opening)]
    for one, other in permutations(range(3), 2):
        place = labels == other + 1
        if place.any():
            found.append((int(colours[one][place].min()), grid.colour_gap))
    emitting = labels > 0
    if opening.any():
        found.append((int(colours[3][opening].min()), grid.to_opening))
    if emitting.any():
        found.append((int(from_opening[emitting].min()), grid.to_opening))
    return min(found, key=lambda each: (each[0] - each[1], each[0]))
