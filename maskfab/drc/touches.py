"""Points in which two clear corners of a panel kiss."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from maskfab.drc.cells import PanelCells
from maskfab.drc.results import Found, Ints, Repeated, joined
from maskfab.drc.windows import Windows, windows

Bools = NDArray[np.bool_]


def kissing_corners(cells: PanelCells, most: int) -> Found:
    """Vertices at which exactly two of the four dots are clear, and these lie on a diagonal; neighbours included."""
    clear, edges = cells.clear, cells.edges_nm
    held = np.pad(clear, ((1, 0), (0, 0), (0, 0)))
    parts = []
    within = windows(cells, 1, 1)
    n, y, x = np.nonzero(_kissing(clear[:, :-1, :-1], clear[:, :-1, 1:], clear[:, 1:, :-1], clear[:, 1:, 1:]))
    order = np.argsort(within.codes[:, 0])
    parts.append(_repeated(within, order[n], edges[x + 1], edges[y + 1]))
    beside = windows(cells, 2, 1)
    left, right = held[beside.codes[:, 0] + 1, :, -1], held[beside.codes[:, 1] + 1, :, 0]
    n, y = np.nonzero(_kissing(left[:, :-1], right[:, :-1], left[:, 1:], right[:, 1:]))
    parts.append(_repeated(beside, n, np.zeros_like(y), edges[y + 1]))
    above = windows(cells, 1, 2)
    low, high = held[above.codes[:, 0] + 1, -1], held[above.codes[:, 1] + 1, 0]
    n, x = np.nonzero(_kissing(low[:, :-1], low[:, 1:], high[:, :-1], high[:, 1:]))
    parts.append(_repeated(above, n, edges[x + 1], np.zeros_like(x)))
    fours = windows(cells, 2, 2)
    codes = fours.codes.T + 1
    corner = _kissing(held[codes[0], -1, -1], held[codes[1], -1, 0], held[codes[2], 0, -1], held[codes[3], 0, 0])
    (n,) = np.nonzero(corner)
    parts.append(_repeated(fours, n, np.zeros_like(n), np.zeros_like(n)))
    return joined([part.found(most) for part in parts], most)


def _kissing(lower_left: Bools, lower_right: Bools, upper_left: Bools, upper_right: Bools) -> Bools:
    rising = lower_left & upper_right & ~lower_right & ~upper_left
    return rising | (lower_right & upper_left & ~lower_left & ~upper_right)


def _repeated(seen: Windows, owners: Ints, x: Ints, y: Ints) -> Repeated:
    return Repeated(seen.items, seen.origins_nm, owners, np.stack([x, y, x, y], axis=1), np.zeros(len(owners)))
