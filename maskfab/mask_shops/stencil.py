"""Marks drawn so that no two figures share a piece of edge: cut open by narrow bars of chrome, as stencils are."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from klayout import db

from maskfab.geometry.plate_layout import simple_polygon
from maskfab.geometry.polygonize import Holes, hull_points, simple_pieces
from maskfab.model import Furniture

_BAR_NM = 4_000
_MOST_TIMES = 8


def stencilled(mark: Furniture, holes: Holes, narrowest_nm: int = 0) -> Furniture:
    """The mark with chrome bars across whatever would have to be cut.

    Every hole is opened by a bar, and every place where an outline touches itself. Holes that have a layer of their own
    need that only where something clear stands in them, for the figure that is subtracted would have a hole itself.

    Args:
        mark: one that is written.
        holes: how the house has holes drawn.
        narrowest_nm: the narrowest space that the house writes; bars are twice as wide, and at least 4 um.

    Returns:
        The mark itself where nothing has to be cut.
    """
    whole = db.Region([db.Polygon(simple_polygon(polygon)) for polygon in mark.polygons]).merged(True, 1)
    kept, cut = _sorted_out(whole, holes)
    if cut.is_empty():
        return mark
    half = max(_BAR_NM // 2, narrowest_nm)
    for _ in range(_MOST_TIMES):
        pieces = _raw(simple_pieces(cut))
        shared = inner_edges(pieces)
        if shared.is_empty():
            break
        cut = (cut - shared.extended(half, half, half, half, False)).merged(True, 1)
    drawn = sorted(
        map(hull_points, [*simple_pieces(cut), *simple_pieces(kept)]), key=lambda each: [(y, x) for x, y in each]
    )
    return replace(mark, polygons=tuple(drawn))


def inner_edges(drawn: db.Region) -> db.Edges:
    """Where two polygons of a region, taken as they were put in, share a piece of edge; told from either side."""
    whole = drawn.merged(True, 1)
    raw = drawn.dup()
    raw.merged_semantics = False
    edges = raw.edges()
    edges.merged_semantics = False
    shared = edges.inside_part(whole)
    # Or the two sides, which run in opposite directions, cancel.
    shared.merged_semantics = False
    return shared


def _sorted_out(whole: db.Region, holes: Holes) -> tuple[db.Region, db.Region]:
    """Polygons that can be drawn as they are, and those that need a bar."""
    kept, cut = db.Region(), db.Region()
    for polygon in whole.each():
        alone = db.Region(polygon)
        hull = db.Polygon(list(polygon.each_point_hull()))
        filled = db.Region(hull)
        touching = next(simple_pieces(filled)).num_points() != hull.num_points()
        inhabited = polygon.holes() > 0 and (holes != "layer" or not ((whole - alone) & filled).is_empty())
        (cut if touching or inhabited else kept).insert(polygon)
    return kept, cut


def _raw(polygons: Iterable[db.Polygon]) -> db.Region:
    region = db.Region(list(polygons))
    region.merged_semantics = False
    return region
