"""Rules on polygons as they are drawn: vertices on the grid, angles, and how many vertices there are."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from klayout import db

from maskfab.drc.results import Floats, Ints
from maskfab.model import Polygon

Violations = tuple[Ints, Floats]
"""Boxes int64 [n, 4] and values float64 [n]."""


def off_grid(polygons: Sequence[Polygon], grid_nm: int, origin_nm: tuple[int, int] = (0, 0)) -> Violations:
    """Vertices that are no multiple of the grid once the origin is added; the value is how far off the worse axis."""
    points = _points(polygons)
    rest = (points + np.asarray(origin_nm)) % grid_nm
    off = np.minimum(rest, grid_nm - rest).max(axis=1)
    return np.tile(points[off > 0], 2), off[off > 0].astype(np.float64)


def slanted_edges(polygons: Sequence[Polygon]) -> Violations:
    """Edges that run along neither axis; the value is their angle to the nearer one, in degrees."""
    points = _points(polygons)
    after = points[_neighbours(polygons, 1)]
    step = np.abs(after - points)
    slanted = step.min(axis=1) > 0
    angle = np.degrees(np.arctan2(step.min(axis=1), step.max(axis=1)))
    boxes = np.concatenate([np.minimum(points, after), np.maximum(points, after)], axis=1)
    return boxes[slanted], angle[slanted]


def acute_corners(polygons: Sequence[Polygon]) -> Violations:
    """Corners whose sides make less than 90 degrees, inside or outside; the value is that angle."""
    points = _points(polygons)
    back, on = points[_neighbours(polygons, -1)] - points, points[_neighbours(polygons, 1)] - points
    along, turned = (back * on).sum(axis=1), np.abs(back[:, 0] * on[:, 1] - back[:, 1] * on[:, 0])
    acute = along > 0
    return np.tile(points[acute], 2), np.degrees(np.arctan2(turned, along))[acute]


def long_outlines(polygons: Sequence[Polygon], most_vertices: int) -> Violations:
    """Polygons of more vertices than allowed; the value is how many they have."""
    long = [polygon for polygon in polygons if len(polygon) > most_vertices]
    boxes = [[*np.min(polygon, axis=0).tolist(), *np.max(polygon, axis=0).tolist()] for polygon in long]
    return np.array(boxes, dtype=np.int64).reshape(-1, 4), np.array([len(polygon) for polygon in long], np.float64)


def overlaps(polygons: Sequence[Polygon]) -> Violations:
    """Areas that are drawn more than once; the value is the area in nm²."""
    region = db.Region([db.SimplePolygon([db.Point(x, y) for x, y in polygon], True) for polygon in polygons])
    twice = region.merged(True, 2)
    boxes = [box.bbox() for box in twice.each()]
    areas = [float(polygon.area()) for polygon in twice.each()]
    return np.array([[b.left, b.bottom, b.right, b.top] for b in boxes], np.int64).reshape(-1, 4), np.array(areas)


DrawnRule = Callable[[Sequence[Polygon]], Violations]


def _points(polygons: Sequence[Polygon]) -> Ints:
    return np.array([point for polygon in polygons for point in polygon], dtype=np.int64).reshape(-1, 2)


def _neighbours(polygons: Sequence[Polygon], step: int) -> Ints:
    """Index of the vertex so many steps on along its own polygon."""
    runs, before = [np.zeros(0, dtype=np.int64)], 0
    for polygon in polygons:
        runs.append(before + (np.arange(len(polygon)) + step) % len(polygon))
        before += len(polygon)
    return np.concatenate(runs)
