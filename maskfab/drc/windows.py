"""The distinct neighbourhoods of a panel: single cells, neighbours beside and above each other, and fours."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from maskfab.drc.cells import PanelCells
from maskfab.drc.results import Ints


@dataclass(frozen=True, eq=False)
class Windows:
    """Neighbourhoods of one shape.

    Attributes:
        codes: int64 [n, cells], what the distinct ones hold, row by row from the lowest; -1 lies beyond the panel.
        offsets_nm: int64 [cells, 2], lower left corners of the cells from the neighbourhood's origin, which is the
            corner (or side's lower or left end) that its last cell begins at.
        items: int64 [m], which of them every occurrence is.
        origins_nm: int64 [m, 2], where, from the panel's lower left corner.
    """

    codes: Ints
    offsets_nm: Ints
    items: Ints
    origins_nm: Ints


def windows(cells: PanelCells, across: int, up: int) -> Windows:
    """All neighbourhoods of ``across`` x ``up`` cells, each 1 or 2, those that hang over the panel's rim included."""
    pitch, kinds = cells.panel.pitch_nm, len(cells.held) + 1
    padded = np.pad(cells.codes, ((up - 1, up - 1), (across - 1, across - 1)), constant_values=-1)
    rows, columns = padded.shape[0] - up + 1, padded.shape[1] - across + 1
    views = [padded[y : y + rows, x : x + columns].ravel() for y in range(up) for x in range(across)]
    key = np.zeros(rows * columns, dtype=np.int64)
    for view in views:
        key = key * kinds + view + 1
    distinct, items = np.unique(key, return_inverse=True)
    codes = np.stack([distinct // kinds**power % kinds - 1 for power in range(len(views) - 1, -1, -1)], axis=1)
    offsets = [((x - across + 1) * pitch, (y - up + 1) * pitch) for y in range(up) for x in range(across)]
    row, column = np.indices((rows, columns)).reshape(2, -1)
    return Windows(codes, np.array(offsets, dtype=np.int64), items, np.stack([column, row], axis=1) * pitch)
