"""Dots that a symmetry maps onto each other, and the counts that whole sets of them make."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from maskfab.errors import JobError
from maskfab.jobfile.values import Symmetry
from maskfab.model import ORIENTATIONS, orient

ELEMENTS: dict[Symmetry | None, tuple[int, ...]] = {
    None: (0,),
    "mirror": (0, 4),
    "rot180": (0, 2),
    "d4": tuple(range(ORIENTATIONS)),
}
"""Elements of D4 that leave an opening of each symmetry as it is."""


def orbits(dots: int, symmetry: Symmetry | None) -> tuple[NDArray[np.intp], ...]:
    """Dots that a symmetry maps onto each other, as flat indices, in order of their first.

    Args:
        dots: along a side.
        symmetry: ``d4`` all eight elements, ``mirror`` left to right, ``rot180`` half a turn; None leaves each alone.

    Raises:
        JobError: MF105 for another symmetry.
    """
    if symmetry not in ELEMENTS:
        raise JobError(
            "MF105",
            f"there is no symmetry {symmetry!r}",
            where="design.rules.symmetry",
            cure=f"Use {', '.join(k for k in ELEMENTS if k)}, or leave it out",
        )
    number = np.arange(dots * dots).reshape(dots, dots)
    images = np.stack([orient(number, k).ravel() for k in ELEMENTS[symmetry]])
    first = images.min(axis=0)
    return tuple(np.unique(images[:, k]) for k in np.flatnonzero(first == number.ravel()))


def turned_key(unit: NDArray[np.bool_], turns: Iterable[int] = range(ORIENTATIONS)) -> bytes:
    """Key that openings have in common which elements of D4 map onto each other, all of them if none are named."""
    return min(np.packbits(orient(unit, k)).tobytes() for k in turns)


def sums(sizes: Sequence[int]) -> list[int]:
    """Every sum of some of the last k sizes, for k from 0 to all, as a number of which bit n is set if n is a sum."""
    found = [1]
    for size in reversed(sizes):
        found.append(found[-1] | found[-1] << size)
    return found
