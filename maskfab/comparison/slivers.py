"""Slivers: differences too narrow to matter, told from faults by their width.

A fracture into trapezoids rounds every corner that it makes on a slanted edge to the grid, so that slivers narrower
than a grid step are left out or drawn twice all along it. A difference is a sliver if nothing is left of it once its
outline is moved inwards by half the tolerance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from klayout import db

MOST_SIFTED = 100_000
"""Differing polygons above which none is looked at: such a file has faults."""

_FINEST = 1000
_LARGEST = 2**30
_SLACK = 2
"""Units of the refined grid by which moved outlines may be off."""

_STEPS = 8


@dataclass(frozen=True, eq=False)
class Sifted:
    """Differing area by its width.

    Attributes:
        faults: what is wider than the tolerance.
        slivers: what is not.
        widest_nm: no sliver is wider; 0 if there is none. Of polygons of up to a millimetre this and the tolerance are
            kept to 4 pm, of larger ones to the same share of their size.
    """

    faults: db.Region
    slivers: db.Region
    widest_nm: float = 0.0


def sift(differing: db.Region, tolerance_nm: float) -> Sifted:
    """Tell slivers from faults, polygon by polygon.

    Args:
        differing: merged, in nanometres.
        tolerance_nm: width up to which a polygon is a sliver; 0 if none is.
    """
    if tolerance_nm <= 0 or differing.count() > MOST_SIFTED:
        return Sifted(differing, db.Region())
    faults, slivers = db.Region(), db.Region()
    widest = 0.0
    for polygon in differing.each():
        if not _vanishes(polygon, tolerance_nm):
            faults.insert(polygon)
            continue
        slivers.insert(polygon)
        if not _vanishes(polygon, widest):
            widest = _width(polygon, widest, tolerance_nm)
    return Sifted(faults, slivers, widest)


def _vanishes(polygon: db.Polygon, width_nm: float) -> bool:
    finer, box = _finer(polygon), polygon.bbox()
    grown = polygon.moved(-box.left, -box.bottom).transformed(db.ICplxTrans(float(finer)))
    return bool(db.Region(grown).sized(-math.ceil(width_nm * finer / 2) - _SLACK).is_empty())


def _finer(polygon: db.Polygon) -> int:
    box = polygon.bbox()
    return max(1, min(_FINEST, _LARGEST // max(1, int(box.width()), int(box.height()))))


def _width(polygon: db.Polygon, low: float, high: float) -> float:
    """Upper bound of a polygon's width, by bisection between two widths, at one of which it vanishes."""
    for _ in range(_STEPS):
        middle = (low + high) / 2
        low, high = (low, middle) if _vanishes(polygon, middle) else (middle, high)
    return high + 2 * _SLACK / _finer(polygon)
