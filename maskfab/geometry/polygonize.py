"""From dots to outlines: hole-free, simple polygons whose union is the mask, exactly.

GDSII and OASIS know no holes and mask writers refuse outlines that touch themselves, so a polygon with either is
bisected along a line of its own grid until neither is left.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

import numpy as np
from klayout import db
from numpy.typing import NDArray

from maskfab.model import Point, Polygon


def outline(mask: NDArray[np.bool_], dot_nm: int, origin_nm: Point = (0, 0)) -> tuple[Polygon, ...]:
    """The clear dots of a mask as polygons.

    Dots that share a side are joined; dots that only share a corner are not, so corners may kiss but no outline
    touches itself. Vertices are corners: none lies on a straight edge.

    Args:
        mask: bool [y, x], row 0 lowest, True is clear.
        dot_nm: side of a dot.
        origin_nm: lower left corner of dot [0, 0].

    Returns:
        Polygons in nanometres, clockwise from their lowest leftmost vertex, sorted by (y, x) of their vertices.
    """
    x0, y0 = origin_nm
    pieces = (_points(piece) for piece in simple_pieces(_dots(mask)))
    polygons = (tuple((x0 + x * dot_nm, y0 + y * dot_nm) for x, y in piece) for piece in pieces)
    return tuple(sorted(polygons, key=lambda polygon: [(y, x) for x, y in polygon]))


def simple_pieces(region: db.Region) -> Iterator[db.Polygon]:
    """Hole-free polygons that touch neither themselves nor overlap one another; their union is the region.

    Every cut is a vertical line at an integer x through a hole or a point of self-touch, so the result is exact
    wherever the edges it crosses have integer coordinates there: always for Manhattan polygons.
    """
    for polygon in region.merged(True, 1).each():
        cut = _cut_position(polygon)
        if cut is None:
            yield polygon
            continue
        box, whole = polygon.bbox(), db.Region(polygon)
        yield from simple_pieces(whole & db.Region(db.Box(box.left, box.bottom, cut, box.top)))
        yield from simple_pieces(whole & db.Region(db.Box(cut, box.bottom, box.right, box.top)))


def _dots(mask: NDArray[np.bool_]) -> db.Region:
    """One box per horizontal run of clear dots, in units of one dot."""
    padded = np.pad(mask.astype(np.int8), ((0, 0), (1, 1)))
    steps = np.diff(padded, axis=1)
    rows, starts = np.nonzero(steps == 1)
    _, stops = np.nonzero(steps == -1)
    region = db.Region()
    for y, left, right in zip(rows.tolist(), starts.tolist(), stops.tolist(), strict=True):
        region.insert(db.Box(left, y, right, y + 1))
    return region


def _cut_position(polygon: db.Polygon) -> int | None:
    """x of a vertical line that opens a hole or parts a self-touch; None for a simple polygon."""
    if polygon.holes():
        xs: list[int] = [point.x for point in polygon.each_point_hole(0)]
        return (min(xs) + max(xs)) // 2
    visits: Counter[Point] = Counter((point.x, point.y) for point in polygon.each_point_hull())
    return min((x for (x, _), count in visits.items() if count > 1), default=None)


def _points(polygon: db.Polygon) -> Polygon:
    return tuple((point.x, point.y) for point in polygon.each_point_hull())
