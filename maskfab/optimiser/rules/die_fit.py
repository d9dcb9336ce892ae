"""A display on a whole die: a design's opening with its map in the middle, and what is drawn from a seed beyond it."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from maskfab.base.arrays import Mask
from maskfab.model import Panel
from maskfab.optimiser.rules.fit_rule import Display
from maskfab.plate.maps import CellMap
from maskfab.progress import Progress, silent
from maskfab.units import NM_PER_UM

SEEDS = 8
"""Dies that are tried of an opening and its map."""


@dataclass(frozen=True)
class DieFit:
    """A check of a display on a die.

    Attributes:
        across: pixels along a side of the die.
        side_um: of these pixels together.
        seed: of the die that the display fits; None if it fits none.
        failed: why it does not fit dies of other seeds, by seed, as they were tried.
        seconds: of processor that the check took.
    """

    across: int
    side_um: float
    seed: int | None
    failed: dict[int, str]
    seconds: float

    @property
    def why(self) -> str | None:
        """Why it fits no die, of the first that was tried; None if it fits one."""
        return None if self.seed is not None else self.first_failure

    @property
    def first_failure(self) -> str | None:
        """Why it does not fit the first that it does not; None if that fits."""
        return next(iter(self.failed.values()), None)


def fitting_die(
    display: Display,
    unit: Mask,
    dot_nm: int,
    cells: CellMap | None = None,
    outer: Mask | None = None,
    *,
    most: int = SEEDS,
    progress: Progress = silent,
) -> DieFit:
    """The first die that a display fits: of its own seed, and of those that follow.

    What the seed does not change is not tried again: a die that the map covers, a periodic one, and a map that does not
    hold the display even by itself.

    Args:
        display: with the size of the die.
        unit: bool [dots, dots].
        dot_nm: side of a dot.
        cells: the opening's map; None for none.
        outer: the opening beside it, bool [dots, dots]; None for none.
        most: dies to try.
        progress: told how many were tried.

    Raises:
        JobError: as :func:`maskfab.display.feasibility.feasibility`.
    """
    start = time.process_time()
    failed: dict[int, str] = {}
    found: int | None = None
    for seed, die in _dies(display, unit, dot_nm, cells, outer, most):
        progress("die", len(failed), most)
        why = display.broken_on(die)
        if why is None:
            found = seed
            break
        failed[seed] = why
        if cells is not None and len(failed) == 1 and most > 1:
            alone = replace(display, across=max(cells.cells.shape))
            if alone.across < display.across and alone.broken_on(alone.die(unit, dot_nm, cells, outer)) is not None:
                break
    progress("die", most, most)
    side_um = display.across * len(unit) * dot_nm / NM_PER_UM
    return DieFit(display.across, side_um, found, failed, time.process_time() - start)


def _dies(
    display: Display, unit: Mask, dot_nm: int, cells: CellMap | None, outer: Mask | None, most: int
) -> Iterator[tuple[int, Panel]]:
    first: Panel | None = None
    for seed in range(display.seed, display.seed + most):
        die = replace(display, seed=seed).die(unit, dot_nm, cells, outer)
        if first is not None and np.array_equal(die.orientations, first.orientations):
            return
        first = first or die
        yield seed, die
