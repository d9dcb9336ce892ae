"""A given opening with fewer clear dots: for comparing designs at equal light with one that was drawn for more."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from maskfab.errors import JobError, OpeningError
from maskfab.model import frozen
from maskfab.optimiser.rules.discrete import Objective


def reduced(unit: NDArray[np.bool_], clear_dots: int, objective: Objective) -> NDArray[np.bool_]:
    """Close the least useful dots of an opening one after the other, each where the objective loses least.

    Args:
        unit: bool [dots, dots].
        clear_dots: how many stay clear.
        objective: higher is better; asked for every clear dot at every step.

    Raises:
        OpeningError: MF203 for no clear dots.
        JobError: MF104 for more clear dots than the opening has.
    """
    mask = np.array(unit, dtype=np.bool_)
    if clear_dots < 1:
        raise OpeningError(
            "MF203", f"{clear_dots} dots are to be clear", where="reduction", cure="Set clear_dots to 1 or more"
        )
    if clear_dots > mask.sum():
        raise JobError(
            "MF104",
            f"{clear_dots} dots are to be clear, and the opening has {int(mask.sum())}",
            where="reduction",
            cure="Choose that number or fewer",
        )
    while mask.sum() > clear_dots:
        worths = []
        places = np.argwhere(mask)
        for row, column in places:
            mask[row, column] = False
            worths.append(objective(mask))
            mask[row, column] = True
        row, column = places[int(np.argmax(worths))]
        mask[row, column] = False
    return frozen(mask)
