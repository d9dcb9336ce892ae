"""Dots of a plotter: a square grid about the plate's centre, so that a house that centres the picture moves nothing.

A dot is open if its centre lies in an opening. Of a centre on the very edge of one it does if the opening lies to the
right of it or above: intervals are half-open, so that dots of two that share an edge are neither lost nor told twice.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from maskfab.base.arrays import Floats, Ints
from maskfab.model import Plate

NM_PER_INCH = 25_400_000


@dataclass(frozen=True)
class DotGrid:
    """Dots of a square picture, their distance the whole part of an inch.

    Attributes:
        dpi: dots per inch.
        side: dots along x and along y.
    """

    dpi: int
    side: int

    @classmethod
    def of(cls, plate: Plate, dpi: int) -> DotGrid:
        """The fewest dots that cover the blank."""
        return cls(dpi, -(-plate.blank_nm * dpi // NM_PER_INCH))

    @property
    def dot_nm(self) -> float:
        """Side of a dot."""
        return NM_PER_INCH / self.dpi

    def first(self, edges_nm: Ints) -> Ints:
        """First dots, along x or y, whose centres lie at edges or beyond; exact, and within 0 to ``side``."""
        # The centre of dot k lies at (2 k + 1 - side) inches / (2 dpi).
        beyond = 2 * self.dpi * np.asarray(edges_nm, dtype=np.int64) + (self.side - 1) * NM_PER_INCH
        return np.clip(-(-beyond // (2 * NM_PER_INCH)), 0, self.side)

    def lines_nm(self, dots: Ints) -> Floats:
        """Where dots begin, along x or y."""
        return (2.0 * dots - self.side) * (NM_PER_INCH / 2) / self.dpi
