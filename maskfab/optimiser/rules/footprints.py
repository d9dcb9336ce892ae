"""Footprints of many openings, and a bound on each that costs next to nothing."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from maskfab.base.arrays import Floats, Mask
from maskfab.display.emitters.across_borders import border_margin
from maskfab.display.emitters.emitter_rules import EmitterGrid, EmitterRules, grid_of
from maskfab.display.emitters.free_area import free_region
from maskfab.display.emitters.freeform import guillotine
from maskfab.display.emitters.rectangles import rectangle_footprints
from maskfab.model import ORIENTATIONS, Opening


@dataclass(frozen=True, eq=False)
class Footprints:
    """Largest footprints behind openings of one grid, and a bound on them.

    Attributes:
        rules: the display maker's.
        dots: along the cell's side.
        dot_nm: side of a dot.
        orientations: elements of D4 in use; any two may be neighbours.

    Raises:
        JobError: MF117, MF118 from :attr:`grid` where the rules do not suit the pixel.
    """

    rules: EmitterRules
    dots: int
    dot_nm: int
    orientations: tuple[int, ...] = tuple(range(ORIENTATIONS))

    @cached_property
    def grid(self) -> EmitterGrid:
        """Cells on which the rules are whole numbers."""
        nothing = Opening("unit", np.zeros((self.dots, self.dots), dtype=np.bool_), self.dot_nm)
        return grid_of(nothing, self.dot_nm, 0, self.rules)

    def __call__(self, unit: Mask, *, enough: float = math.inf) -> float:
        """Footprint of rectangles, and of straight cuts where rectangles are not enough."""
        margin = border_margin(self.grid)
        found = float(
            rectangle_footprints(
                unit[None],
                self.grid,
                self.rules.ratio,
                orientations=self.orientations,
                margin=margin,
                max_aspect=self.rules.max_aspect,
            )[0]
        )
        if found >= enough:
            return found
        cells, _ = guillotine(self._regions(unit), self.grid, self.rules.ratio)
        return max(found, cells * self.share_of_cell)

    def bounds(self, units: Mask) -> Floats:
        """Upper bounds of the footprint that leave the gap across borders free, in some 30 us each.

        An emitter swept by the gap along x and y grows from an area a to at least (sqrt(a) + gap)^2, by Brunn and
        Minkowski; swept emitters of different colours share nothing, and lie where the free squares of the least width
        are swept.

        Args:
            units: bool [k, dots, dots].

        Returns:
            float [k], share of the pixel.
        """
        width, gap = self.grid.min_width, self.grid.colour_gap
        squares = _windowed(self._regions(units), width, np.logical_and)
        area = _swept(squares, width + gap).sum(axis=(1, 2)).astype(np.float64)
        root = sum(part**0.5 for part in self.rules.ratio)
        # Areas of ratio_k x, which sum to 3 x: 3 x + 2 gap root sqrt(x) + 3 gap^2 = area.
        rest = np.maximum(area - 3 * gap**2, 0)
        side = (np.sqrt((gap * root) ** 2 + 3 * rest) - gap * root) / 3
        return np.asarray(side**2 * self.share_of_cell)

    @property
    def share_of_cell(self) -> float:
        """Area of a cell of the emitters' grid over that of the pixel."""
        return (self.grid.cell_nm / self.grid.pitch_nm) ** 2

    def _regions(self, units: Mask) -> Mask:
        return free_region(units, self.grid, self.orientations, margin=border_margin(self.grid))


def _windowed(cells: Mask, width: int, both: np.ufunc) -> Mask:
    """[k, n - width + 1, n - width + 1]: all (``logical_and``) or any of the ``width`` x ``width`` cells from there."""
    for axis in (1, 2):
        parts = np.lib.stride_tricks.sliding_window_view(cells, width, axis=axis)
        cells = np.asarray(both.reduce(parts, axis=-1))
    return cells


def _swept(places: Mask, width: int) -> Mask:
    """Cells under squares of that width whose lowest, leftmost cells are the places."""
    around = np.pad(places, ((0, 0), (width - 1, width - 1), (width - 1, width - 1)))
    return _windowed(around, width, np.logical_or)
