"""Triangles between the corners of a flat polygon with holes, none of them flat.

Corners of dots mostly lie on common lines, and cutting ears off a polygon joins some of them to triangles without area.
Such a triangle and its neighbour across its longest side have another diagonal, too: the same corners, as many
triangles and the same outline, so what was closed stays closed, exactly.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from maskfab.model import Point, Polygon

Triangle = tuple[int, int, int]

_FLAT_NM = 5.0
"""Triangles of less height are flat: float32 millimetres within a die could take their area."""


def triangulated(contours: Sequence[Polygon]) -> NDArray[np.int64]:
    """Triangles between the corners of a polygon: int64 [m, 3], counter-clockwise, counting through all contours.

    All have an area, and none is lower than 5 nm where another diagonal helps.

    Args:
        contours: hull counter-clockwise, holes clockwise, in nanometres. They may touch themselves in a corner, where
            the polygon is parted; no corner lies on a side.
    """
    from manifold3d import triangulate

    triangles = np.array(triangulate([np.array(each, dtype=np.float64) for each in contours]), dtype=np.int64)
    points = np.array([point for each in contours for point in each], dtype=np.int64)
    sides = np.roll(points[triangles], -1, axis=1) - points[triangles]
    doubled = sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]
    flat = np.flatnonzero(doubled < _FLAT_NM * np.hypot(sides[..., 0], sides[..., 1]).max(axis=1))
    if not flat.size:
        return triangles
    return np.array(_turned(points.tolist(), [(a, b, c) for a, b, c in triangles.tolist()], flat.tolist()), np.int64)


def _turned(points: Sequence[Point], triangles: list[Triangle], flat: list[int]) -> list[Triangle]:
    """The triangles, diagonals of the flat ones turned wherever that raises the lower of two neighbours.

    Two neighbours on one line stay there, but get a shorter diagonal. So no turn is ever taken back.
    """
    owner = {side: n for n, (a, b, c) in enumerate(triangles) for side in ((a, b), (b, c), (c, a))}
    turned = set(flat)
    while turned:
        flat = [n for n in sorted({*flat, *turned}) if _height(points, triangles[n]) < _FLAT_NM]
        turned = set()
        # The longest first: of several on one line it is the one with a neighbour off the line.
        for n in sorted(flat, key=lambda n: _longest(points, triangles[n]), reverse=True):
            a, b, c = max(_rotations(triangles[n]), key=lambda each: _distance(points, each[0], each[2]))
            across = owner.get((a, c))
            if across is None or _height(points, (a, b, c)) >= _FLAT_NM:
                continue
            (d,) = {*triangles[across]} - {a, c}
            one: Triangle = (a, b, d)
            two: Triangle = (b, c, d)
            old = [_height(points, (a, b, c)), _height(points, (a, c, d))]
            new = [_height(points, one), _height(points, two)]
            closer = not any(old + new) and _distance(points, b, d) < _distance(points, a, c)
            if min(new) > min(old) or closer:
                triangles[n], triangles[across] = one, two
                del owner[a, c], owner[c, a]
                owner |= {(b, d): n, (d, a): n, (d, b): across, (c, d): across, (a, b): n, (b, c): across}
                turned |= {n, across}
    return triangles


def _rotations(triangle: Triangle) -> tuple[Triangle, Triangle, Triangle]:
    a, b, c = triangle
    return (a, b, c), (b, c, a), (c, a, b)


def _distance(points: Sequence[Point], a: int, b: int) -> float:
    return math.dist(points[a], points[b])


def _longest(points: Sequence[Point], triangle: Triangle) -> float:
    return max(_distance(points, a, c) for a, _, c in _rotations(triangle))


def _height(points: Sequence[Point], triangle: Triangle) -> float:
    """Over the longest side; 0 exactly on a line, negative clockwise."""
    (xa, ya), (xb, yb), (xc, yc) = (points[n] for n in triangle)
    return ((xb - xa) * (yc - ya) - (yb - ya) * (xc - xa)) / _longest(points, triangle)
