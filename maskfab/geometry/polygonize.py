"""From dots to outlines: hole-free, simple polygons whose union is the mask, exactly.

GDSII and OASIS know no holes and mask writers refuse outlines that touch themselves, so a polygon with either is
bisected along a line of its own grid until neither is left. Mask houses differ, so :func:`recut` also draws holes as
keyholes, as trapezoids or as figures to subtract, and corners that kiss as one re-entrant outline.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from klayout import db
from numpy.typing import NDArray

from maskfab.model import Point, Polygon

Holes: TypeAlias = Literal["bisect", "keyhole", "trapezoids", "layer"]
Corners: TypeAlias = Literal["apart", "joined"]

# An outline that visits a point twice is two loops: 6 and 4 vertices where all angles are right, else 3 and 3.
_FEWEST_THAT_TOUCH_RIGHT = 10
_FEWEST_THAT_TOUCH = 6


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
    pieces = (hull_points(piece) for piece in simple_pieces(_dots(mask)))
    polygons = (tuple((x0 + x * dot_nm, y0 + y * dot_nm) for x, y in piece) for piece in pieces)
    return tuple(sorted(polygons, key=lambda polygon: [(y, x) for x, y in polygon]))


def simple_pieces(region: db.Region, *, apart: bool = True) -> Iterator[db.Polygon]:
    """Hole-free polygons that touch neither themselves nor overlap one another; their union is the region.

    Every cut is a vertical line at an integer x through a hole or a point of self-touch, so the result is exact
    wherever the edges it crosses have integer coordinates there: always for Manhattan polygons.

    Args:
        region: what to cut; overlaps are merged.
        apart: False lets an outline visit a corner twice, and only holes are cut.
    """
    for polygon in region.merged(apart, 1).each():
        cut = _cut_position(polygon, apart)
        if cut is None:
            yield polygon
            continue
        for half in _halves(polygon, cut, upright=True):
            yield from simple_pieces(half, apart=apart)


@dataclass(frozen=True, eq=False)
class Recut:
    """A region drawn in the way that was asked for.

    Attributes:
        pieces: hole-free polygons, raw; their union is the region, or the region with its holes filled.
        holes: polygons to subtract from ``pieces``; empty unless holes have a layer of their own.
        holed: polygons that had a hole.
        parted: polygons that touched themselves in a point and were parted there.
        split: polygons with more vertices than allowed, cut into several.
        polygons: how many were drawn.
        vertices: of all of them.
        longest: the largest number of vertices of one.
    """

    pieces: db.Region
    holes: db.Region
    holed: int
    parted: int
    split: int
    polygons: int
    vertices: int
    longest: int


def recut(
    region: db.Region, holes: Holes = "bisect", corners: Corners = "apart", max_vertices: int | None = None
) -> Recut:
    """Draw a region without holes, and exactly.

    All cuts are vertical or horizontal and on integers, so they are exact for Manhattan polygons and for those of 45
    degrees; for others see :func:`exact`.

    Args:
        region: in nanometres; overlaps are merged.
        holes: ``bisect`` cuts through every hole, ``keyhole`` joins it to the outline by a line of no width,
            ``trapezoids`` takes a polygon with holes apart, ``layer`` fills the holes and gives them back on their own.
        corners: ``apart`` keeps dots that only share a corner two polygons, ``joined`` makes them one outline that
            visits the corner twice.
        max_vertices: polygons with more are cut at a line through one of their own vertices.
    """
    apart = corners == "apart"
    merged = region.merged(apart, 1)
    # Or klayout merges again at every question, and by another rule for corners.
    merged.merged_semantics = False
    holed = merged.with_holes(1, None, False).count()
    filled, subtracted = _raw(), _raw()
    pen = _Pen(holes, apart, max_vertices)
    if holes == "layer" and holed:
        hulls = merged.hulls()
        for polygon in simple_pieces(hulls - merged):
            pen.draw(polygon, subtracted)
        merged = hulls.merged(apart, 1)
        merged.merged_semantics = False
    boxes, others = merged.split_rectangles()
    filled.insert(boxes)
    for polygon in others.each():
        pen.draw(polygon, filled)
    boxes_drawn = boxes.count()
    return Recut(
        filled,
        subtracted,
        holed=holed,
        parted=pen.parted,
        split=pen.split,
        polygons=pen.polygons + boxes_drawn,
        vertices=pen.vertices + 4 * boxes_drawn,
        longest=max(pen.longest, 4 if boxes_drawn else 0),
    )


def exact(region: db.Region, drawn: Recut) -> bool:
    """Whether what is drawn covers the region and nothing else."""
    covered = drawn.pieces if drawn.holes.is_empty() else drawn.pieces.merged() - drawn.holes
    return bool((covered ^ region).is_empty())


def triangles(region: db.Region) -> db.Region:
    """A region as triangles between its own vertices (constrained Delaunay), raw: exact whatever its edges' slant."""
    drawn = _raw()
    for polygon in region.merged(True, 1).each():
        drawn += polygon.delaunay()
    return drawn


def hull_points(polygon: db.Polygon) -> Polygon:
    """The outline of a polygon without holes."""
    return tuple((point.x, point.y) for point in polygon.each_point_hull())


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


class _Pen:
    """Draws polygons one by one under the rules of :func:`recut`, and counts what it had to cut."""

    def __init__(self, holes: Holes, apart: bool, max_vertices: int | None) -> None:
        self._holes, self._apart, self._most = holes, apart, max_vertices
        self.parted = self.split = self.polygons = self.vertices = self.longest = 0

    def draw(self, polygon: db.Polygon, onto: db.Region) -> None:
        holed = polygon.holes() > 0
        cut = None if holed else _cut_position(polygon, self._apart)
        self.parted += cut is not None
        for piece in self._closed(polygon) if holed or cut is not None else (polygon,):
            long = self._most is not None and piece.num_points() > self._most
            self.split += long
            for part in self._short(piece) if long else (piece,):
                onto.insert(part)
                count = part.num_points()
                self.polygons += 1
                self.vertices += count
                self.longest = max(self.longest, count)

    def _closed(self, polygon: db.Polygon) -> Iterator[db.Polygon]:
        """The polygon without holes."""
        if polygon.holes() and self._holes == "keyhole":
            yield polygon.resolved_holes()
        elif polygon.holes() and self._holes == "trapezoids":
            yield from db.Region(polygon).decompose_trapezoids_to_region().each()
        elif _cut_position(polygon, self._apart) is None:
            yield polygon
        else:
            yield from simple_pieces(db.Region(polygon), apart=self._apart)

    def _short(self, polygon: db.Polygon) -> Iterator[db.Polygon]:
        """The polygon as pieces with no more vertices than allowed, cut through vertices of its own."""
        if self._most is None or polygon.num_points() <= self._most:
            yield polygon
            return
        box = polygon.bbox()
        upright = box.width() >= box.height()
        cut = _middle_vertex(polygon, upright)
        if cut is None:
            upright = not upright
            cut = _middle_vertex(polygon, upright)
        if cut is None:
            yield polygon
            return
        for half in _halves(polygon, cut, upright):
            # A keyhole's two sides merge, so that its hole comes back.
            for part in half.merged(self._apart, 1).each():
                for piece in self._closed(part):
                    yield from self._short(piece)


def _middle_vertex(polygon: db.Polygon, upright: bool) -> int | None:
    """x (or y) of a vertex inside the polygon's box with about as many vertices on either side."""
    values: list[int] = sorted(point.x if upright else point.y for point in polygon.each_point_hull())
    low, high = values[0], values[-1]
    inner = [value for value in values if low < value < high]
    return inner[len(inner) // 2] if inner else None


def _halves(polygon: db.Polygon, cut: int, upright: bool) -> tuple[db.Region, db.Region]:
    """Parts of a polygon left and right of x = cut, or below and above y = cut."""
    box, whole = polygon.bbox(), db.Region(polygon)
    if upright:
        boxes = db.Box(box.left, box.bottom, cut, box.top), db.Box(cut, box.bottom, box.right, box.top)
    else:
        boxes = db.Box(box.left, box.bottom, box.right, cut), db.Box(box.left, cut, box.right, box.top)
    return whole & db.Region(boxes[0]), whole & db.Region(boxes[1])


def _raw() -> db.Region:
    """An empty region that gives back its polygons as they were put in."""
    region = db.Region()
    region.merged_semantics = False
    return region


def _cut_position(polygon: db.Polygon, apart: bool) -> int | None:
    """x of a vertical line that opens a hole or, if corners stay apart, parts a self-touch; None if none is needed."""
    if polygon.holes():
        xs: list[int] = [point.x for point in polygon.each_point_hole(0)]
        return (min(xs) + max(xs)) // 2
    count = polygon.num_points()
    if not apart or count < _FEWEST_THAT_TOUCH or (count < _FEWEST_THAT_TOUCH_RIGHT and polygon.is_rectilinear()):
        return None
    visits: Counter[Point] = Counter((point.x, point.y) for point in polygon.each_point_hull())
    return min((x for (x, _), count in visits.items() if count > 1), default=None)
