"""Which of the eight orientations each cell of a panel takes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from maskfab.errors import JobError
from maskfab.model import ORIENTATIONS, Tiling

# The published four {same, transpose, mirror, transpose + mirror}, as elements of D4 in the numbering of
# model.orient. They are not a group, so their mean cell keeps a bias that full D4 has not.
PAPER4 = (0, 5, 4, 3)


def orientations(tiling: Tiling, rows: int, columns: int, seed: int | None, *, where: str = "") -> NDArray[np.int8]:
    """Element of D4 for each cell, int8 [rows, columns]; random ones drawn by ``numpy.random.default_rng(seed)``.

    Raises:
        JobError: MF111 if a random tiling has no seed.
    """
    if tiling is Tiling.PERIODIC:
        return np.zeros((rows, columns), dtype=np.int8)
    if seed is None:
        raise JobError(
            "MF111", f"the {tiling} tiling has no seed", where=where, cure="Add seed = 1, or any other integer"
        )
    draw = np.random.default_rng(seed)
    if tiling is Tiling.PAPER4:
        return np.array(PAPER4, dtype=np.int8)[draw.integers(len(PAPER4), size=(rows, columns))]
    return draw.integers(ORIENTATIONS, size=(rows, columns)).astype(np.int8)
