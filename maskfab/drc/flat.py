"""The rules on flat geometry: polygons as they are drawn, marks of a plate, and layouts from elsewhere."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from klayout import db

from maskfab.base.arrays import Floats, Ints
from maskfab.drc.canvas import facing_edges
from maskfab.drc.results import Found, RuleResult, listed
from maskfab.drc.rules import DesignRules, distance_checks
from maskfab.model import Polygon

Violations = tuple[Ints, Floats]
"""Boxes int64 [n, 4] and values float64 [n]."""
DrawnRule = Callable[[Sequence[Polygon]], Violations]
LARGEST = frozenset({"grid", "manhattan", "overlap", "vertices"})
"""Rules whose worst value is the largest."""


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


def _points(polygons: Sequence[Polygon]) -> Ints:
    return np.array([point for polygon in polygons for point in polygon], dtype=np.int64).reshape(-1, 2)


def _neighbours(polygons: Sequence[Polygon], step: int) -> Ints:
    """Index of the vertex so many steps on along its own polygon."""
    runs, before = [np.zeros(0, dtype=np.int64)], 0
    for polygon in polygons:
        runs.append(before + (np.arange(len(polygon)) + step) % len(polygon))
        before += len(polygon)
    return np.concatenate(runs)


def flat_results(
    region: db.Region, polygons: Sequence[Polygon], rules: DesignRules, most: int, die: str | None = None
) -> tuple[RuleResult, ...]:
    """Every rule on geometry, in plate coordinates.

    Args:
        region: what is clear, merged with kissing corners apart (see :func:`merged`).
        polygons: the same as it is drawn.
        rules: what to check.
        most: how many violations are placed.
        die: who owns the violations.
    """
    found: list[tuple[str, int, str, Found]] = []
    for name, (limit, check) in distance_checks(rules).items():
        found.append((name, limit, "nm", _facing(check(region), most)))
    if rules.min_area_nm2 is not None:
        found.append(("area", rules.min_area_nm2, "nm2", _small(region, rules.min_area_nm2, most)))
        islands = _chrome_islands(region)
        found.append(("chrome_area", rules.min_area_nm2, "nm2", _small(islands, rules.min_area_nm2, most)))
    if rules.no_corner_touch:
        found.append(("corner_touch", 0, "nm", _kissing(region, most)))
    for name, limit, unit, rule in drawn_rules(rules):
        boxes, values = rule(polygons)
        found.append((name, limit, unit, listed(boxes, values, most, largest=name in LARGEST)))
    return tuple(each.result(name, limit, unit, die, (0, 0)) for name, limit, unit, each in found)


def drawn_rules(rules: DesignRules, origin_nm: tuple[int, int] = (0, 0)) -> list[tuple[str, int, str, DrawnRule]]:
    """Name, limit, unit and check of the rules on polygons as drawn; the grid counts from the origin given."""
    chosen: list[tuple[str, int, str, DrawnRule]] = []
    if rules.grid_nm is not None:
        grid_nm = rules.grid_nm
        chosen.append(("grid", grid_nm, "nm", lambda polygons: off_grid(polygons, grid_nm, origin_nm)))
    if rules.manhattan:
        chosen.append(("manhattan", 0, "deg", slanted_edges))
    if rules.no_acute_angles:
        chosen.append(("acute_angle", 90, "deg", acute_corners))
    if rules.no_overlap:
        chosen.append(("overlap", 0, "nm2", overlaps))
    if rules.max_vertices is not None:
        most_vertices = rules.max_vertices
        chosen.append(("vertices", most_vertices, "vertices", lambda polygons: long_outlines(polygons, most_vertices)))
    return chosen


def merged(region: db.Region) -> db.Region:
    """A region whose polygons are joined along sides, and stay apart where they kiss."""
    whole = region.merged(True, 1)
    whole.merged_semantics = False
    return whole


def _facing(pairs: db.EdgePairs, most: int) -> Found:
    facing = facing_edges(pairs)
    return listed(facing.boxes_nm, facing.values, most)


def _small(region: db.Region, limit_nm2: int, most: int) -> Found:
    small = list(region.with_area(0, limit_nm2, False).each())
    boxes = [polygon.bbox() for polygon in small]
    corners = np.array([[b.left, b.bottom, b.right, b.top] for b in boxes], dtype=np.int64).reshape(-1, 4)
    return listed(corners, np.array([float(polygon.area()) for polygon in small]), most)


def _chrome_islands(region: db.Region) -> db.Region:
    around = region.bbox().enlarged(1, 1)
    islands = db.Region([p for p in (db.Region(around) - region).merged(True, 1).each() if p.bbox() != around])
    islands.merged_semantics = False
    return islands


def _kissing(region: db.Region, most: int) -> Found:
    """Points that are a corner more than once."""
    edges = region.edges()
    numbers = edges.to_s(edges.count()).translate(str.maketrans("(),;", "    ")).split()
    corners, times = np.unique(np.array(numbers, dtype=np.int64).reshape(-1, 4)[:, :2], axis=0, return_counts=True)
    kisses = np.tile(corners[times > 1], 2)
    return listed(kisses, np.zeros(len(kisses)), most)
