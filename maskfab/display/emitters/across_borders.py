"""Squares that keep the colours' gap across the pixel's borders too, from neighbours in every orientation: exact.

A margin along the borders is enough but not needed: one colour may have the border to itself. All rules are between
two squares, so it is enough to know which places each square near a border forbids to the other colours.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from maskfab.display.emitters.emitter_rules import EmitterGrid
from maskfab.display.emitters.free_area import EVERY, relative_orientations
from maskfab.display.emitters.squares import Squares
from maskfab.model import orient

_MOST_PAIRS = 2_000_000
"""Pairs of squares looked at for a third; some seconds."""


def border_margin(grid: EmitterGrid) -> int:
    """Cells along each side that hold no emitter, so that emitters of any two neighbours keep the colours' gap."""
    return max(0, -(-(grid.colour_gap - grid.gutter) // 2))


def facing_squares(region: NDArray[np.bool_], grid: EmitterGrid, orientations: Iterable[int] = EVERY) -> Squares:
    """The squares of a region, of which those near a border know what they forbid within the neighbours.

    Args:
        region: bool [n, n] cells in which an emitter may lie, no margin taken off.
        grid: the gap between colours, the least width and the gutter, in cells.
        orientations: those in use; any two of them may meet.
    """
    squares = Squares.of(region, grid.min_width, grid.colour_gap)
    reach, pitch = grid.min_width + grid.colour_gap - 1, grid.cells + grid.gutter
    n = grid.cells - grid.min_width + 1
    if border_margin(grid) == 0:
        return squares
    ys, xs = squares.places()
    numbers = np.arange(n * n).reshape(n, n)
    foes: dict[int, int] = {}
    for k in relative_orientations(orientations):
        # Where the square at each place comes to lie when its pixel is turned.
        to = np.empty(n * n, dtype=np.intp)
        to[orient(numbers, k).ravel()] = np.arange(n * n)
        turned_y, turned_x = np.divmod(to[ys * n + xs], n)
        for up in (-pitch, 0, pitch):
            for right in (-pitch, 0, pitch):
                if up == right == 0:
                    continue
                y0, y1 = (np.clip(turned_y + up + end, 0, n) for end in (-reach, reach + 1))
                x0, x1 = (np.clip(turned_x + right + end, 0, n) for end in (-reach, reach + 1))
                for i in np.flatnonzero((y1 > y0) & (x1 > x0)):
                    box = squares.box(int(y0[i]), int(y1[i]), int(x0[i]), int(x1[i]))
                    bit = int(ys[i]) * squares.stride + int(xs[i])
                    foes[bit] = foes.get(bit, 0) | box
    return replace(squares, edge=sum(1 << bit for bit in foes), foes=foes)


def three_facing_squares(squares: Squares) -> tuple[int, int, int] | None:
    """Three squares that may be of different colours; zeros if there are none, None if there are too many to tell.

    Emitters that keep the rules hold three squares that do, so zeros prove that no three emitters of any shape fit.
    """
    pairs = 0
    one = squares.free
    while one:
        first = one & -one
        one ^= first
        beside = one & ~squares.near(first)
        two = beside
        while two:
            second = two & -two
            two ^= second
            third = two & ~squares.near(second)
            if third:
                return first, second, third & -third
            pairs += 1
            if pairs > _MOST_PAIRS:
                return None
    return 0, 0, 0
