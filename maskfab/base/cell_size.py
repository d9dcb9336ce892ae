"""The size of a display's square cell: so many dots a side, and a gutter that makes up the pitch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from maskfab.base.arrays import Ints
from maskfab.base.errors import JobError
from maskfab.base.units import NM_PER_UM, dpi

_ROUNDING_NM = 1e-6
MOST_CELLS = 128
"""Cells along a pixel's side on which emitters are placed; more would take the window table beyond a gigabyte."""


@dataclass(frozen=True)
class CellSize:
    """A square cell: dots side by side, with an opaque gutter round them.

    Attributes:
        gutter_nm: opaque space between the dots of neighbouring cells, half of it on each side of a cell.
    """

    dots: int
    dot_nm: int
    gutter_nm: int = 0

    @classmethod
    def of_pitch(cls, pitch_um: float, dots: int, gutter_nm: int = 0, *, where: str) -> CellSize:
        """The cell whose dots and gutter make a pitch; MF107, with the nearest, if no dot of whole nanometres does."""
        dot_nm = max(1, round((pitch_um * NM_PER_UM - gutter_nm) / dots))
        made = cls(dots, dot_nm, gutter_nm)
        if not made.has_pitch(pitch_um):
            reached = made.pitch_um
            what = (
                f"pitch {pitch_um:.6f} um ({dpi(pitch_um):.2f} DPI) cannot be made of {dots} dots on the 1 nm "
                f"grid; the nearest is {reached:.10g} um = {made.dpi:.4f} DPI, "
                f"{(reached - pitch_um) * NM_PER_UM:+.1f} nm or {(reached / pitch_um - 1) * 1e6:+.0f} ppm off"
            )
            cure = f'Use dot = "{dot_nm / NM_PER_UM:g} um" and pitch = "{reached:.10g} um"'
            raise JobError("MF107", what, where=where, cure=cure)
        return made

    @classmethod
    def filling(cls, pitch_um: float, dot_nm: int, gutter_nm: int = 0) -> CellSize:
        """The cell of whole dots whose pitch comes nearest to one; it may have none, or fewer."""
        return cls(round((pitch_um * NM_PER_UM - gutter_nm) / dot_nm), dot_nm, gutter_nm)

    @property
    def dots_nm(self) -> int:
        """Side of the square that holds the dots: the cell less its gutter."""
        return self.dots * self.dot_nm

    @property
    def pitch_nm(self) -> int:
        return self.dots_nm + self.gutter_nm

    @property
    def pitch_um(self) -> float:
        return self.pitch_nm / NM_PER_UM

    @property
    def dpi(self) -> float:
        return dpi(self.pitch_um)

    @property
    def dot_edges_nm(self) -> Ints:
        """Borders of the dots along a side, from the cell's own: int64 [dots + 1]."""
        return self.gutter_nm // 2 + self.dot_nm * np.arange(self.dots + 1)

    @property
    def edges_nm(self) -> Ints:
        """Borders of the dots and the gutter along a side, the cell's own included: int64, ascending."""
        return np.unique(np.concatenate([[0], self.dot_edges_nm, [self.pitch_nm]]))

    def has_pitch(self, stated_um: float) -> bool:
        """Whether a pitch that somebody stated is this cell's, but for what a float rounds."""
        return abs(stated_um * NM_PER_UM - self.pitch_nm) < _ROUNDING_NM

    def require_pitch(self, stated_um: float, *, where: str) -> None:
        """Refuse a stated pitch that is not this cell's.

        Raises:
            JobError: MF106 with the dot that would make it; MF107 if none would.
        """
        if self.has_pitch(stated_um):
            return
        meant = CellSize.of_pitch(stated_um, self.dots, self.gutter_nm, where=where)
        dot_um, gutter_um = self.dot_nm / NM_PER_UM, self.gutter_nm / NM_PER_UM
        what = (
            f"{self.dots} dots x {dot_um:g} um + gutter {gutter_um:g} um = {self.pitch_um:g} um, but pitch says "
            f"{stated_um:g} um"
        )
        cure = f'Use dot = "{meant.dot_nm / NM_PER_UM:g} um", or pitch = "{self.pitch_um:g} um"'
        raise JobError("MF106", what, where=where, cure=cure)
