"""Places inside the cell to which an orientation map may move an opening, and a good choice of few among many.

Places that differ by an element of D4 are one: the map turns the cell anyway. Few are kept, because what a cell holds
is one signed byte; they are chosen one after the other, each for what it adds when every cell takes the best of those
chosen.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Floats
from maskfab.errors import JobError
from maskfab.opening.clear_dots import closed
from maskfab.optimiser.rules.orbits import turned_key
from maskfab.plate.maps import Shift, shifted

_MOST_CANDIDATES = 48


def places(unit: NDArray[np.bool_], most: int = _MOST_CANDIDATES) -> tuple[Shift, ...]:
    """Shifts (right, up) in dots that keep all clear dots in the cell and are not alike under D4; (0, 0) is the first.

    Args:
        unit: bool [dots, dots].
        most: at least 1; where there are more places, they are thinned evenly, in steps along both axes.

    Raises:
        OpeningError: MF203 for a unit without clear dots.
    """
    mask = np.asarray(unit, dtype=np.bool_)
    if not mask.any():
        raise closed(0, mask.size, where="positions", cure="Give an opening with at least 1 clear dot")
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    step = 1
    while True:
        ups = _steps(-int(rows[0]), len(mask) - 1 - int(rows[-1]), step)
        rights = _steps(-int(columns[0]), len(mask) - 1 - int(columns[-1]), step)
        found: dict[bytes, Shift] = {turned_key(mask): (0, 0)}
        for up in ups:
            for right in rights:
                found.setdefault(turned_key(shifted(mask, (right, up))), (right, up))
        # With the widest step the corners are left, which may be too many still.
        if len(found) <= most or step >= len(mask):
            return tuple(found.values())[:most]
        step += 1


def best_places(worth: Floats, count: int) -> tuple[int, ...]:
    """Which of the places to keep, the first always.

    Args:
        worth: [cells, places], what the best turn of a cell at a place changes, dB; less is better.
        count: how many, at most.

    Raises:
        JobError: MF104 for a count below 1.
    """
    if count < 1:
        raise JobError("MF104", f"{count} positions are less than 1", where="positions", cure="Use 1 or more")
    chosen = [0]
    held = np.minimum(worth[:, 0], 0)
    while len(chosen) < min(count, worth.shape[1]):
        total = np.minimum(worth, held[:, None]).sum(axis=0)
        total[chosen] = np.inf
        best = int(total.argmin())
        chosen.append(best)
        held = np.minimum(held, worth[:, best])
    return tuple(chosen)


def _steps(low: int, high: int, step: int) -> list[int]:
    """From low to high, both ends and 0 included, about ``step`` apart."""
    if step == 1:
        return list(range(low, high + 1))
    spread = np.linspace(low, high, 1 + -(-(high - low) // step))
    return sorted({0, *(round(float(value)) for value in spread)})
