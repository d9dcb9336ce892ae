"""The look at a die that ends a design: its time is measured on a small die, and what there is no time for left out."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace

from maskfab.base.arrays import Mask
from maskfab.base.work import Clock, Progress
from maskfab.designs.rules.display_fit import DieFit, Display, fitting_die
from maskfab.mask.panels import CellMap

PROBED = 12
"""Pixels along a side of a die on which the time of a larger one is measured, and of the least that is looked at."""


@dataclass(frozen=True, eq=False)
class DieLook:
    """The last check of a display, on a die; ``pixel_s`` seconds for each of its pixels, 0 without a budget."""

    display: Display
    clock: Clock
    pixel_s: float = 0.0

    @classmethod
    def of(cls, display: Display, clock: Clock, unit: Mask, dot_nm: int) -> DieLook:
        """The look at a display, whose time is measured with an opening, bool [dots, dots], if there is a budget."""
        if clock.budget_s is None:
            return cls(display, clock)
        small, begun = replace(display, across=min(PROBED, display.across)), time.monotonic()
        small.broken_on(small.die(unit, dot_nm, None))
        return cls(display, clock, (time.monotonic() - begun) / small.across**2)

    @property
    def seconds(self) -> float:
        """Seconds of the whole die."""
        return self.pixel_s * self.display.across**2

    def __call__(self, unit: Mask, dot_nm: int, cells: CellMap | None, progress: Progress) -> DieFit:
        """The first die that the display fits, no larger than the time left allows, and no smaller than the map."""
        left, display = self.clock.left(), self.display
        if left is not None and self.pixel_s:
            least = PROBED if cells is None else max(cells.cells.shape)
            display = replace(display, across=min(display.across, max(least, math.isqrt(int(left / self.pixel_s)))))
        return fitting_die(display, unit, dot_nm, cells, progress=progress)

    def notes(self, fit: DieFit | None) -> tuple[str, ...]:
        """Sentence on a die of which only a part was looked at."""
        if fit is None or fit.across >= self.display.across:
            return ()
        whole = f"{self.display.across} x {self.display.across}"
        return (f"{self.clock.ender} left time to look at {fit.across} x {fit.across} of the die's {whole} pixels.",)
