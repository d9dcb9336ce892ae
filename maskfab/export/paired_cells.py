"""Cells of two pixels, for mask software that allows only so many references: half as many do, of at most 64 kinds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Ints


@dataclass(frozen=True, eq=False)
class CellPairs:
    """A grid of cells as cells of two.

    Attributes:
        kinds: int64 [n, 2], what stands left and right in each kind of pair, ascending.
        index: int64 [rows, columns // 2], the kind of every pair.
        rest: int64 [rows, columns % 2], the last cells of an odd number of columns.
    """

    kinds: Ints
    index: Ints
    rest: Ints


def pairs(cells: NDArray[np.integer]) -> CellPairs:
    """Pair the cells [rows, columns] of every row from the left."""
    rows, columns = cells.shape
    even = columns - columns % 2
    left, right = (cells[:, first:even:2].astype(np.int64) for first in (0, 1))
    kinds, index = np.unique(np.stack([left.ravel(), right.ravel()], axis=1), axis=0, return_inverse=True)
    return CellPairs(kinds, index.reshape(rows, even // 2).astype(np.int64), cells[:, even:].astype(np.int64))
