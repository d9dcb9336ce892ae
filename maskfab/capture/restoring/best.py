r"""The strength of a restorer, and the restorer, that a photograph's record speaks for: no truth is known.

The strength is first looked for with the Wiener filter on a grid of seven decades, which costs little; the others are
tried at it and beside it, for one ε is about right for all. Both choices are those of
:mod:`maskfab.camera.restorers.choice`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from maskfab.camera.record import Record
from maskfab.camera.restorers.choice import Choice, Chosen
from maskfab.camera.restorers.restorer import Blur, Restorer
from maskfab.camera.restorers.wiener import Wiener

GRID = tuple(float(each) for each in np.geomspace(1e-5, 1e2, 15))
_BESIDE = (0.5, 1.0, 2.0)


def restored(record: Record, blur: Blur, restorers: Sequence[Restorer], epsilon: float | None = None) -> Chosen:
    """A record restored by the best of several restorers at the best of several strengths.

    Args:
        record: of at least 128 pixels along a side.
        blur: that it was taken through.
        restorers: with names of their own.
        epsilon: strength of all; None for the one that the record speaks for.

    Raises:
        JobError: MF105 without restorers, or for two of one name.
    """
    if epsilon is not None:
        return Choice(restorers, coded=True).restore(record, blur, {each.name: epsilon for each in restorers})
    first = Wiener()
    found = Choice((first,), steps=GRID, coded=True).restore(record, blur, {first.name: 1.0})
    strengths = {each.name: found.epsilon for each in restorers}
    return Choice(restorers, steps=_BESIDE, coded=True).restore(record, blur, strengths)
