"""Lines that pass beside openings at most, of thousands of openings at once: by chains across a panel.

The theorem is that of :mod:`maskfab.display.wires.panel_cut`. Of all its chains only those are looked at that go on
from every column of cells to the next, in the same row or one beside it, through the largest piece of each opening from
its first dot to its last. So the bound may be higher than that of all chains.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from maskfab.base.arrays import Ints, Mask
from maskfab.display.wires.gutter import WireRules
from maskfab.model import ORIENTATIONS, orient

_TOUCHING = np.ones((3, 3), dtype=np.int8)


def most_beside(units: Mask, cells: NDArray[np.int8], dot_nm: int, rules: WireRules) -> Ints:
    """Lines for every pixel that can be laid along x and along y, at most, [units].

    Args:
        units: bool [units, dots, dots], some of each clear; cells have no gutter.
        cells: orientations of the panel, [rows, columns].
        dot_nm: side of a dot.
        rules: width, space and clearance.
    """
    single = np.stack([_largest_piece(unit) for unit in units])
    turned = np.stack([orient(single.transpose(1, 2, 0), kind) for kind in range(ORIENTATIONS)])
    upright = turned.transpose(3, 0, 1, 2)
    along_y = _passing(upright, cells % ORIENTATIONS, dot_nm, rules)
    along_x = _passing(upright.swapaxes(2, 3), cells.T % ORIENTATIONS, dot_nm, rules)
    return np.minimum(along_y, along_x)


def _passing(patterns: Mask, cells: NDArray[np.int8], dot_nm: int, rules: WireRules) -> Ints:
    """Lines for every pixel that pass every row of cells, [units], of patterns [units, orientations, dots, dots]."""
    dots = patterns.shape[-1]
    lane, pitch = rules.line_nm + rules.space_nm, dots * dot_nm
    held = np.asarray(patterns.any(axis=2))
    left, right = held.argmax(axis=2), dots - 1 - held[:, :, ::-1].argmax(axis=2)
    first, last = (_ends(patterns, column) for column in (left, right))
    beside = left[:, None, :] + dots - right[:, :, None]

    def between(up: int) -> Ints:
        """From the last column of one to the first column of the next, which lies so many cells higher."""
        apart: Ints = last[:, :, None, :, None] - first[:, None, :, None, :] - up * dots
        above = np.abs(apart).min(axis=(3, 4))
        gap = (np.maximum(beside, above) - 1) * dot_nm
        return np.asarray(np.maximum((gap + rules.space_nm - 2 * rules.clearance_nm) // lane, 0))

    tables = {up: between(up) for up in (-1, 0, 1)}
    spare = pitch + rules.space_nm - rules.clearance_nm
    before = np.maximum((left * dot_nm + spare) // lane, 0)
    after = np.maximum(((dots - 1 - right) * dot_nm + spare) // lane, 0)
    rows, columns = cells.shape
    total = before[:, cells[:, 0]]
    for column in range(columns - 1):
        reached = np.full_like(total, np.iinfo(np.int64).max)
        for up, table in tables.items():
            here = np.arange(max(0, -up), rows - max(0, up))
            passing = total[:, here] + table[:, cells[here, column], cells[here + up, column + 1]]
            reached[:, here + up] = np.minimum(reached[:, here + up], passing)
        total = reached
    return np.asarray((total + after[:, cells[:, -1]]).min(axis=1) // columns)


def _ends(patterns: Mask, column: NDArray[np.intp]) -> NDArray[np.intp]:
    """Lowest and highest clear dot of a column of each pattern, [units, orientations, 2]."""
    dots = patterns.shape[-1]
    clear = np.take_along_axis(patterns, column[:, :, None, None], axis=3)[..., 0]
    return np.stack([clear.argmax(axis=2), dots - 1 - clear[:, :, ::-1].argmax(axis=2)], axis=2)


def _largest_piece(unit: Mask) -> Mask:
    labels, count = ndimage.label(unit, structure=_TOUCHING)
    return unit if count == 1 else np.asarray(labels == np.bincount(labels.ravel())[1:].argmax() + 1)
