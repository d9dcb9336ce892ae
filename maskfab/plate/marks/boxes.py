"""Rectangles on the nanometre grid, which most marks are made of."""

from __future__ import annotations

from collections.abc import Iterable

from maskfab.model import Box, Point, Polygon


def box_at(centre_nm: Point, size_nm: Point) -> Box:
    """The box of that width and height round a centre; an odd length reaches one nanometre more up or right."""
    x0, y0 = centre_nm[0] - size_nm[0] // 2, centre_nm[1] - size_nm[1] // 2
    return x0, y0, x0 + size_nm[0], y0 + size_nm[1]


def rectangle(box_nm: Box) -> Polygon:
    """The box as a polygon."""
    x0, y0, x1, y1 = box_nm
    return (x0, y0), (x1, y0), (x1, y1), (x0, y1)


def bounds(polygons: Iterable[Polygon]) -> Box:
    """The bounding box of at least one polygon."""
    xs, ys = zip(*(point for polygon in polygons for point in polygon), strict=True)
    return min(xs), min(ys), max(xs), max(ys)
