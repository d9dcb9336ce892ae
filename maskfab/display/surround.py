"""A die as it is built in: an even field, the die in the middle of the regular display, and the border between them.

The regular display is the reference of the job (:mod:`maskfab.display.reference`). Every pixel sends out the light
asked for, here as there, so that without structure nothing would be seen. Three things are. The die's grain and spots
stand against a display that has none; its mean colour, as S-CIELAB takes it in, may differ, for L*a*b* of a mixture is
not the mean of its parts; and along the border colours change places, which may leave a line.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from maskfab.base.arrays import Floats
from maskfab.base.model import COLOURS, Panel, Quantity
from maskfab.display.emitted_light import MOST_SAMPLES, Tiled, Viewing
from maskfab.display.reference import Reference

BORDER = "border"
LEVEL = 0.5
"""Linear light of the field, as of other even ones."""
_AROUND = 4
"""The surround is as wide as the die over this, on every side."""
_NEAR_DEG = 0.1
"""A line is looked for so far to either side of the border."""
_MOST_SEEN = 1 << 20


@dataclass(frozen=True, eq=False)
class Surrounded:
    """The middle of a panel and of the regular display on every side, in pixels."""

    panel: Panel
    reference: Reference
    inside: int
    around: int

    @classmethod
    def of(cls, panel: Panel, reference: Reference, most: int, samples: int, seen_samples: int) -> Surrounded:
        """As many pixels of a panel as there are, up to ``most``, and as can be shown with a surround."""
        whole = min(math.isqrt(MOST_SAMPLES) // max(1, samples), math.isqrt(_MOST_SEEN) // seen_samples)
        inside = max(1, min(most, *panel.orientations.shape, whole * _AROUND // (_AROUND + 2) - 2))
        return cls(panel, reference, inside, math.ceil(inside / _AROUND))

    @property
    def pixels(self) -> int:
        """Along a side, in all."""
        return self.inside + 2 * self.around

    @property
    def image(self) -> Floats:
        """Linear light asked of every pixel, [rows, columns, 3]."""
        return np.full((self.pixels, self.pixels, len(COLOURS)), LEVEL)

    @property
    def tiled(self) -> Tiled:
        """Pixels of both."""
        own, regular = Tiled.of(self.panel, self.inside, self.inside), self.reference.tiled(self.pixels, self.pixels)
        held = regular.held + len(own.tiles)
        middle = slice(self.around, self.around + self.inside)
        held[middle, middle] = own.held
        return replace(own, tiles=(*own.tiles, *regular.tiles), held=held)

    def quantities(self, name: str, lab: Floats, even: Floats, viewing: Viewing) -> list[Quantity]:
        """Numbers of the border, from S-CIELAB's response to the field and to light without structure, [y, x, 3]."""
        samples = len(lab) // self.pixels
        off = lab - even
        seen = np.linalg.norm(off, axis=-1)
        first, last = self.around * samples, (self.around + self.inside) * samples
        within = np.zeros(seen.shape, dtype=np.bool_)
        within[first:last, first:last] = True
        # What lies near the border belongs to neither.
        reach = min(samples * self.around // 2, max(1, round(_NEAR_DEG * viewing.pixels_per_degree * samples)))
        outer = np.ones(seen.shape, dtype=np.bool_)
        outer[first - reach : last + reach, first - reach : last + reach] = False
        step = float(np.linalg.norm(off[within].mean(axis=0) - off[outer].mean(axis=0)))
        # A line is a mean along the side; what a like mean has anywhere in the die is no border.
        profiles = off[first:last].mean(axis=0), off[:, first:last].mean(axis=1)

        def largest(*places: int) -> float:
            near = (profile[at - reach : at + reach] for profile in profiles for at in places)
            return max(float(np.linalg.norm(each, axis=-1).max()) for each in near)

        line, usual = largest(first, last), largest((first + last) // 2)
        regular = f"the same of the regular display round the die, {self.reference.layout}"
        edge = (
            f"largest ΔE of the mean along a side within {_NEAR_DEG:g} degrees of it; {usual:.2g} across the "
            "middle of the die"
        )
        numbers = (
            ("inside", float(seen[within].mean()), "mean S-CIELAB ΔE of an even field"),
            ("outside", float(seen[outer].mean()), regular),
            ("step", step, "ΔE between the mean L*a*b* of the die and of its surround"),
            ("edge", line, edge),
        )
        return [Quantity(f"border_delta_e_{key}", value, method, die=name) for key, value, method in numbers]
