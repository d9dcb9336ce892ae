"""Islands that are too small to write, clear and chrome."""

from __future__ import annotations

import numpy as np

from maskfab.drc.cells import PanelCells
from maskfab.drc.islands import Islands
from maskfab.drc.results import Found, Repeated, joined, listed


def small_islands(cells: PanelCells, islands: Islands, limit_nm2: int, most: int) -> Found:
    """Islands of less than an area; the panel's surroundings are none."""
    parts = islands.parts
    small = np.flatnonzero(parts.inner & (parts.areas_nm2 < limit_nm2))
    inner = Repeated(
        cells.codes.ravel(), cells.origins_nm, parts.owners[small], parts.boxes_nm[small], parts.areas_nm2[small]
    )
    small = np.flatnonzero(~parts.inner & (parts.areas_nm2 < limit_nm2))
    alone = Repeated(
        islands.nodes[islands.alone],
        cells.origins_nm[islands.cells[islands.alone]],
        small,
        parts.boxes_nm[small],
        parts.areas_nm2[small],
    )
    order, starts = islands.joined
    if not order.size:
        return joined([inner.found(most), alone.found(most)], most)
    nodes = islands.nodes[order]
    # Sums of whole numbers stay exact in float64 up to 9e15 nm², a square of 95 mm.
    areas = np.add.reduceat(parts.areas_nm2[nodes], starts)
    boxes = parts.boxes_nm[nodes] + np.tile(cells.origins_nm[islands.cells[order]], 2)
    low, high = np.minimum.reduceat(boxes[:, :2], starts), np.maximum.reduceat(boxes[:, 2:], starts)
    below = areas < limit_nm2
    across = listed(np.concatenate([low, high], axis=1)[below], areas[below], most)
    return joined([inner.found(most), alone.found(most), across], most)
